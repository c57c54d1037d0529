"""The engine of a batch: draws tasks, resets environments as the autoreset mode says, and steps them with a core.

It is the same in one process and in many: an environment's results depend only on its own seed and actions.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode

from lilgym_mp.appearances import RELEASED_GRID, Grid, make_appearance
from lilgym_mp.arrays import Int64Array
from lilgym_mp.choices import choose
from lilgym_mp.corpus import TaskSet, load_tasks
from lilgym_mp.corpus.statement_arrays import VocabularyOrPath
from lilgym_mp.envs.buffers import NO_REASON, ArraySpec, Buffers, buffer_specs
from lilgym_mp.envs.checks import check_keywords, checked_count, checked_flag
from lilgym_mp.envs.cores import make_core
from lilgym_mp.envs.single import next_draws
from lilgym_mp.observation import FORMS, TEXT, item_capacity
from lilgym_mp.rules import ActionStatus, Dynamics, State, make_dynamics

AUTORESET_MODES: Mapping[str, AutoresetMode] = {mode.value: mode for mode in AutoresetMode}
NO_ACTION = 2 * len(ActionStatus)  # sentinel in `Buffers.result`: the environment was reset and took no action


@dataclass(frozen=True, kw_only=True)
class BatchSettings:
    """The configuration of a batch: the keywords of `LilGymEnv` and of vector environments. Picklable."""

    num_envs: int
    appearance: str
    start: str
    corpus: str | os.PathLike[str] = "builtin"
    split: str = "train"
    rules: str = "paper"
    horizon: int | None = None
    grid: Grid | str = RELEASED_GRID
    image_size: str = "half"
    autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP
    evaluation: bool = False  # plays every task of the split once instead of random tasks
    observation: str = TEXT  # "text" or "arrays"
    vocabulary: VocabularyOrPath | None = None  # of the form "arrays"; None: the train split's
    length: int | None = None

    @classmethod
    def of(cls, num_envs: int, **given: Any) -> BatchSettings:
        """The settings `given`; the autoreset mode may also be a name.

        Raises ValueError naming the value and the choices, CorpusError (a ValueError) for unusable data.
        """
        check_keywords(given.keys() - {each.name for each in fields(cls)})
        mode = given.get("autoreset_mode", AutoresetMode.NEXT_STEP)
        if not isinstance(mode, AutoresetMode):
            given["autoreset_mode"] = choose("autoreset_mode", mode, AUTORESET_MODES)
        given["corpus"] = os.fspath(given.get("corpus", "builtin"))
        settings = cls(num_envs=checked_count("num_envs", num_envs), **given)
        checked_flag("evaluation", settings.evaluation)
        choose("observation", settings.observation, FORMS)
        settings.array_specs()
        return settings

    def dynamics(self) -> Dynamics:
        return make_dynamics(make_appearance(self.appearance, self.grid), self.rules, self.horizon)

    def tasks(self) -> TaskSet:
        return load_tasks(self.corpus, self.appearance, self.start, self.split)

    def array_specs(self) -> dict[str, ArraySpec]:
        """Shape and dtype of each of the buffers' arrays."""
        dynamics = self.dynamics()
        capacity = item_capacity(self.tasks(), dynamics)
        return buffer_specs(
            self.num_envs, self.image_size, dynamics.appearance.action_count, capacity, self.autoreset_mode
        )


class ResetRequest(NamedTuple):
    """Which environments to reset, and how."""

    env_ids: Int64Array  # (k,) environments, ascending
    seeds: Sequence[int | None]  # (k,) None: keep the generator
    tasks: Sequence[int | None]  # (k,) task indices; None: the next task
    all_envs: bool  # whether the whole batch is reset, which restarts an evaluation

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
        self.set_tasks(settings.tasks())
        self._autoreset = settings.autoreset_mode
        self._first = first
        self._stride = settings.num_envs
        self._evaluation = settings.evaluation
        count = len(buffers.action)
        self._ends = np.array([*(result.ends for result in self.dynamics.step_results), False])  # by `Buffers.result`
        self._generators: list[np.random.Generator | None] = [None] * count
        self._drawn: list[list[int]] = [[] for _ in range(count)]  # indices of the next tasks, in reverse
        self._episodes = np.zeros(count, np.int64)  # number of tasks started in the evaluation
        self._repeats = np.zeros(count, np.bool_)  # whether the current episode's task was evaluated before

    def set_tasks(self, tasks: TaskSet) -> None:
        """Replaces the tasks; all environments must be reset next."""
        self.tasks = tasks
        self._task_count = len(tasks)
        self.core = make_core(self.dynamics, tasks, self.buffers, self._image_size)

    def reset(self, request: ResetRequest) -> None:
        """Starts episodes in some environments of the batch; the others keep their state."""
        buffers = self.buffers
        env_ids, seeds, tasks, all_envs = request.part(self._first, self._first + len(buffers.action))
        buffers.started[:] = False
        for env_id, seed in zip(env_ids.tolist(), seeds, strict=True):
            if seed is not None or self._generators[env_id] is None:
                self._generators[env_id] = seeding.np_random(seed)[0]
                self._drawn[env_id].clear()
        if all_envs:
            self._episodes[:] = 0
        task_indices = [
            self._next_task(env_id) if task is None else task
            for env_id, task in zip(env_ids.tolist(), tasks, strict=True)
        ]
        self._start_episodes(env_ids, task_indices)
        buffers.result[env_ids] = NO_ACTION
        buffers.invalid[env_ids] = NO_REASON
        buffers.ended[env_ids] = False

    def step(self) -> None:
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
        ended = buffers.ended.nonzero()[0]
        if self._autoreset is AutoresetMode.SAME_STEP and len(ended):
            for env_id in ended.tolist():  # fancy indexing would copy each image twice
                buffers.last_image[env_id] = buffers.image[env_id]
            buffers.last_task[ended] = buffers.task[ended]
            buffers.last_steps[ended] = buffers.steps[ended]
            self.core.write_items()
            buffers.last_items[ended] = buffers.items[ended]
            self._start_next_episodes(ended)

    def _start_next_episodes(self, env_ids: Int64Array) -> None:
        self._start_episodes(env_ids, [self._next_task(env_id) for env_id in env_ids.tolist()])

    def _start_episodes(self, env_ids: Int64Array, tasks: Sequence[int]) -> None:
        self.core.start(env_ids, np.array(tasks, np.int64))
        self.buffers.started[env_ids] = True

    def _next_task(self, env_id: int) -> int:
        """A random task; in evaluation tasks `g`, `g + stride`, ... for environment `g` of the batch."""
        if not self._evaluation:
            drawn = self._drawn[env_id]
            if not drawn:
                generator = self._generators[env_id]
                assert generator is not None
                drawn.extend(next_draws(generator, self._task_count))
            return drawn.pop()
        global_id = self._first + env_id
        task = global_id + self._stride * int(self._episodes[env_id])
        self._episodes[env_id] += 1
        self._repeats[env_id] = task >= len(self.tasks)
        return task if task < len(self.tasks) else global_id % len(self.tasks)

    def write_masks(self) -> None:
        self.core.write_masks()

    def write_goals(self) -> None:
        self.core.write_goals()

    def write_items(self) -> None:
        self.core.write_items()

    def states(self) -> list[State]:
        """The current state of each environment."""
        return [self.core.state(env_id) for env_id in range(len(self.buffers.action))]
