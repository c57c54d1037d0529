"""The base class of cores: one step over arrays of actions and results."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from lilgym_mp.envs.buffers import NO_REASON, Buffers
from lilgym_mp.envs.rules import ActionStatus, Dynamics, State, result_index
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.arrays import BoolArray, Int64Array

# Plain ints for arrays: with enum members NumPy runs Python code, which takes microseconds and can swallow a Ctrl-C.
CORRECT_STOP, WRONG_STOP, INVALID_EDIT, VALID_EDIT = (int(status) for status in ActionStatus)


class Core(ABC):
    """Holds the scenes of N environments and steps them. Reads actions from the buffers and writes results there.

    `engine.Engine` decides when episodes start, and records starts and ends. Step counts are kept in the buffers.
    """

    def __init__(self, dynamics: Dynamics, tasks: Sequence[Task], buffers: Buffers) -> None:
        self.dynamics = dynamics
        self._tasks = list(tasks)
        self._buffers = buffers
        self._all_env_ids = np.arange(len(buffers.action))

    def set_task(self, index: int, task: Task) -> None:
        """Replaces a task that no environment plays."""
        self._tasks[index] = task

    def start(self, env_ids: Int64Array, tasks: Int64Array) -> None:
        """Starts episodes of tasks (k,), by index, in environments (k,)."""
        self._buffers.task[env_ids] = tasks
        self._buffers.steps[env_ids] = 0
        self._start_episodes(env_ids, tasks)

    def wait(self, env_ids: Int64Array) -> None:
        """`rules.Dynamics.wait` for environments (k,)."""
        buffers = self._buffers
        steps = buffers.steps[env_ids] + 1
        buffers.steps[env_ids] = steps
        buffers.result[env_ids] = result_index(VALID_EDIT, last=steps >= self.dynamics.horizon)
        buffers.invalid[env_ids] = NO_REASON

    def state(self, env_id: int) -> State:
        """The state of one environment, as `Dynamics` has it."""
        buffers = self._buffers
        scene = self._scenes_of(np.array([env_id]))[0]
        return State(self._tasks[buffers.task[env_id]], scene, int(buffers.steps[env_id]))

    def write_goals(self) -> None:
        """Updates `buffers.goal` of all environments."""
        self._buffers.goal[:] = self._solved(self._all_env_ids)

    @abstractmethod
    def step(self, env_ids: Int64Array | None) -> None:
        """Takes `buffers.action` in environments (k,), ascending, or in all; `rules.Dynamics.step` for arrays."""

    @abstractmethod
    def write_masks(self) -> None:
        """Updates `buffers.mask` of all environments."""

    @abstractmethod
    def write_items(self) -> None:
        """Updates `buffers.items` of all environments."""

    @abstractmethod
    def _start_episodes(self, env_ids: Int64Array, tasks: Int64Array) -> None:
        """Sets scenes and images of environments (k,) to the start scenes of tasks (k,)."""

    @abstractmethod
    def _scenes_of(self, env_ids: Int64Array) -> Sequence[Scene]:
        """The current scenes of environments (k,)."""

    def _solved(self, env_ids: Int64Array) -> Sequence[bool] | BoolArray:
        """(k,) whether STOP succeeds in environments (k,)."""
        pairs = zip(self._buffers.task[env_ids].tolist(), self._scenes_of(env_ids), strict=True)
        return [self._tasks[task].solved_by(scene) for task, scene in pairs]
