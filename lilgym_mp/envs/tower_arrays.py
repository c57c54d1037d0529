"""Many towers at once: a core whose boxes are numbers, over the tables that the Tower appearance itself reads."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances.tower import BLOCK_X, EDIT_REASONS, LEVEL_Y, tower_tables
from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.block import (
    INVALID_EDIT,
    NO_REASON,
    REASON_NUMBERS,
    RIGHT_STOP,
    VALID_EDIT,
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
        self._painter = _TowerPainter(block.image, image_size)

    def _numbers(self, scene: Scene) -> list[int]:
        return [self._tables.numbers[box.items] for box in scene.boxes]

    def start(self, which: Int64Array, tasks: Int64Array) -> None:
        self._block.task[which] = tasks
        self._block.steps[which] = 0
        before, after = self._boxes[which], self._starts[tasks]
        rows, boxes = np.nonzero(before != after)
        self._painter.paint(which[rows], boxes, before[rows, boxes], after[rows, boxes])
        self._boxes[which] = after

    def step(self, which: Int64Array | None) -> None:
        block, tables = self._block, self._tables
        if which is None:
            which = self._every
            actions = block.action
        else:
            actions = block.action[which]
        boxes, edits = tables.action_box[actions], tables.action_edit[actions]
        before = self._boxes[which, boxes]
        after = tables.after[before, edits]
        situations = np.where(after < 0, INVALID_EDIT, VALID_EDIT)
        for place in (actions == 0).nonzero()[0].tolist():
            solved = self._solved(int(which[place]))
            situations[place] = RIGHT_STOP if solved else WRONG_STOP
        steps = block.steps[which] + 1
        verdicts = 2 * situations + (steps >= self._dynamics.horizon)
        block.steps[which] = steps
        block.verdict[which] = verdicts
        block.invalid[which] = np.where(situations == INVALID_EDIT, _REASONS[edits], NO_REASON)
        applied = self._applies[verdicts].nonzero()[0]
        which, boxes, after = which[applied], boxes[applied], after[applied]
        self._painter.paint(which, boxes, before[applied], after)
        self._boxes[which, boxes] = after

    def _solved(self, number: int) -> bool:
        return self._tasks[self._block.task[number]].solved_by(self._scene(number))

    def _scene(self, number: int) -> Scene:
        left, middle, right = self._boxes[number].tolist()
        boxes = self._tables.boxes
        return Scene((boxes[left], boxes[middle], boxes[right]))

    def write_masks(self) -> None:
        left, middle, right = self._tables.heights[self._boxes].T
        self._block.mask[:] = self._tables.legal[left, middle, right]

    def write_goals(self) -> None:
        self._block.goal[:] = [self._solved(number) for number in range(len(self._boxes))]

    def write_items(self) -> None:
        items = self._block.items
        items[:] = _tower_items(items.shape[2])[self._boxes]

    def state(self, number: int) -> State:
        block = self._block
        return State(self._tasks[block.task[number]], self._scene(number), int(block.steps[number]))


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
        self._rows = rows * self._per_row  # (4, rows) by level: cells from the image's first to each row's first
        self._looks = looks.reshape(-1, looks.shape[-1])  # (4 levels * 4 looks, rows)
        self._colours = tower_tables().colours + 1  # (121, 4) by level: none, or a colour

    def paint(self, which: Int64Array, boxes: Int64Array, before: Int64Array, after: Int64Array) -> None:
        """Boxes (k,) of environments (k,) turn from numbers (k,) into numbers (k,)."""
        colours = self._colours.take(after, axis=0)
        changes, levels = (self._colours.take(before, axis=0) != colours).nonzero()
        first = which[changes] * self._per_image + self._columns[boxes[changes]]
        places = first[:, None] + self._rows.take(levels, axis=0)
        looks = levels * (1 + len(Colour)) + colours[changes, levels]
        self._cells[places] = self._looks.take(looks, axis=0)


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
