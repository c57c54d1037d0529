"""The engine of a batch: draws tasks, resets environments as the autoreset mode says, and steps them with a core.

It is the same in one process and in many: an environment's results depend only on its own seed and actions.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode

from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.buffers import NO_REASON, ArraySpec, Buffers, buffer_specs
from lilgym_mp.envs.checks import checked_flag
from lilgym_mp.envs.config import SingleConfig
from lilgym_mp.envs.cores import make_core
from lilgym_mp.envs.observation import FORMS, item_capacity
from lilgym_mp.envs.rules import ActionStatus, State
from lilgym_mp.envs.sampling import checked_task, next_draws
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.arrays import AnyMapping, Int64Array, Rng
from lilgym_mp.scene.choices import checked_count, choose

AUTORESET_MODES = {mode.value: mode for mode in AutoresetMode}
NO_ACTION = 2 * len(ActionStatus)  # sentinel in `Buffers.result`: the environment was reset and took no action


@dataclass(frozen=True, kw_only=True)
class BatchSettings(SingleConfig):
    """The configuration of a batch. Picklable."""

    num_envs: int = 1
    autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP  # or its name
    evaluation: bool = False  # plays every task of the split once instead of random tasks

    def __post_init__(self) -> None:
        """Raises ValueError naming the value and the choices, CorpusError (a ValueError) for unusable data."""
        super().__post_init__()
        object.__setattr__(self, "num_envs", checked_count("num_envs", self.num_envs))
        if not isinstance(self.autoreset_mode, AutoresetMode):
            object.__setattr__(self, "autoreset_mode", choose("autoreset_mode", self.autoreset_mode, AUTORESET_MODES))
        if checked_flag("evaluation", self.evaluation) and self.sampler is not None:
            raise ValueError("evaluation=True plays every task of the split once; leave out sampler")
        choose("observation", self.observation, FORMS)
        self.array_specs()

    def identity(self) -> str:
        """The scenes, the kind of start and the rules, which batches that exchange states must share."""
        dynamics = self.dynamics()
        grid = dynamics.appearance.grid
        return f"{self.appearance}, grid={grid}, start={self.start!r}, rules={self.rules!r}, horizon={dynamics.horizon}"

    def array_specs(self) -> dict[str, ArraySpec]:
        """Shape and dtype of each of the buffers' arrays."""
        dynamics = self.dynamics()
        capacity = item_capacity(self.tasks(), dynamics)
        return buffer_specs(
            self.num_envs, self.image_size, dynamics.appearance.action_count, capacity, self.autoreset_mode
        )


NewTasks = dict[int, Task]  # tasks that are not of the batch's TaskSet, by the index they got
# Columns of `Buffers` that snapshots hold
SAVED = ("action", "steps", "result", "invalid", "ended", "started", "repeated", "evaluated")


class EnvSnapshot(NamedTuple):
    """One environment of a batch at one time. Picklable."""

    state: State
    row: AnyMapping  # of SAVED
    generator: Rng | None
    drawn: tuple[int, ...]
    episodes: int
    repeats: bool
    identity: str  # `BatchSettings.identity` of the batch


def with_room(tasks: TaskSet, num_envs: int) -> list[Task]:
    """The tasks, and room for two new ones for each environment."""
    return [*tasks, *([tasks[0]] * (2 * num_envs))]


class ResetRequest(NamedTuple):
    """Which environments to reset, and how."""

    env_ids: Int64Array  # (k,) environments, ascending
    seeds: Sequence[int | None]  # (k,) None: keep the generator
    tasks: Sequence[int | Task | None]  # (k,) task indices, or tasks of the caller; None: the next task
    all_envs: bool  # whether the whole batch is reset without a mask, which restarts an evaluation

    def part(self, first: int, stop: int) -> ResetRequest:
        """The request for environments first .. stop - 1, with env ids relative to `first`."""
        low, high = np.searchsorted(self.env_ids, [first, stop]).tolist()
        return ResetRequest(self.env_ids[low:high] - first, self.seeds[low:high], self.tasks[low:high], self.all_envs)


class Engine:
    """Steps environments `first` .. `first + N - 1` of a batch, over their slice of its buffers."""

    def __init__(self, settings: BatchSettings, buffers: Buffers, first: int = 0) -> None:
        self.dynamics = settings.dynamics()
        self.buffers = buffers
        self._image_size = settings.image_size
        self._first = first
        self._stride = settings.num_envs
        self.set_tasks(settings.tasks())
        self._autoreset = settings.autoreset_mode
        self._evaluation = settings.evaluation
        self._sampler = settings.sampler
        self._identity = settings.identity()
        count = len(buffers.action)
        self._ends = np.array([*(result.ends for result in self.dynamics.step_results), False])  # by `Buffers.result`
        self._generators: list[Rng | None] = [None] * count
        self._drawn: list[list[int]] = [[] for _ in range(count)]  # indices of the next tasks, in reverse
        self._episodes = np.zeros(count, np.int64)  # number of tasks started in the evaluation
        self._repeats = np.zeros(count, bool)  # whether the current episode's task was evaluated before
        self._use_second = np.zeros(count, bool)  # which of its two indices an environment uses next for a new task

    def set_tasks(self, tasks: TaskSet) -> None:
        """Replaces the tasks; all environments must be reset next."""
        self.tasks = tasks
        self._task_count = len(tasks)
        self._new_tasks: NewTasks = {}  # in this call
        self.core = make_core(self.dynamics, with_room(tasks, self._stride), self.buffers, self._image_size)

    def reset(self, request: ResetRequest) -> NewTasks | None:
        """Starts episodes in some environments of the batch; the others keep their state.

        This and `step` return the tasks that came from callers or a sampler, None if there can be none.
        """
        buffers = self.buffers
        env_ids, seeds, tasks, all_envs = request.part(self._first, self._first + len(buffers.action))
        buffers.started[:] = False
        for env_id, seed in zip(env_ids.tolist(), seeds, strict=True):
            if seed is not None or self._generators[env_id] is None:
                self.seed(env_id, seed)
        if all_envs:
            self._episodes[:] = buffers.evaluated[:] = 0
        task_indices = [
            self._next_task(env_id) if task is None else self._index(env_id, task)
            for env_id, task in zip(env_ids.tolist(), tasks, strict=True)
        ]
        self._start_episodes(env_ids, task_indices)
        buffers.result[env_ids] = NO_ACTION
        buffers.invalid[env_ids] = NO_REASON
        buffers.ended[env_ids] = False
        return self._taken_tasks(always=Task in set(map(type, request.tasks)))

    def seed(self, env_id: int, seed: int | None) -> None:
        """Gives an environment a new generator, from which its next task is drawn."""
        self._generators[env_id] = seeding.np_random(seed)[0]
        self._drawn[env_id].clear()

    def step(self) -> NewTasks | None:
        """Takes `buffers.action` in every environment, and resets as the autoreset mode says."""
        buffers = self.buffers
        buffers.started[:] = False
        waiting = buffers.ended.nonzero()[0]
        if self._autoreset is AutoresetMode.NEXT_STEP and len(waiting):
            self.core.step((~buffers.ended).nonzero()[0])
            self._start_next_episodes(waiting)
            buffers.result[waiting] = NO_ACTION
            buffers.invalid[waiting] = NO_REASON
        else:
            self.core.step(None)
        self._ends.take(buffers.result, out=buffers.ended)
        if self._evaluation:
            np.logical_and(buffers.ended, self._repeats, out=buffers.repeated)
            buffers.evaluated += buffers.ended & ~self._repeats
        ended = buffers.ended.nonzero()[0]
        if self._autoreset is AutoresetMode.SAME_STEP and len(ended):
            for env_id in ended.tolist():  # fancy indexing would copy each image twice
                buffers.last_image[env_id] = buffers.image[env_id]
            buffers.last_task[ended] = buffers.task[ended]
            buffers.last_steps[ended] = buffers.steps[ended]
            self.core.write_items()
            buffers.last_items[ended] = buffers.items[ended]
            self._start_next_episodes(ended)
        return self._taken_tasks(always=False)

    def _taken_tasks(self, *, always: bool) -> NewTasks | None:
        taken = self._new_tasks
        self._new_tasks = {}
        return taken if always or self._sampler is not None else None

    def _start_next_episodes(self, env_ids: Int64Array) -> None:
        self._start_episodes(env_ids, [self._next_task(env_id) for env_id in env_ids.tolist()])

    def _start_episodes(self, env_ids: Int64Array, tasks: Sequence[int]) -> None:
        self.core.start(env_ids, np.array(tasks, np.int64))
        self.buffers.started[env_ids] = True

    def _next_task(self, env_id: int) -> int:
        """The sampler's, or a random task; in evaluation tasks `g`, `g + stride`, ... for environment `g` of the batch,
        the last of them for the last environments, as Stable-Baselines3 counts."""
        global_id = self._first + env_id
        if not self._evaluation:
            drawn = self._drawn[env_id]
            if self._sampler is None and drawn:
                return drawn.pop()
            generator = self._generators[env_id]
            assert generator is not None
            if self._sampler is not None and (choice := self._sampler(generator, global_id)) is not None:
                if isinstance(choice, Task):
                    return self._index(env_id, checked_task(choice, self.dynamics, self.buffers.items.shape[2]))
                return self.tasks.index_of(choice)
            if not drawn:
                drawn.extend(next_draws(generator, self._task_count))
            return drawn.pop()
        left = self._task_count - self._stride * int(self._episodes[env_id])
        self._episodes[env_id] += 1
        self._repeats[env_id] = global_id < self._stride - left
        if self._repeats[env_id]:
            return global_id % self._task_count
        return global_id + self._task_count - max(left, self._stride)

    def _index(self, env_id: int, task: int | Task) -> int:
        """The index of a task; a new one gets one of the environment's two: the other may be its last episode's."""
        if not isinstance(task, Task):
            return task
        if (index := self.tasks.find(task)) is not None:
            return index
        index = self._task_count + 2 * (self._first + env_id) + int(self._use_second[env_id])
        self._use_second[env_id] ^= True
        self.core.set_task(index, task)
        self._new_tasks[index] = task
        return index

    def write_masks(self) -> None:
        """Writes the masks of legal actions of all environments into the buffers."""
        self.core.write_masks()

    def write_goals(self) -> None:
        """Writes into the buffers whether stopping now would succeed."""
        self.core.write_goals()

    def write_items(self) -> None:
        """Writes the items of all scenes into the buffers."""
        self.core.write_items()

    def save(self) -> list[EnvSnapshot]:
        """A snapshot of each environment, which does not change."""
        columns = {name: getattr(self.buffers, name).tolist() for name in SAVED}
        return [
            EnvSnapshot(
                state,
                {name: column[env_id] for name, column in columns.items()},
                deepcopy(self._generators[env_id]),
                tuple(self._drawn[env_id]),
                int(self._episodes[env_id]),
                bool(self._repeats[env_id]),
                self._identity,
            )
            for env_id, state in enumerate(self.states())
        ]

    def restore(self, snapshots: Sequence[EnvSnapshot]) -> NewTasks | None:
        """Continues from snapshots (stride,), one for each environment of the batch."""
        buffers = self.buffers
        for env_id in range(len(buffers.action)):
            state, row, generator, drawn, episodes, repeats, _ = snapshots[self._first + env_id]
            # A task that starts in the scene, for the core; then the task itself.
            start = self._index(env_id, replace(state.task, start=state.scene))
            self.core.start(np.array([env_id]), np.array([start]))
            buffers.task[env_id] = self._index(env_id, state.task)
            for name in SAVED:
                getattr(buffers, name)[env_id] = row[name]
            self._generators[env_id] = deepcopy(generator)
            self._drawn[env_id] = list(drawn)
            self._episodes[env_id] = episodes
            self._repeats[env_id] = repeats
        return self._taken_tasks(always=True)

    def states(self) -> list[State]:
        """The current state of each environment."""
        return [self.core.state(env_id) for env_id in range(len(self.buffers.action))]
