"""Samples scenes to evaluate statements on, in random walks of legal edits.

Each step of a walk is an `Expansion`: a scene and some successors by one ADD that a REMOVE undoes. A scene and its
successor are one edit apart, a near miss where a statement has different truth values in them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from random import Random
from typing import NamedTuple

from lilgym_mp.corpus.scene_sampling import sampler_of
from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.scene import BOX_COUNT, Scene
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.scene.appearances.sampling import ItemTypes

RULES = RULE_SETS["paper"]
SUCCESSORS = 3  # most successors of an expanded scene
TRIES = 30


class Expansion(NamedTuple):
    """A scene with some of its successors."""

    scene: Scene
    successors: tuple[Scene, ...]


Walk = tuple[Expansion, ...]  # each scene but the first is a successor of the one before


@dataclass(frozen=True)
class ScenePool:
    """The distinct scenes of many random walks of one appearance."""

    scenes: tuple[Scene, ...]
    walks: tuple[Walk, ...]

    @classmethod
    def sample(cls, appearance: str, rng: Random, walks: int) -> ScenePool:
        """The scenes of random walks and all their successors, without duplicates."""
        found = tuple(islice(random_walks(appearance, rng), walks))
        scenes = dict.fromkeys(
            scene for walk in found for expansion in walk for scene in (expansion.scene, *expansion.successors)
        )
        return cls(tuple(scenes), found)

    def from_empty(self) -> Iterator[Scene]:
        """The scenes of walks from the empty scene, which legal edits reach within the horizon."""
        for walk in self.walks:
            if walk and not any(walk[0].scene.items()):
                yield from (scene for expansion in walk for scene in (expansion.scene, *expansion.successors))

    def neighbours(self, rng: Random) -> Iterator[tuple[Scene, Scene]]:
        """Pairs of non-empty scenes one edit apart, in random order of the walks."""
        for walk in rng.sample(self.walks, len(self.walks)):
            for expansion in walk:
                if any(expansion.scene.items()):
                    yield from ((expansion.scene, successor) for successor in expansion.successors)


def random_walks(appearance: str, rng: Random) -> Iterator[Walk]:
    """Endless walks, alternately from the empty scene and from a random one."""
    while True:
        yield _random_walk(appearance, Scene.empty(), rng, (3, 5, 7, 9))
        yield _random_walk(appearance, sampler_of(appearance).legible_scene(rng), rng, (1, 2, 3))


def _random_walk(appearance: str, scene: Scene, rng: Random, lengths: tuple[int, ...]) -> Walk:
    expansions: list[Expansion] = []
    palette = ItemTypes.few(rng)
    boxes = rng.sample(range(BOX_COUNT), rng.choice((1, 2, 3, 3)))
    for _ in range(rng.choice(lengths)):
        successors = [_successor(appearance, scene, rng, palette, boxes) for _ in range(SUCCESSORS)]
        distinct = tuple(dict.fromkeys(successor for successor in successors if successor is not None))
        if not distinct:
            break
        expansions.append(Expansion(scene, distinct))
        scene = rng.choice(distinct)
    return tuple(expansions)


def _successor(appearance: str, scene: Scene, rng: Random, palette: ItemTypes, boxes: list[int]) -> Scene | None:
    """The scene after a random ADD that a REMOVE undoes; None if none was found."""
    geometry = make_appearance(appearance)
    sampler = sampler_of(appearance)
    for _ in range(TRIES):
        box = rng.choice(boxes)
        successor, invalid = geometry.apply(scene, sampler.addition(rng, palette, box), RULES.placement)
        if invalid is not None:
            continue
        if geometry.apply(successor, sampler.removal(successor, box), RULES.placement).scene == scene:
            return successor
    return None
