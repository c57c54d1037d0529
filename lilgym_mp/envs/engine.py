"""Episodes one after another in N environments: which task comes next, and when. A core plays them.

What it does here is done alike in one process and in many: an environment's results depend on its own seed and
actions only, wherever it is.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode

from lilgym_mp.appearances import RELEASED_GRID, Grid, checked_grid, make_appearance
from lilgym_mp.arrays import Int64Array
from lilgym_mp.choices import choose
from lilgym_mp.corpus import TaskSet, load_tasks
from lilgym_mp.envs.buffers import NO_REASON, ArraySpec, Buffers, buffer_specs
from lilgym_mp.envs.checks import checked_flag
from lilgym_mp.envs.cores import make_core
from lilgym_mp.envs.draws import next_draws
from lilgym_mp.observation import FORMS, TEXT, item_capacity
from lilgym_mp.rules import ActionStatus, Dynamics, State, make_dynamics

AUTORESET_MODES: Mapping[str, AutoresetMode] = {mode.value: mode for mode in AutoresetMode}
NO_ACTION = 2 * len(ActionStatus)  # number in `Buffers.result` where an episode was started instead of an action taken


@dataclass(frozen=True)
class Settings:
    """What defines N environments; picklable. The keywords of `LilGymEnv`, and how the batch goes on."""

    appearance: str
    start: str
    corpus: str
    split: str
    rules: str
    horizon: int | None
    grid: Grid
    image_size: str
    num_envs: int
    autoreset: AutoresetMode
    evaluation: bool  # every task of the split once, instead of at random
    observation: str  # its form: "text" or "arrays"

    @classmethod
    def of(
        cls,
        num_envs: int,
        *,
        appearance: str,
        start: str,
        corpus: str | os.PathLike[str] = "builtin",
        split: str = "train",
        rules: str = "paper",
        horizon: int | None = None,
        grid: tuple[int, int] | str = RELEASED_GRID,
        image_size: str = "half",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        evaluation: bool = False,
        observation: str = TEXT,
    ) -> Settings:
        """Raises ValueError naming the value and the choices, CorpusError (a ValueError) for unusable data."""
        if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise ValueError(f"num_envs must be a positive whole number, not {num_envs!r}")
        if not isinstance(autoreset_mode, AutoresetMode):
            autoreset_mode = choose("autoreset_mode", autoreset_mode, AUTORESET_MODES)
        settings = cls(
            appearance,
            start,
            os.fspath(corpus),
            split,
            rules,
            horizon,
            checked_grid(grid),
            image_size,
            int(num_envs),
            autoreset_mode,
            checked_flag("evaluation", evaluation),
            choose("observation", observation, FORMS),
        )
        settings.forms()
        return settings

    def dynamics(self) -> Dynamics:
        return make_dynamics(make_appearance(self.appearance, self.grid), self.rules, self.horizon)

    def tasks(self) -> TaskSet:
        return load_tasks(self.corpus, self.appearance, self.start, self.split)

    def forms(self) -> dict[str, ArraySpec]:
        """The form of the buffers' arrays."""
        dynamics = self.dynamics()
        capacity = item_capacity(self.tasks(), dynamics)
        return buffer_specs(self.num_envs, self.image_size, dynamics.appearance.action_count, capacity, self.autoreset)


class Reset(NamedTuple):
    """An order to begin episodes."""

    env_ids: Int64Array  # (k,) environments, ascending
    seeds: Sequence[int | None]  # (k,) None: the generator goes on
    tasks: Sequence[int | None]  # (k,) numbers of tasks; None: whichever comes next
    everywhere: bool  # in the whole batch: evaluation begins anew


class Engine:
    """Environments `first` .. `first + N - 1` of a batch, over their part of its buffers."""

    def __init__(self, settings: Settings, buffers: Buffers, first: int = 0) -> None:
        self.dynamics = settings.dynamics()
        self.buffers = buffers
        self._image_size = settings.image_size
        self.play(settings.tasks())
        self._autoreset = settings.autoreset
        self._first = first
        self._stride = settings.num_envs
        self._evaluation = settings.evaluation
        count = len(buffers.action)
        self._ends = np.array([*(result.ends for result in self.dynamics.step_results), False])  # by `Buffers.result`
        self._generators: list[np.random.Generator | None] = [None] * count
        self._drawn: list[list[int]] = [[] for _ in range(count)]  # tasks to come, the next one last
        self._episodes = np.zeros(count, np.int64)  # begun in evaluation
        self._repeats = np.zeros(count, np.bool_)  # whether the current episode's task was evaluated before

    def play(self, tasks: TaskSet) -> None:
        """Draws from `tasks` henceforth; a reset of all environments must follow."""
        self.tasks = tasks
        self._task_count = len(tasks)
        self.core = make_core(self.dynamics, tasks, self.buffers, self._image_size)
        self._writers = {
            "mask": self.core.write_masks,
            "goal": self.core.write_goals,
            "items": self.core.write_items,
        }

    def reset(self, order: Reset) -> None:
        """Begins episodes in some environments; the others stay as they are."""
        env_ids, seeds, tasks, everywhere = order
        buffers = self.buffers
        buffers.started[:] = False
        for number, seed in zip(env_ids.tolist(), seeds, strict=True):
            if seed is not None or self._generators[number] is None:
                self._generators[number] = seeding.np_random(seed)[0]
                self._drawn[number].clear()
        if everywhere:
            self._episodes[:] = 0
        chosen = [self._next_task(n) if task is None else task for n, task in zip(env_ids.tolist(), tasks, strict=True)]
        self._begin(env_ids, chosen)
        buffers.result[env_ids] = NO_ACTION
        buffers.invalid[env_ids] = NO_REASON
        buffers.ended[env_ids] = False

    def step(self) -> None:
        """Takes `buffers.action`, and begins new episodes as the autoreset mode has it."""
        buffers = self.buffers
        buffers.started[:] = False
        waiting = buffers.ended.nonzero()[0]
        if self._autoreset is AutoresetMode.NEXT_STEP and len(waiting):
            self.core.step((~buffers.ended).nonzero()[0])
            self._begin_next(waiting)
            buffers.result[waiting] = NO_ACTION
            buffers.invalid[waiting] = NO_REASON
        else:
            self.core.step(None)
        self._ends.take(buffers.result, out=buffers.ended)
        if self._evaluation:
            np.logical_and(buffers.ended, self._repeats, out=buffers.repeated)
        ended = buffers.ended.nonzero()[0]
        if self._autoreset is AutoresetMode.SAME_STEP and len(ended):
            for number in ended.tolist():  # copied once, while an array of numbers would have it copied twice
                buffers.last_image[number] = buffers.image[number]
            buffers.last_task[ended] = buffers.task[ended]
            buffers.last_steps[ended] = buffers.steps[ended]
            self.core.write_items()
            buffers.last_items[ended] = buffers.items[ended]
            self._begin_next(ended)

    def _begin_next(self, env_ids: Int64Array) -> None:
        self._begin(env_ids, [self._next_task(number) for number in env_ids.tolist()])

    def _begin(self, env_ids: Int64Array, tasks: Sequence[int]) -> None:
        self.core.start(env_ids, np.array(tasks, np.int64))
        self.buffers.started[env_ids] = True

    def _next_task(self, number: int) -> int:
        """At random, or in evaluation the tasks `g`, `g + stride`, ... for the batch's environment `g`."""
        if not self._evaluation:
            drawn = self._drawn[number]
            if not drawn:
                generator = self._generators[number]
                assert generator is not None
                drawn.extend(next_draws(generator, self._task_count))
            return drawn.pop()
        place = self._first + number
        task = place + self._stride * int(self._episodes[number])
        self._episodes[number] += 1
        self._repeats[number] = task >= len(self.tasks)
        return task if task < len(self.tasks) else place % len(self.tasks)

    def write(self, what: str) -> None:
        """Brings the buffers' "mask", "goal" or "items" up to date."""
        self._writers[what]()

    def states(self) -> list[State]:
        """The current state of each environment."""
        return [self.core.state(number) for number in range(len(self.buffers.action))]
