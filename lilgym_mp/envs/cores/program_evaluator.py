"""Evaluates tasks' programs on the arrays of a compiled core, without making `Scene` objects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cache

import numpy as np

from lilgym_mp.envs.cores import kernels
from lilgym_mp.envs.cores.kernels import BITS, UNKNOWN, Programs, Scenes
from lilgym_mp.envs.fast.box_functions import ITEM_TESTS, BoxFunction, ItemTest
from lilgym_mp.envs.fast.instructions import MAX_INSTRUCTIONS, Instruction, Operation, Unsupported, instructions
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.errors import FallbackError
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_SIDE, Box, Colour, Item, Shape, Size
from lilgym_mp.scene.appearances.scatter.actions import ITEM_TYPES
from lilgym_mp.scene.arrays import BoolArray, Int64Array

# Sentinels instead of a program's index
NOT_COMPILED = -1
UNSUPPORTED = -2


class BoxLowering(ABC):
    """Compiles functions of a box to instructions for a core's representation of boxes."""

    def __init__(self) -> None:
        self.places: Int64Array = np.zeros((len(Size), BOX_SIDE, BOX_SIDE), np.int64)  # `kernels.Programs.places`
        self.tables: Int64Array = np.empty((0, 0), np.int64)  # `kernels.Programs.tables`
        self._indices: dict[BoxFunction, int] = {}  # bits in `places`, or indices in `tables`

    @abstractmethod
    def lower_box_function(self, function: BoxFunction, box: int) -> Instruction:
        """The instruction that evaluates a function of one box, as `envs.fast.instructions.LowerBoxFunction`."""


class ArrayProgramEvaluator:
    """Evaluates the programs of tasks; compiles each to instructions on first use."""

    def __init__(self, tasks: Sequence[Task], boxes: BoxLowering) -> None:
        self._tasks = tasks
        self._boxes = boxes
        self._values = np.empty(MAX_INSTRUCTIONS, np.int64)
        self._forget_all()

    def _forget_all(self) -> None:
        boxes = self._boxes
        self._by_task = np.full(len(self._tasks), NOT_COMPILED)  # indices of programs
        self._by_source: dict[str, int] = {}
        self._programs = Programs(np.empty((0, 3), np.int64), np.zeros(1, np.int64), boxes.places, boxes.tables)

    def forget(self, task: int) -> None:
        """Must be called when a task has been replaced."""
        self._by_task[task] = NOT_COMPILED
        if len(self._by_source) > 2 * len(self._tasks):  # mostly of replaced tasks
            self._forget_all()

    def evaluate(
        self, scenes: Scenes, stacks: Int64Array, env_ids: Int64Array, tasks: Int64Array, truths: Int64Array
    ) -> int:
        """Writes 0, 1 or UNKNOWN into `truths` (k,) for the programs of tasks (k,) in environments (k,).

        Returns the number of UNKNOWN.
        """
        programs = self._by_task.take(tasks)
        unknown = kernels.evaluate_programs(self._programs, scenes, stacks, env_ids, programs, self._values, truths)
        if unknown and NOT_COMPILED in programs:
            self._compile_tasks(tasks[programs == NOT_COMPILED].tolist())
            programs = self._by_task.take(tasks)
            unknown = kernels.evaluate_programs(self._programs, scenes, stacks, env_ids, programs, self._values, truths)
        return unknown

    def _compile_tasks(self, tasks: list[int]) -> None:
        for index in tasks:
            task = self._tasks[index]
            if task.other_goal is not None:  # success does not depend on the program alone
                self._by_task[index] = UNSUPPORTED
                continue
            if task.program not in self._by_source:
                self._by_source[task.program] = self._compile(task.program)
            self._by_task[index] = self._by_source[task.program]

    def _compile(self, source: str) -> int:
        """Appends a program's instructions to `_programs`; returns its index, or UNSUPPORTED."""
        written = instructions(compile_program(source).tree, self._boxes.lower_box_function)
        if written is None:
            return UNSUPPORTED
        rows = np.concatenate([self._programs.rows, np.array(written, np.int64)])
        ends = np.append(self._programs.ends, len(rows))
        self._programs = Programs(rows, ends, self._boxes.places, self._boxes.tables)
        return len(ends) - 2


class ItemBoxLowering(BoxLowering):
    """For boxes stored as rows of items: supports tests of single items."""

    def lower_box_function(self, function: BoxFunction, box: int) -> Instruction:
        test = ITEM_TESTS.get(function)
        if test is not None and test.depends_on == "attributes":
            passing = [test.passes(Item(0, 0, *fields)) for fields in ITEM_TYPES]
            return Instruction(
                Operation.ITEM_TYPE_TEST, sum(1 << index for index, passes in enumerate(passing) if passes), box
            )
        if test is None or test.depends_on != "position":
            raise Unsupported
        if function not in self._indices:
            self._keep(function, test)
        return Instruction(Operation.POSITION_TEST, self._indices[function], box)

    def _keep(self, function: BoxFunction, test: ItemTest) -> None:
        bit = len(self._indices)
        if bit == BITS:
            raise Unsupported
        self.places |= _passing_places(test).astype(np.int64) << bit
        self._indices[function] = bit


@cache
def _passing_places(test: ItemTest) -> BoolArray:
    """(sizes, x, y) whether an item of each size passes a test of its position."""
    passing = np.zeros((len(Size), BOX_SIDE, BOX_SIDE), np.bool_)
    for size in Size:
        places = range(BOX_SIDE - size.pixels + 1)
        passing[size, : len(places), : len(places)] = [
            [test.passes(Item(x, y, Shape.SQUARE, Colour.BLACK, size)) for y in places] for x in places
        ]
    return passing


class StackBoxLowering(BoxLowering):
    """For boxes stored as stacks of Tower: tabulates any function of a box over the 121 stacks."""

    def __init__(self, boxes: Sequence[Box]) -> None:
        super().__init__()
        self.tables = np.empty((0, len(boxes)), np.int64)
        self._boxes = boxes

    def lower_box_function(self, function: BoxFunction, box: int) -> Instruction:
        if function not in self._indices:
            values = [_value(function, each) for each in self._boxes]
            self.tables = np.concatenate([self.tables, np.array([values], np.int64)])
            self._indices[function] = len(self._indices)
        return Instruction(Operation.BOX_TABLE, self._indices[function], box)


def _value(function: BoxFunction, box: Box) -> int:
    try:
        value = function(box)
    except FallbackError:
        return UNKNOWN
    if not isinstance(value, int):  # rows of a relation
        raise Unsupported
    return value
