"""Random scenes of Scatter, and edits of them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from random import Random
from typing import NamedTuple

from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, Box, Item, Scene
from lilgym_mp.scene.actions import AddItem, RemoveItem
from lilgym_mp.scene.appearances.base import fits_box
from lilgym_mp.scene.appearances.grids import RELEASED_GRID
from lilgym_mp.scene.appearances.places import Cells
from lilgym_mp.scene.appearances.sampling import ATTRIBUTE_VALUE_COUNTS, ItemTypes
from lilgym_mp.scene.appearances.scatter.geometry import is_free

MAX_BOX_ITEMS = (1, 2, 4, 6, 8)  # limits on the items per box, to draw uniformly from
TOUCHING_GAP = 1  # most pixels between two touching items
NEAR_GAPS = (2, 3, 4)  # pixels: almost touching in the program language
CLEAR_GAP = 9  # pixels: visibly apart
CELLS = Cells(RELEASED_GRID)
ALL_ITEM_TYPES = ItemTypes()


class ItemPlacing(NamedTuple):
    """How a random place for an item is found."""

    attempts: int = 20
    margin: int = 0  # fewest pixels to the walls, unless the item is put at one
    gap: Callable[[Random], int] = lambda rng: 0  # draws the pixels to the wall or item that it is put at
    accepts: Callable[[Box], bool] = lambda box: True  # whether the box is as required with the new item


ANYWHERE = ItemPlacing()


class ScatterSampler:
    """Draws scenes of Scatter, which may be such that actions on the grid cannot reach them."""

    def scene(self, rng: Random) -> Scene:
        item_types = ItemTypes.sample(rng, *[ATTRIBUTE_VALUE_COUNTS] * 3)
        limit = rng.choice(MAX_BOX_ITEMS)
        while True:
            scene = scattered(rng, item_types, limit)
            if any(scene.items()):
                return scene

    def changed(self, rng: Random, scene: Scene) -> Scene:
        while True:
            index = rng.randrange(BOX_COUNT)
            box = scene.boxes[index]
            if box.items and rng.random() < 0.5:
                changed = scene.with_box(index, box.without(rng.randrange(len(box.items))))
            else:
                changed = with_item(rng, scene, index, ALL_ITEM_TYPES)
            if changed is not scene and any(changed.items()):
                return changed

    def legible_scene(self, rng: Random) -> Scene:
        return scattered(rng, ItemTypes.few(rng), rng.choice((1, 2, 3, 4, 6)), LEGIBLY)

    def addition(self, rng: Random, item_types: ItemTypes, box: int) -> AddItem:
        shapes, colours, sizes = item_types
        rows, columns = CELLS.box_shape
        x = rng.randrange(columns) * CELLS.size[0]
        y = rng.randrange(rows) * CELLS.size[1]
        return AddItem(*CELLS.at(box, x, y), rng.choice(shapes), rng.choice(colours), rng.choice(sizes))

    def removal(self, successor: Scene, box: int) -> RemoveItem:
        """At the centre of the item."""
        item = successor.boxes[box].items[-1]
        return RemoveItem(*CELLS.at(box, item.x + item.side // 2, item.y + item.side // 2))


def scattered(rng: Random, item_types: ItemTypes, limit: int, placing: ItemPlacing = ANYWHERE) -> Scene:
    """A scene with random items, at most `limit` in each box; it may be empty."""
    scene = Scene.empty()
    for box in range(BOX_COUNT):
        for _ in range(rng.randint(0, limit)):
            scene = with_item(rng, scene, box, item_types, placing)
    return scene


def with_item(rng: Random, scene: Scene, index: int, item_types: ItemTypes, placing: ItemPlacing = ANYWHERE) -> Scene:
    """The scene with one item added to a box, or the same scene object when no free position was found."""
    shape = rng.choice(item_types.shapes)
    colour = rng.choice(item_types.colours)
    size = rng.choice(item_types.sizes)
    box = scene.boxes[index]
    for _ in range(placing.attempts):
        x, y = _random_position(rng, size.pixels, box.items, placing)
        item = Item(x, y, shape, colour, size)
        if fits_box(item.footprint, x, y) and is_free(item.footprint, x, y, box.items):
            changed = box.with_item(item)
            if placing.accepts(changed):
                return scene.with_box(index, changed)
    return scene


def _random_position(rng: Random, side: int, others: tuple[Item, ...], placing: ItemPlacing) -> tuple[int, int]:
    """A random position in a box: anywhere, at a wall, in a corner, or beside another item."""
    last = BOX_SIDE - side
    x, y = (rng.randint(placing.margin, last - placing.margin) for _ in "xy")
    gap = placing.gap(rng)
    match rng.choice(("free", "free", "wall", "corner", "beside")):
        case "wall":
            return rng.choice(((gap, y), (last - gap, y), (x, gap), (x, last - gap)))
        case "corner":
            return rng.choice((gap, last - gap)), rng.choice((gap, last - gap))
        case "beside" if others:
            other = rng.choice(others)
            slide = rng.randint(-side // 2, other.side // 2)
            before = -side - gap
            after = other.side + gap
            dx, dy = rng.choice(((before, slide), (after, slide), (slide, before), (slide, after)))
            return other.x + dx, other.y + dy
        case _:
            return x, y


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


def _random_gap(rng: Random) -> int:
    return rng.choice((0, 0, 0, rng.choice(NEAR_GAPS)))


LEGIBLY = ItemPlacing(30, CLEAR_GAP, _random_gap, _is_legible)
