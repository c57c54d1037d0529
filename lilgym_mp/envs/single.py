"""The single environment: Gymnasium's interface to `rules.Dynamics`."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, SupportsFloat, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.checks import check_open, checked_flag, checked_options, checked_seed
from lilgym_mp.envs.config import SingleConfig
from lilgym_mp.envs.interface import (
    RENDER_FPS,
    RENDER_MODES,
    RESET_OPTIONS,
    TaskEnvironment,
    end_info,
    make_renderer,
    warn_of_no_mode,
)
from lilgym_mp.envs.observation import Observation, observation_space, statement_arrays
from lilgym_mp.envs.rules import State, Transition
from lilgym_mp.envs.sampling import check_statement, checked_task, next_draws
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import checked_index
from lilgym_mp.scene.arrays import AnyDict, AnyMapping, BoolArray, Rng, UInt8Array
from lilgym_mp.scene.render.canvas import Canvas


class LilGymEnv(TaskEnvironment, gym.Env[Observation, int]):
    """Add and remove items until the statement has the target value, then STOP.

    Observation space: {"image": uint8 (50, 190, 3) or (100, 380, 3), "statement": str, "target": 0 or 1}.
    Action space: Discrete(13) for Tower, Discrete(2661) for Scatter on the released grid; `encode_action` and
    `decode_action` translate the released array form.
    Reward: -0.1 for a valid edit; +1 for a STOP when the statement's truth value equals the target, -1 for any other
    STOP; -1 for an invalid edit and for an edit at the horizon (12 actions; with rules="release" 11, and -0.1).
    Episode end: STOP, an invalid edit or the horizon, all terminated; rules="release" flags the last two truncated.
    Info after reset: "task", the task's id. Info at the end of an episode: "outcome" (success, wrong_stop,
    invalid_action, horizon), "is_success", and "invalid_reason" with invalid_action.
    Source: Wu et al. 2023, section 4.
    """

    metadata: AnyDict = {"render_modes": list(RENDER_MODES), "render_fps": RENDER_FPS}

    def __init__(
        self,
        configuration: str | None = None,
        *,
        render_mode: str | None = None,
        render_cells: bool = False,
        **settings: Any,
    ) -> None:
        """Makes the environment; `reset` draws the first task.

        Args:
            configuration: Its name, such as "TowerScratch".
            render_mode: "human", "rgb_array", "ansi" or None.
            render_cells: Rendered frames show the grid's cells with column and row numbers (Tower: names of boxes).
            settings: The fields of `SingleConfig`, all optional: the environment's and how it is observed.

        Raises:
            ValueError: For invalid settings; the message names the value and the choices.
            CorpusError: For unusable data (a ValueError).
        """
        given = {"configuration": configuration, **settings}
        self.config = config = SingleConfig.of(given, "render_mode", "render_cells")
        self.dynamics = config.dynamics()
        marked = self.dynamics.appearance if checked_flag("render_cells", render_cells) else None
        self._renderer = make_renderer(render_mode, marked=marked)
        self.render_mode = render_mode
        self._canvas = Canvas(config.image_size)
        self.tasks = config.tasks()
        self.action_space = cast("spaces.Space[int]", spaces.Discrete(self.dynamics.appearance.action_count))
        self._arrays = statement_arrays(config.observation, self.tasks, config.vocabulary, config.length)
        space = observation_space(config.image_size, self.tasks, self._arrays)
        self.observation_space = cast("spaces.Space[Observation]", space)
        self._state: State | None = None
        self._last: tuple[int, Transition] | None = None  # the last action's index, and its transition
        self._action_count = self.dynamics.appearance.action_count
        self._ended = False
        self._closed = False
        self.sampler = config.sampler
        self._decode = self.dynamics.appearance.decode
        self._draws: list[int] = []  # indices of the next tasks, in reverse
        self._draws_by: Rng | None = None  # the generator that drew them
        self._is_seeded = False  # whether a reset has been given a seed
        self._process = os.getpid()  # that drew the tasks

    def __getstate__(self) -> AnyDict:
        """Copies of an environment that was never seeded draw tasks on their own."""
        state = vars(self).copy()
        if self._draws_on_its_own():
            state |= {"_np_random": None, "_np_random_seed": None, "_draws": []}
        return state

    def _draws_on_its_own(self) -> bool:
        """Whether a copy of this environment, or a forked one, is to draw other tasks."""
        return not self._is_seeded and self._np_random_seed != -1  # Gymnasium's seed of a generator that was set

    def reset(self, *, seed: int | None = None, options: AnyMapping | None = None) -> tuple[Observation, AnyDict]:
        """Starts an episode, by default of a uniformly drawn task.

        Args:
            seed: Seed of the environment's generator; None keeps it.
            options: {"task": task}: an id, or a `Task` whose statement fits the observation space.

        Returns:
            The observation, and infos with the task's id.

        Raises:
            ValueError: For an unknown id or option or an invalid task or seed.
            ClosedEnvironmentError: After `close`.
        """
        check_open(closed=self._closed)
        choice = None if options is None else checked_options(options, RESET_OPTIONS).get("task")
        chosen = None if choice is None else self._task(choice)
        if seed is not None:
            super().reset(seed=checked_seed(seed))
            self._is_seeded = True
        task = self._drawn_task() if chosen is None else chosen
        if self._arrays is not None:
            self._row = self._arrays.row(task.statement)
        self._state = self.dynamics.start(task)
        self._last = None
        self._ended = False
        if self.render_mode == "human":
            self.render()
        return self._observe(self._state), {"task": task.id}

    def _task(self, choice: object) -> Task:
        if not isinstance(choice, Task):
            return self.tasks.by_id(choice)
        check_statement(choice, self.observation_space, self._arrays)
        return checked_task(choice, self.dynamics)

    def _drawn_task(self) -> Task:
        if self._process != (process := os.getpid()):  # this process was forked
            self._process = process
            if self._draws_on_its_own():
                self._np_random = self._np_random_seed = None
                self._draws = []
        generator = self.np_random
        if self.sampler is not None and (choice := self.sampler(generator, 0)) is not None:
            return self._task(choice)
        if not self._draws or generator is not self._draws_by:
            self._draws = next_draws(generator, len(self.tasks))
            self._draws_by = generator
        return self.tasks[self._draws.pop()]

    def step(self, action: int) -> tuple[Observation, SupportsFloat, bool, bool, AnyDict]:
        """Takes one action.

        Args:
            action: Its index.

        Returns:
            Observation, reward, terminated, truncated and infos.

        Raises:
            ActionError: For an action out of range.
            ResetNeeded: Before reset and after the end of an episode.
            ClosedEnvironmentError: After `close`.
        """
        state = self._state
        if state is None or self._ended:
            check_open(closed=self._closed)
            when = "before the first reset" if state is None else "after the end of the episode"
            raise gym.error.ResetNeeded(f"step was called {when}; call reset first")
        if type(action) is not int or not 0 <= action < self._action_count:
            action = checked_index(action, self._action_count)
        transition = self.dynamics.step(state, self._decode(action))
        self._state, (_, outcome, reward, terminated, truncated, _), invalid = transition
        self._last = action, transition
        self._ended = terminated or truncated
        if self.render_mode == "human":
            self.render()
        info = end_info(outcome, invalid) if self._ended else {}
        return self._observe(self._state), reward, terminated, truncated, info

    def _observe(self, state: State) -> Observation:
        task = state.task
        image = self._canvas.show(state.scene).copy()
        if self._arrays is None:
            return {"image": image, "statement": task.statement, "target": 1 if task.target else 0}  # faster than int()
        arrays: Any = {"image": image, "statement": self._row.copy(), "target": np.array([task.target], np.int64)}
        return arrays

    @property
    def state(self) -> State:
        """The current state.

        Raises:
            ResetNeeded: Before the first reset.
            ClosedEnvironmentError: After `close`.
        """
        if self._state is None:
            check_open(closed=self._closed)
            raise gym.error.ResetNeeded("there is no state before the first reset; call reset first")
        return self._state

    @property
    def scene(self) -> Scene:
        """The current scene."""
        return self.state.scene

    @property
    def task(self) -> Task:
        """The task of the episode in progress."""
        return self.state.task

    @property
    def steps(self) -> int:
        """Actions taken in the episode."""
        return self.state.steps

    def action_masks(self) -> BoolArray:
        """(actions,) bool, a new array: element i is True iff action i is valid now."""
        return self.dynamics.legal_mask(self.state)

    def goal_reached(self) -> bool:
        """Whether STOP would be rewarded +1 now."""
        return self.dynamics.goal_reached(self.state)

    def change_tasks(self, change: Callable[[TaskSet], TaskSet]) -> None:
        """Replaces the tasks from the next reset on.

        The observation space does not change, so that statements and numbers of items must fit it.

        Args:
            change: A function from the tasks to the new ones.
        """
        check_open(closed=self._closed)
        self.tasks = change(self.tasks)
        self._draws = []
        if self._arrays is not None:
            self._arrays.set_tasks(self.tasks)

    def render(self) -> UInt8Array | str | None:
        """By render mode: an image (304, 784, 3) with a caption, text, or None after updating the window."""
        state = self.state  # raises after `close`
        if self._renderer is None:
            warn_of_no_mode(self.config.id)
            return None
        return self._renderer.show(state, self.dynamics, self._last)

    def close(self) -> None:
        self._closed = True
        self._state = self._last = None
        if self._renderer is not None:
            self._renderer.close()
