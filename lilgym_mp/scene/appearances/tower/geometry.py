"""The 121 stacks that a box of Tower may hold, each one shared `Box`, with tables of the edits that join them.

Source: docs/spec.md, "Scenes", "Legality and effects".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from lilgym_mp.scene import BOX_COUNT, Box, Colour, Item, SceneError, Shape, Size
from lilgym_mp.scene.actions import AddBlock, RemoveBlock, Stop
from lilgym_mp.scene.appearances.base import EveryBox, InvalidReason
from lilgym_mp.scene.appearances.tower.actions import ACTIONS
from lilgym_mp.scene.arrays import BoolArray, Int8Array, Int64Array

BLOCK_X = 40
LEVEL_Y = (80, 59, 38, 17)  # top of the block on each level, from the bottom
CAPACITY = len(LEVEL_Y)
_MEMO_KEY = "tower successors"  # in a box's memo: the boxes after each edit, by column of `TowerTables.after`


class TowerTables(NamedTuple):
    """The 121 boxes by index, the empty one first, as arrays for vectorised lookup."""

    boxes: Sequence[Box]  # (121,)
    indices: Mapping[tuple[Item, ...], int]  # keyed by the box's items
    after: Int64Array  # (121, 4) index of the box after adding each colour and after removing; -1 if invalid
    colours: Int8Array  # (121, 4) colour of the block on each level, -1 where there is none
    action_box: Int64Array  # (13,) box of an action; 0 for STOP
    action_edit: Int64Array  # (13,) column of `after`; 0 for STOP
    heights: Int64Array  # (121,)
    legal: BoolArray  # (5, 5, 5, 13) whether each action is valid, by the heights of the three boxes


REMOVE_COLUMN = len(Colour)  # of `after`
EDIT_REASONS = (*(InvalidReason.FULL_TOWER for _ in Colour), InvalidReason.EMPTY_TOWER)  # indexed by column of `after`


@cache
def tower_tables() -> TowerTables:
    """Tables of all possible boxes and of the actions' effects on them."""
    boxes = tuple(_boxes().values())
    indices = {box.items: index for index, box in enumerate(boxes)}
    colours = np.full((len(boxes), CAPACITY), -1, np.int8)
    for index, box in enumerate(boxes):
        colours[index, : len(box.items)] = [item.colour for item in box.items]
    return TowerTables(
        boxes,
        indices,
        after=np.array([[-1 if box is None else indices[box.items] for box in row] for row in map(successors, boxes)]),
        colours=colours,
        action_box=np.array([0 if isinstance(action, Stop) else action.box for action in ACTIONS]),
        action_edit=np.array([0, *[*Colour] * BOX_COUNT, *[REMOVE_COLUMN] * BOX_COUNT]),  # in the order of ACTIONS
        heights=np.array([len(box.items) for box in boxes]),
        legal=legal_by_heights(),
    )


def _block(level: int, colour: Colour) -> Item:
    return Item(BLOCK_X, LEVEL_Y[level], Shape.SQUARE, colour, Size.MEDIUM)


@cache
def _boxes() -> dict[tuple[Item, ...], Box]:
    """All 121 boxes by items, each with its successors in its memo."""
    boxes: dict[tuple[Item, ...], Box] = {(): Box()}
    layer: list[tuple[Item, ...]] = [()]
    for level in range(CAPACITY):
        layer = [(*items, _block(level, colour)) for items in layer for colour in Colour]
        boxes.update((items, Box(items)) for items in layer)
    for items, box in boxes.items():
        full = len(items) == CAPACITY
        box.memo[_MEMO_KEY] = (
            *(None if full else boxes[(*items, _block(len(items), colour))] for colour in Colour),
            boxes[items[:-1]] if items else None,
        )
    return boxes


def successors(box: Box) -> tuple[Box | None, ...]:
    """The box after adding each colour and after removing; None if that is invalid."""
    try:
        return box.memo[_MEMO_KEY]
    except KeyError:
        return shared_box(box).memo[_MEMO_KEY]


def shared_box(box: Box) -> Box:
    """The one object for a box of Tower. Raises SceneError for a box that is no tower."""
    try:
        return _boxes()[box.items]
    except KeyError:
        raise SceneError(_fault(box)) from None


def _fault(box: Box) -> str:
    if len(box.items) > CAPACITY:
        return f"a tower holds at most {CAPACITY} blocks, not {len(box.items)}"
    for level, item in enumerate(box.items):
        if item != _block(level, item.colour):
            return (
                f"item {level} must be a medium square at ({BLOCK_X}, {LEVEL_Y[level]}) to stack,"
                f" not a {item.size.name.lower()} {item.shape.name.lower()} at ({item.x}, {item.y})"
            )
    raise AssertionError("the box is a legal tower")


@cache
def legal_by_heights() -> BoolArray:
    """(5, 5, 5, 13) whether each action is valid, by the heights of the three towers. Read-only."""
    heights = np.indices((CAPACITY + 1,) * BOX_COUNT)
    legal = np.ones((*heights.shape[1:], len(ACTIONS)), bool)
    for index, action in enumerate(ACTIONS):
        if isinstance(action, AddBlock):
            legal[..., index] = heights[action.box] < CAPACITY
        elif isinstance(action, RemoveBlock):
            legal[..., index] = heights[action.box] > 0
    return legal


@cache
def every_box() -> EveryBox:
    """The 121 boxes in the order of `tower_tables`, and the edits from each to each."""
    tables = tower_tables()
    equal = (tables.colours[:, None] == tables.colours[None]) & (tables.colours[:, None] >= 0)
    shared = np.count_nonzero(np.logical_and.accumulate(equal, axis=2), axis=2)
    return EveryBox(tables.boxes, tables.heights[:, None] + tables.heights[None] - 2 * shared)
