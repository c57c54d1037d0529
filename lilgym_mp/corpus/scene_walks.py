"""Samples scenes to evaluate statements on, in random walks of legal edits.

Each step of a walk is an `Expansion`: a scene and some successors by one ADD that a REMOVE undoes. A scene and its
successor are one edit apart, a near miss where a statement has different truth values in them.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, islice
from typing import NamedTuple

from lilgym_mp.corpus.scene_sampling import ItemPlacing, ItemTypes, sampler_of, scattered
from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, Box, Item, Scene
from lilgym_mp.scene.actions import Action, AddBlock, AddItem, RemoveBlock, RemoveItem
from lilgym_mp.scene.appearances import RELEASED_GRID, make_appearance

RULES = RULE_SETS["paper"]
SUCCESSORS = 3  # most successors of an expanded scene
TOUCHING_GAP = 1  # most pixels between two touching items
NEAR_GAPS = (2, 3, 4)  # pixels: almost touching in the program language
CLEAR_GAP = 9  # pixels: visibly apart
TRIES = 30
BOX_CELLS = RELEASED_GRID[1]  # columns and rows of cells in a box
CELL_SIDE = BOX_SIDE // BOX_CELLS  # pixels
COLUMN_PITCH = BOX_PITCH // CELL_SIDE  # columns from one box to the next


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
    def sample(cls, appearance: str, rng: random.Random, walks: int) -> ScenePool:
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

    def neighbours(self, rng: random.Random) -> Iterator[tuple[Scene, Scene]]:
        """Pairs of non-empty scenes one edit apart, in random order of the walks."""
        for walk in rng.sample(self.walks, len(self.walks)):
            for expansion in walk:
                if any(expansion.scene.items()):
                    yield from ((expansion.scene, successor) for successor in expansion.successors)


def random_walks(appearance: str, rng: random.Random) -> Iterator[Walk]:
    """Endless walks, alternately from the empty scene and from a random one."""
    while True:
        yield _random_walk(appearance, Scene.empty(), rng, (3, 5, 7, 9))
        yield _random_walk(appearance, _random_scene(appearance, rng), rng, (1, 2, 3))


def _is_legible(box: Box) -> bool:
    """Whether every gap to a wall or between items is visibly touching, almost touching or apart."""
    starts = ((place, item.side) for item in box.items for place in (item.x, item.y))
    walls = (gap for place, side in starts for gap in (place, BOX_SIDE - side - place))
    pairs = (_gap(one, other) - TOUCHING_GAP for one, other in combinations(box.items, 2))
    return all(gap <= 0 or gap in NEAR_GAPS or gap >= CLEAR_GAP - TOUCHING_GAP for gap in (*walls, *pairs))


def _gap(one: Item, other: Item) -> int:
    """Pixels between the bounding squares of two items, as the programs measure it (docs/programs.md, "Two items")."""
    along_x = max(one.x - other.x - other.side, other.x - one.x - one.side)
    along_y = max(one.y - other.y - other.side, other.y - one.y - one.side)
    return max(along_x, along_y)


def _random_scene(appearance: str, rng: random.Random) -> Scene:
    """A random scene, not only one that actions on the grid can reach."""
    if appearance != "scatter":
        return sampler_of(appearance).scene(rng)
    return scattered(rng, _random_palette(rng), rng.choice((1, 2, 3, 4, 6)), LEGIBLY)


def _random_walk(appearance: str, scene: Scene, rng: random.Random, lengths: tuple[int, ...]) -> Walk:
    expansions: list[Expansion] = []
    palette = _random_palette(rng)
    boxes = rng.sample(range(BOX_COUNT), rng.choice((1, 2, 3, 3)))
    for _ in range(rng.choice(lengths)):
        successors = [_successor(appearance, scene, rng, palette, boxes) for _ in range(SUCCESSORS)]
        distinct = tuple(dict.fromkeys(successor for successor in successors if successor is not None))
        if not distinct:
            break
        expansions.append(Expansion(scene, distinct))
        scene = rng.choice(distinct)
    return tuple(expansions)


def _successor(appearance: str, scene: Scene, rng: random.Random, palette: ItemTypes, boxes: list[int]) -> Scene | None:
    """The scene after a random ADD that a REMOVE undoes; None if none was found."""
    geometry = make_appearance(appearance)
    for _ in range(TRIES):
        box_index = rng.choice(boxes)
        action = _random_add(appearance, rng, palette, box_index)
        successor, invalid = geometry.apply(scene, action, RULES.placement)
        if invalid is not None:
            continue
        if geometry.apply(successor, _inverse(successor, box_index, action), RULES.placement).scene == scene:
            return successor
    return None


def _random_add(appearance: str, rng: random.Random, palette: ItemTypes, box_index: int) -> Action:
    shapes, colours, sizes = palette
    if appearance == "tower":
        return AddBlock(box_index, rng.choice(colours))
    column = rng.randrange(BOX_CELLS)
    row = rng.randrange(BOX_CELLS)
    return AddItem(box_index * COLUMN_PITCH + column, row, rng.choice(shapes), rng.choice(colours), rng.choice(sizes))


def _inverse(successor: Scene, box_index: int, action: Action) -> Action:
    """The REMOVE that should undo the ADD: in Scatter, at the centre of the new item."""
    if isinstance(action, AddBlock):
        return RemoveBlock(box_index)
    item = successor.boxes[box_index].items[-1]
    column, row = ((place + item.side // 2) // CELL_SIDE for place in (item.x, item.y))
    return RemoveItem(box_index * COLUMN_PITCH + column, row)


def _random_palette(rng: random.Random) -> ItemTypes:
    """Random attribute values; few of them make items alike, so that counts and comparisons vary."""
    counts = (1, 2, 2, 3, 3)
    return ItemTypes.sample(rng, counts, (1, 2, 3, 3, 3), counts)


def _random_gap(rng: random.Random) -> int:
    return rng.choice((0, 0, 0, rng.choice(NEAR_GAPS)))


LEGIBLY = ItemPlacing(TRIES, CLEAR_GAP, _random_gap, _is_legible)
