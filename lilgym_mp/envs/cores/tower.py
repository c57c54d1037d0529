"""The compiled core of Tower: each box is one of the 121 stacks of `appearances.tower`, by index."""

from __future__ import annotations

import numpy as np

from lilgym_mp.appearances.tower import EDIT_REASONS, tower_tables
from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.buffers import REASON_NUMBERS, Buffers
from lilgym_mp.envs.cores import kernels
from lilgym_mp.envs.cores.compiled import CompiledCore, number_of
from lilgym_mp.envs.cores.kernels import NO_ITEM, TowerEdits, compiling
from lilgym_mp.envs.cores.truths import StackBoxes
from lilgym_mp.rules import Dynamics
from lilgym_mp.scene import BOX_COUNT, Scene


class TowerCore(CompiledCore):
    """Scenes are made of the appearance's shared boxes."""

    def __init__(self, dynamics: Dynamics, tasks: TaskSet, buffers: Buffers, image_size: str) -> None:
        tables = self._tables = tower_tables()
        super().__init__(dynamics, tasks, buffers, image_size)
        self._edits = TowerEdits(
            boxes=tables.action_box,
            edits=tables.action_edit,
            after=tables.after,
            tops=np.array([number_of(box.items[-1]) if box.items else NO_ITEM for box in tables.boxes]),
            heights=tables.heights,
            reasons=np.array([REASON_NUMBERS[reason] for reason in EDIT_REASONS]),
        )
        self._by_env = self._stacks.reshape(-1, BOX_COUNT)
        self._start_stacks = np.array([[tables.numbers[box.items] for box in task.start.boxes] for task in tasks])
        with compiling(kernels.edit_towers):
            self._edit(self._every[:0], self._every[:0], np.zeros(0, np.bool_))

    def _begin(self, env_ids: Int64Array, tasks: Int64Array) -> None:
        super()._begin(env_ids, tasks)
        self._by_env[env_ids] = self._start_stacks[tasks]

    def _edit(self, env_ids: Int64Array, actions: Int64Array, applies: BoolArray) -> Int64Array:
        reasons = np.empty(len(env_ids), np.int64)
        kernels.edit_towers(
            self._edits, self._painting, self._current, self._stacks, env_ids, actions, applies, reasons
        )
        return reasons

    def _scenes_of(self, env_ids: Int64Array) -> list[Scene]:
        boxes = self._tables.boxes
        stacks = self._by_env[env_ids].tolist()
        return [Scene((boxes[left], boxes[middle], boxes[right])) for left, middle, right in stacks]

    def _boxes(self) -> StackBoxes:
        return StackBoxes(self._tables.boxes)

    def write_masks(self) -> None:
        left, middle, right = self._tables.heights[self._by_env].T
        self._buffers.mask[:] = self._tables.legal[left, middle, right]
