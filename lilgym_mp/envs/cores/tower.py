"""The compiled core of Tower: each box is one of the 121 stacks of `appearances.tower.geometry`, by index."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lilgym_mp.envs.buffers import REASON_INDICES, Buffers
from lilgym_mp.envs.cores import kernels
from lilgym_mp.envs.cores.compiled import CompiledCore, item_code
from lilgym_mp.envs.cores.kernels import NO_ITEM, TowerEdits
from lilgym_mp.envs.cores.program_evaluator import StackBoxLowering
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_COUNT, Scene
from lilgym_mp.scene.appearances.tower.geometry import EDIT_REASONS, tower_tables
from lilgym_mp.scene.arrays import BoolArray, Int64Array


class TowerCore(CompiledCore):
    """A core that keeps the stack index of each box, and takes `Scene` objects from the appearance's shared boxes."""

    def __init__(self, dynamics: Dynamics, tasks: Sequence[Task], buffers: Buffers, image_size: str) -> None:
        tables = self._tables = tower_tables()
        super().__init__(dynamics, tasks, buffers, image_size, StackBoxLowering(tables.boxes))
        self._edits = TowerEdits(
            boxes=tables.action_box,
            edits=tables.action_edit,
            after=tables.after,
            tops=np.array([item_code(box.items[-1]) if box.items else NO_ITEM for box in tables.boxes]),
            heights=tables.heights,
            reasons=np.array([REASON_INDICES[reason] for reason in EDIT_REASONS]),
        )
        self._by_env = self._stacks.reshape(-1, BOX_COUNT)
        self._start_stacks = np.array([self._stacks_of(task.start) for task in tasks])
        self._prepare_edits(kernels.edit_tower_scenes)

    def _stacks_of(self, scene: Scene) -> list[int]:
        return [self._tables.indices[box.items] for box in scene.boxes]

    def set_task(self, index: int, task: Task) -> None:
        super().set_task(index, task)
        self._start_stacks[index] = self._stacks_of(task.start)

    def _start_episodes(self, env_ids: Int64Array, tasks: Int64Array) -> None:
        super()._start_episodes(env_ids, tasks)
        self._by_env[env_ids] = self._start_stacks[tasks]

    def _edit(self, env_ids: Int64Array, actions: Int64Array, applies: BoolArray) -> Int64Array:
        reasons = np.empty(len(env_ids), np.int64)
        kernels.edit_tower_scenes(
            self._edits, self._drawing, self._current, self._stacks, env_ids, actions, applies, reasons
        )
        return reasons

    def _scenes_of(self, env_ids: Int64Array) -> list[Scene]:
        boxes = self._tables.boxes
        stacks = self._by_env[env_ids].tolist()
        return [Scene((boxes[left], boxes[middle], boxes[right])) for left, middle, right in stacks]

    def write_masks(self) -> None:
        left, middle, right = self._tables.heights[self._by_env].T
        self._buffers.mask[:] = self._tables.legal[left, middle, right]
