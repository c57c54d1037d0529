"""Selects start scenes for a statement from a pool of sampled scenes, by its truth values on the pool."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice
from typing import NamedTuple

from lilgym_mp.generator.meanings.scene_sampling import EDIT_LIMIT, Expansion, Walk, random_walks
from lilgym_mp.scene import Scene

SceneTest = Callable[[Scene], bool]


class StartScene(NamedTuple):
    """A start scene with the statement's truth value and an upper bound of the edits needed to flip it."""

    scene: Scene
    label: bool
    edits: int


@dataclass(frozen=True)
class ScenePool:
    """The distinct scenes of many random walks of one appearance."""

    scenes: tuple[Scene, ...]
    walks: tuple[Walk, ...]

    @classmethod
    def sample(cls, appearance: str, rng: random.Random, walks: int) -> ScenePool:
        found = tuple(islice(random_walks(appearance, rng), walks))
        scenes = dict.fromkeys(
            scene for walk in found for expansion in walk for scene in (expansion.scene, *expansion.successors)
        )
        return cls(tuple(scenes), found)


class TruthTable:
    """The truth value of a statement in every scene of a pool."""

    def __init__(self, pool: ScenePool, truth: SceneTest) -> None:
        self.pool = pool
        self.values = {scene: truth(scene) for scene in pool.scenes}

    @property
    def share_true(self) -> float:
        return sum(self.values.values()) / len(self.values)

    def edits_from_empty(self) -> int | None:
        """The fewest edits from the empty scene that make it true in the pool's walks: an upper bound; None if none."""
        best: int | None = None
        for walk in self.pool.walks:
            for scene, successors, edits in walk:
                if edits is None or (best is not None and edits >= best):
                    break
                if self.values[scene]:
                    best = edits
                elif any(self.values[successor] for successor in successors) and edits < EDIT_LIMIT:
                    best = edits + 1
        return best

    def neighbours(self, rng: random.Random) -> Iterator[tuple[StartScene, StartScene]]:
        """Pairs of scenes one edit apart with different truth values, in random order."""
        return self._pairs(rng, 1, lambda expansion: [(expansion.scene, scene) for scene in expansion.successors])

    def siblings(self, rng: random.Random) -> Iterator[tuple[StartScene, StartScene]]:
        """The same for successors of one scene: two edits apart, with equally many items."""
        return self._pairs(rng, 2, lambda expansion: list(combinations(expansion.successors, 2)))

    def _pairs(
        self,
        rng: random.Random,
        edits: int,
        candidates: Callable[[Expansion], Sequence[tuple[Scene, Scene]]],
    ) -> Iterator[tuple[StartScene, StartScene]]:
        for walk in rng.sample(self.pool.walks, len(self.pool.walks)):
            for expansion in walk:
                for one, other in candidates(expansion):
                    if self.values[one] != self.values[other] and any(one.items()):
                        yield self._start(one, edits), self._start(other, edits)

    def _start(self, scene: Scene, edits: int) -> StartScene:
        return StartScene(scene, self.values[scene], edits)


def select_starts(truths: TruthTable, rng: random.Random, is_clear: SceneTest) -> list[StartScene]:
    """A pair of neighbours and a pair of siblings (or neighbours again), the true scene of each pair first.

    Only scenes that pass `is_clear`; empty if there are no two such pairs.
    """
    selected: list[StartScene] = []
    for source in (truths.neighbours, truths.siblings, truths.neighbours):
        if len(selected) < 4:
            selected += next(_new_pairs(source(rng), selected, is_clear), ())
    return selected if len(selected) == 4 else []


def _new_pairs(
    pairs: Iterator[tuple[StartScene, StartScene]], selected: Sequence[StartScene], is_clear: SceneTest
) -> Iterator[list[StartScene]]:
    used = {start.scene for start in selected}
    for pair in pairs:
        if all(start.scene not in used and is_clear(start.scene) for start in pair):
            yield sorted(pair, key=lambda start: not start.label)
