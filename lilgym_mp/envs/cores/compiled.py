"""The base class of compiled cores: scenes as arrays of encoded items, and their images."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from lilgym_mp.envs.buffers import NO_REASON, Buffers
from lilgym_mp.envs.cores import kernels
from lilgym_mp.envs.cores.base import CORRECT_STOP, INVALID_EDIT, VALID_EDIT, WRONG_STOP, Core
from lilgym_mp.envs.cores.kernels import NO_ITEM, UNKNOWN, DrawingTables, Scenes, StartScenes, compiling
from lilgym_mp.envs.cores.program_evaluator import ArrayProgramEvaluator, BoxLowering
from lilgym_mp.envs.observation import EMPTY
from lilgym_mp.envs.rules import Dynamics, result_index
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, Item, Scene
from lilgym_mp.scene.appearances.scatter.actions import (
    ITEM_TYPE_COUNT,
    ITEM_TYPE_FOOTPRINTS,
    ITEM_TYPE_INDICES,
    ITEM_TYPES,
)
from lilgym_mp.scene.arrays import BoolArray, Int64Array
from lilgym_mp.scene.render import draw, image_shape, shrink_of
from lilgym_mp.scene.render.drawing import LARGEST_PATCH, palette, stamp

_EDIT_STATUS = np.array([INVALID_EDIT, VALID_EDIT])  # indexed by whether the edit is valid
_STOP_STATUS = np.array([WRONG_STOP, CORRECT_STOP])  # indexed by whether the target is reached
NO_VERSION = -2  # older than any version by more than one added item
_ITEM_TYPE_FIELDS = np.array(ITEM_TYPES, np.int16)


class CompiledCore(Core):
    """A core whose scenes are `kernels.Scenes`; subclasses implement the edits of an appearance."""

    def __init__(
        self, dynamics: Dynamics, tasks: Sequence[Task], buffers: Buffers, image_size: str, lowering: BoxLowering
    ) -> None:
        """`lowering`: how functions of a box are compiled to instructions."""
        super().__init__(dynamics, tasks, buffers)
        results = dynamics.step_results
        self._applies = np.array([results[result_index(VALID_EDIT, last=last)].applies for last in (False, True)])
        rows = BOX_COUNT * len(buffers.action)
        capacity = buffers.items.shape[2]
        side = BOX_SIDE // shrink_of(image_size)
        self._image_size = image_size
        self._drawing = _drawing(image_size)
        self._current = Scenes(
            items=np.full((rows, capacity), NO_ITEM),
            counts=np.zeros(rows, np.int64),
            versions=np.zeros(rows, np.int64),
            weighted=np.zeros((rows, side, side), np.uint8),
            images=buffers.image.reshape(len(buffers.image), -1),
            is_unfit=np.zeros(len(buffers.image), bool),
        )
        self._starts = StartScenes(
            items=np.full((BOX_COUNT * len(tasks), capacity), NO_ITEM),
            counts=np.zeros(BOX_COUNT * len(tasks), np.int64),
            is_unfit=np.zeros(len(tasks), bool),
        )
        self._has_start = [False] * len(tasks)  # whether the task's start scene is in `_starts`
        self._written_items = np.full(rows, NO_VERSION)  # versions of boxes as of `buffers.items`
        self._stacks = np.zeros(rows, np.int64)  # Tower: stack index by row
        self._evaluator = ArrayProgramEvaluator(self._tasks, lowering)
        self._targets = np.array([task.target for task in tasks], np.int64)
        none = self._all_env_ids[:0]
        with compiling(kernels.start_episodes):
            kernels.start_episodes(self._drawing, self._current, self._starts, none, none)
        with compiling(kernels.evaluate_programs):
            self._evaluator.evaluate(self._current, self._stacks, none, none, none)

    def _prepare_edits(self, kernel: Any) -> None:
        """Loads or compiles the kernel that `_edit` calls."""
        none = self._all_env_ids[:0]
        with compiling(kernel):
            self._edit(none, none, np.zeros(0, bool))

    def set_task(self, index: int, task: Task) -> None:
        super().set_task(index, task)
        self._has_start[index] = False
        self._targets[index] = task.target
        self._evaluator.forget(index)

    def step(self, env_ids: Int64Array | None) -> None:
        buffers = self._buffers
        chosen = slice(None) if env_ids is None else env_ids
        env_ids = self._all_env_ids if env_ids is None else env_ids
        actions = buffers.action[chosen]
        steps = buffers.steps[chosen] + 1
        last = steps >= self.dynamics.horizon
        reasons = self._edit(env_ids, actions, self._applies.take(last))
        status = _EDIT_STATUS.take(reasons == NO_REASON)
        stops = (actions == 0).nonzero()[0]
        if len(stops):
            status[stops] = _STOP_STATUS.take(self._solved(env_ids[stops]))
        buffers.steps[chosen] = steps
        buffers.result[chosen] = result_index(status, last=last)
        buffers.invalid[chosen] = reasons

    @abstractmethod
    def _edit(self, env_ids: Int64Array, actions: Int64Array, applies: BoolArray) -> Int64Array:
        """Makes valid edits where `applies` (k,).

        Returns (k,) why actions are invalid, as in `buffers.invalid`; NO_REASON for valid edits and STOP.
        """

    def _start_episodes(self, env_ids: Int64Array, tasks: Int64Array) -> None:
        for task in tasks.tolist():
            if not self._has_start[task]:
                self._add_start(task)
        kernels.start_episodes(self._drawing, self._current, self._starts, env_ids, tasks)

    def _add_start(self, task: int) -> None:
        for row, box in enumerate(self._tasks[task].start.boxes, BOX_COUNT * task):
            self._starts.counts[row] = len(box.items)
            self._starts.items[row] = NO_ITEM
            self._starts.items[row, : len(box.items)] = [item_code(item) for item in box.items]
        self._has_start[task] = True

    def write_items(self) -> None:
        written = self._buffers.items.reshape(len(self._written_items), *self._buffers.items.shape[2:])
        with compiling(kernels.write_items):
            kernels.write_items(self._current, _ITEM_TYPE_FIELDS, EMPTY, self._written_items, written)

    def _solved(self, env_ids: Int64Array) -> BoolArray:
        tasks = self._buffers.task.take(env_ids)
        truths = np.empty(len(env_ids), np.int64)
        unknown = self._evaluator.evaluate(self._current, self._stacks, env_ids, tasks, truths)
        solved = truths == self._targets.take(tasks)
        if unknown:
            by_scene = truths == UNKNOWN
            solved[by_scene] = super()._solved(env_ids[by_scene])
        return solved


def item_code(item: Item) -> int:
    """The item encoded by `kernels.encode_item`."""
    x, y, shape, colour, size = item
    return kernels.encode_item.py_func(x, y, ITEM_TYPE_INDICES[shape, colour, size])


def item_from_code(code: int) -> Item:
    """The item that `kernels.encode_item` encoded."""
    x, y, item_type = kernels.decode_item.py_func(code)
    return Item(x, y, *ITEM_TYPES[item_type])


@cache
def _drawing(image_size: str) -> DrawingTables:
    shrink = shrink_of(image_size)
    side = LARGEST_PATCH // shrink
    kinds = (ITEM_TYPE_COUNT, 2, 2)
    runs = np.zeros((*kinds, side, 2), np.int64)
    run_counts = np.zeros(kinds, np.int64)
    edges = np.zeros((*kinds, side**2, 3), np.int64)
    edge_counts = np.zeros(kinds, np.int64)
    lines = np.empty((ITEM_TYPE_COUNT + 1, side, 3), np.uint8)
    weights, colours = palette(shrink)
    lines[ITEM_TYPE_COUNT] = colours[0]
    for item_type, (_, colour, _) in enumerate(ITEM_TYPES):
        whole = shrink**2 * weights[colour]
        lines[item_type] = colours[whole]
        for odd_x, odd_y in product((0, 1), repeat=2):
            at = item_type, odd_x, odd_y
            counts = stamp(ITEM_TYPE_FOOTPRINTS[item_type], colour, odd_x, odd_y, shrink).counts
            run_counts[at] = len(counts)
            for row, covered in enumerate(counts == whole):
                if covered.any():
                    runs[*at, row] = covered.argmax(), len(covered) - covered[::-1].argmax()
            ys, xs = ((counts > 0) & (counts < whole)).nonzero()
            edge_counts[at] = len(ys)
            edges[*at, : len(ys)] = np.stack([ys, xs, counts[ys, xs]], axis=1)
    return DrawingTables(
        runs=runs,
        run_counts=run_counts,
        edges=edges[:, :, :, : int(edge_counts.max())].copy(),
        edge_counts=edge_counts,
        lines=lines.reshape(ITEM_TYPE_COUNT + 1, -1),
        colours=colours,
        background=draw(Scene.empty(), image_size).ravel(),
        width=image_shape(image_size)[1],
        shrink=shrink,
    )
