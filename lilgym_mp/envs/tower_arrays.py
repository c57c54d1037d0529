"""Many towers at once: a core whose boxes are numbers, over the tables that the Tower appearance itself reads."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances.tower import BLOCK_X, EDIT_REASONS, LEVEL_Y, tower_tables
from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.block import (
    EDIT_SITUATIONS,
    INVALID_EDIT,
    NO_REASON,
    REASON_NUMBERS,
    RIGHT_STOP,
    WRONG_STOP,
    Block,
    Int64Array,
)
from lilgym_mp.observation import Int16Array, item_array
from lilgym_mp.render import UInt8Array, draw, shrink_of
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, Box, Colour, Item, Scene, Shape, Size

_REASONS = np.array([REASON_NUMBERS[reason] for reason in EDIT_REASONS])  # by column of `TowerTables.after`


class TowerArrays:
    """`cores.Core` for Tower: a box is its number among the 121."""

    def __init__(self, dynamics: Dynamics, tasks: TaskSet, block: Block, image_size: str) -> None:
        self._dynamics = dynamics
        self._tasks = tasks
        self._block = block
        self._tables = tower_tables()
        self._applies = np.array([verdict.applies for verdict in dynamics.verdicts])
        self._starts = np.array([self._numbers(task.start) for task in tasks])  # (tasks, 3)
        self._every = np.arange(len(block.action))
        self._boxes = np.zeros((len(block.action), BOX_COUNT), np.int64)
        self._flat_boxes = self._boxes.reshape(-1)
        self._painter = _TowerPainter(block.image, image_size)
        self._after = self._tables.after.reshape(-1)  # by box * edits + edit, here and in the next
        self._looks = self._edit_looks()  # what `_TowerPainter.paint` is to show of the level that changes

    def _edit_looks(self) -> Int64Array:
        """(121 * edits,) the level that an edit changes and its new look, as one number; 0 for invalid ones."""
        before = np.arange(len(self._tables.after)).repeat(self._tables.after.shape[1])
        edits, looks = self._painter.changes(before, np.where(self._after < 0, before, self._after))
        by_edit = np.zeros(len(before), np.int64)
        by_edit[edits] = looks
        return by_edit

    def _numbers(self, scene: Scene) -> list[int]:
        return [self._tables.numbers[box.items] for box in scene.boxes]

    def start(self, which: Int64Array, tasks: Int64Array) -> None:
        self._block.task[which] = tasks
        self._block.steps[which] = 0
        before, after = self._boxes.take(which, axis=0), self._starts.take(tasks, axis=0)
        rows, boxes = np.nonzero(before != after)
        changes, looks = self._painter.changes(before[rows, boxes], after[rows, boxes])
        self._painter.paint(which[rows[changes]], boxes[changes], looks)
        self._boxes[which] = after

    def step(self, which: Int64Array | None) -> None:
        block, tables = self._block, self._tables
        chosen = slice(None) if which is None else which
        which = self._every if which is None else which
        actions = block.action[chosen]
        boxes, edits = tables.action_box.take(actions), tables.action_edit.take(actions)
        rows = which * BOX_COUNT + boxes
        moves = self._flat_boxes.take(rows) * tables.after.shape[1] + edits
        after = self._after.take(moves)
        situations = EDIT_SITUATIONS.take(after >= 0)
        stops = (actions == 0).nonzero()[0]
        if len(stops):
            situations[stops] = np.where(self._solved(which[stops]), RIGHT_STOP, WRONG_STOP)
        steps = block.steps[chosen] + 1
        verdicts = 2 * situations + (steps >= self._dynamics.horizon)
        block.steps[chosen] = steps
        block.verdict[chosen] = verdicts
        block.invalid[chosen] = np.where(situations == INVALID_EDIT, _REASONS.take(edits), NO_REASON)
        applied = self._applies.take(verdicts).nonzero()[0]
        looks = self._looks.take(moves.take(applied))
        self._painter.paint(which.take(applied), boxes.take(applied), looks)
        self._flat_boxes[rows.take(applied)] = after.take(applied)

    def _solved(self, numbers: Int64Array) -> list[bool]:
        """(k,) whether STOP succeeds in environments."""
        tasks, boxes = self._block.task.take(numbers).tolist(), self._boxes.take(numbers, axis=0).tolist()
        return [self._tasks[task].solved_by(self._scene(*there)) for task, there in zip(tasks, boxes, strict=True)]

    def _scene(self, left: int, middle: int, right: int) -> Scene:
        boxes = self._tables.boxes
        return Scene((boxes[left], boxes[middle], boxes[right]))

    def write_masks(self) -> None:
        left, middle, right = self._tables.heights[self._boxes].T
        self._block.mask[:] = self._tables.legal[left, middle, right]

    def write_goals(self) -> None:
        self._block.goal[:] = self._solved(self._every)

    def write_items(self) -> None:
        items = self._block.items
        items[:] = _tower_items(items.shape[2])[self._boxes]

    def state(self, number: int) -> State:
        block = self._block
        return State(
            self._tasks[block.task[number]], self._scene(*self._boxes[number].tolist()), int(block.steps[number])
        )


@cache
def _tower_items(capacity: int) -> Int16Array:
    """(121, capacity, 5) `item_array` of each box."""
    empty = Box()
    return np.stack([item_array(Scene((box, empty, empty)), capacity)[0] for box in tower_tables().boxes])


class _TowerPainter:
    """Keeps images equal to `draw`, block by block.

    A level of a tower is as wide as its picture's columns and shares no row with another, so an image is a grid
    of cells one block wide and one row high, and a level of a box is some cells below one another.
    """

    def __init__(self, images: UInt8Array, image_size: str) -> None:
        """Makes the images (N, height, width, 3) show empty scenes."""
        images[:] = draw(Scene.empty(), image_size)
        shrink = shrink_of(image_size)
        side = Size.MEDIUM.pixels // shrink
        cell = np.dtype((np.void, 3 * side))
        count, height, width, _ = images.shape
        self._cells = images.reshape(count, height * width * 3).view(cell).reshape(-1)
        self._per_row = width // side
        self._per_image = height * self._per_row
        self._columns = (BOX_PITCH * np.arange(BOX_COUNT) + BLOCK_X) // shrink // side  # (3,) by box
        rows, looks = _level_cells(image_size, cell)
        # Both by level and look, none or a colour, as one number: (16, rows) the cells from the image's first to each
        # row's first, and what is there.
        self._rows = (rows * self._per_row).repeat(1 + len(Colour), axis=0)
        self._looks = looks.reshape(-1, looks.shape[-1])
        self._colours = tower_tables().colours + 1  # (121, 4) by level: none, or a colour

    def changes(self, before: Int64Array, after: Int64Array) -> tuple[Int64Array, Int64Array]:
        """What differs between boxes with numbers (k,) and with numbers (k,).

        Two arrays, an entry for each level that differs: which of the k, and what to show.
        """
        colours = self._colours.take(after, axis=0)
        changes, levels = (self._colours.take(before, axis=0) != colours).nonzero()
        return changes, levels * (1 + len(Colour)) + colours[changes, levels]

    def paint(self, which: Int64Array, boxes: Int64Array, looks: Int64Array) -> None:
        """Shows levels (k,) of boxes (k,) of environments (k,) as `changes` tells."""
        first = which * self._per_image + self._columns.take(boxes)
        self._cells[first[:, None] + self._rows.take(looks, axis=0)] = self._looks.take(looks, axis=0)


def _level_cells(image_size: str, cell: np.dtype[np.void]) -> tuple[Int64Array, NDArray[Any]]:
    """(4, rows) the image rows of each level, and (4, 4, rows) the cells there by level and colour, none first.

    A level with fewer rows than another repeats its last one.
    """
    shrink = shrink_of(image_size)
    side = cell.itemsize // 3
    tops = [y // shrink for y in LEVEL_Y]
    bottoms = [-(-(y + Size.MEDIUM.pixels) // shrink) for y in LEVEL_Y]
    most = max(bottom - top for top, bottom in zip(tops, bottoms, strict=True))
    rows = np.array(
        [[min(top + k, bottom - 1) for k in range(most)] for top, bottom in zip(tops, bottoms, strict=True)]
    )
    left = BLOCK_X // shrink
    looks = np.zeros((len(LEVEL_Y), 1 + len(Colour), most, side, 3), np.uint8)
    for level, y in enumerate(LEVEL_Y):
        for look, items in enumerate([[], *([Item(BLOCK_X, y, Shape.SQUARE, c, Size.MEDIUM)] for c in Colour)]):
            looks[level, look] = draw(Scene.of(items, [], []), image_size)[rows[level], left : left + side]
    return rows, looks.reshape(*looks.shape[:3], -1).view(cell)[..., 0]
