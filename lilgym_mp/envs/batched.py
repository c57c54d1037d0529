"""N environments in one process, stepped together behind Gymnasium's vector interface."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pkgutil import resolve_name
from typing import Any, NamedTuple, NoReturn, TypeVar, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.buffers import INVALID_REASONS, NO_REASON, Buffers, refuse_copying
from lilgym_mp.envs.checks import check_open, checked_flag, checked_options, checked_seed
from lilgym_mp.envs.engine import NO_ACTION, BatchSettings, Engine, EnvSnapshot, NewTasks, ResetRequest, with_room
from lilgym_mp.envs.interface import RENDER_FPS, TaskEnvironment, make_renderer, warn_of_no_mode
from lilgym_mp.envs.keywords import refuse_old_id
from lilgym_mp.envs.observation import Observation, observation_space, scene_of, statement_arrays
from lilgym_mp.envs.rules import Dynamics, Outcome, State, Transition
from lilgym_mp.envs.sampling import Sampler, check_statement, checked_task
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import ARRAY_ADVICE, ActionError
from lilgym_mp.scene.arrays import AnyDict, AnyMapping, BoolArray, Float64Array, Int16Array, Int64Array, Rng, UInt8Array

RENDER_MODES = ("rgb_array", "ansi")
RESET_OPTIONS = ("reset_mask", "task")
_REASON_NAMES = np.array([*map(str, INVALID_REASONS), None], object)  # NO_REASON is the last

T = TypeVar("T")
Observations = AnyDict  # "image" (N, height, width, 3) uint8, "statement" N texts, "target" (N,) int64
Infos = AnyDict


class ResultTable(NamedTuple):
    """The fields of step results as arrays, by index; the last entry is for NO_ACTION."""

    rewards: Float64Array  # (9,)
    terminated: BoolArray  # (9,)
    truncated: BoolArray  # (9,)
    endings: NDArray[np.object_]  # (9,) the outcome's name if it ends the episode, else None
    successes: BoolArray  # (9,)

    @classmethod
    def of(cls, dynamics: Dynamics) -> ResultTable:
        """The table of all step results of the dynamics, in its order; a last row stands for no result."""
        rows = [
            (one.reward, one.terminated, one.truncated, str(one.outcome) if one.ends else None, one.outcome)
            for one in dynamics.step_results
        ]
        rewards, terminated, truncated, endings, outcomes = zip(*rows, (0.0, False, False, None, None), strict=True)
        successes = np.array([outcome is Outcome.SUCCESS for outcome in outcomes])
        return cls(np.array(rewards), np.array(terminated), np.array(truncated), np.array(endings, object), successes)


class LilGymVectorEnv(TaskEnvironment, VectorEnv[Observations, Int64Array, Any]):
    """The vector interface shared by `BatchedEnv` and `WorkerVectorEnv`, which steps environments elsewhere too.

    Args:
        settings: The environments and how they are observed.
        buffers: The arrays that the environments write their results into, with N rows.
        render_mode: As for a single environment.
        copy: Whether returned images are copies.
    """

    metadata: AnyDict = {
        "render_modes": list(RENDER_MODES),
        "render_fps": RENDER_FPS,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    _engine: Engine  # of the environments in this process
    single_action_space: spaces.Discrete
    single_observation_space: spaces.Dict

    def __init__(self, settings: BatchSettings, buffers: Buffers, *, render_mode: str | None, copy: bool) -> None:
        self.num_envs = settings.num_envs
        self._renderer = make_renderer(render_mode, RENDER_MODES)
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "autoreset_mode": settings.autoreset_mode}
        self.copy = checked_flag("copy", copy)
        self.dynamics = settings.dynamics()
        self.single_action_space = spaces.Discrete(self.dynamics.appearance.action_count)
        self._arrays = statement_arrays(settings.observation, settings.tasks(), settings.vocabulary, settings.length)
        self.single_observation_space = observation_space(settings.image_size, settings.tasks(), self._arrays)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batched(self.single_observation_space, self.num_envs)
        self.autoreset_mode = settings.autoreset_mode
        self._evaluation = settings.evaluation
        self._sampler = settings.sampler
        self._identity = settings.identity()
        self._buffers = buffers
        self._results = ResultTable.of(self.dynamics)
        self._unseeded: set[int] = set()  # environments whose seed the batch has chosen
        self._process = os.getpid()  # that draws the tasks
        self._set_tasks(settings.tasks())

    def __reduce__(self) -> NoReturn:
        refuse_copying(self)

    @property
    def tasks(self) -> TaskSet:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The tasks that are played; `change_tasks` replaces them."""
        return self._tasks

    @tasks.setter
    def tasks(self, tasks: TaskSet) -> None:
        raise AttributeError("the tasks of a batch cannot be set; call change_tasks(lambda tasks: ...), then reset")

    @property
    def sampler(self) -> Sampler | None:
        """What chooses the tasks, if it is not the uniform distribution."""
        return self._sampler

    @sampler.setter
    def sampler(self, sampler: Sampler | None) -> None:
        raise AttributeError("the sampler of a batch cannot be set; pass sampler=... when making the batch")

    @property
    def np_random(self) -> Rng:
        """A generator that no environment uses: each has its own, which `reset(seed=...)` seeds."""
        return super().np_random

    @np_random.setter
    def np_random(self, value: Rng) -> None:
        raise AttributeError("each environment of a batch has a generator of its own; call reset(seed=...)")

    def _check_open(self) -> None:
        """Raises ClosedEnvironmentError if the environment is closed."""
        check_open(closed=self.closed)

    def _everywhere(self, method: Callable[..., T], *arguments: Any) -> list[T]:
        """Calls a method of the engine of each process; returns their results, in the order of the environments."""
        return [method(self._engine, *arguments)]

    def change_tasks(self, change: Callable[[TaskSet], TaskSet]) -> None:
        """Replaces the tasks from the next reset on, which must reset all environments.

        The observation space does not change, so that statements and numbers of items must fit it.

        Args:
            change: A function from the tasks to the new ones.
        """
        self._check_open()
        self._set_tasks(change(self.tasks))
        self._everywhere(Engine.set_tasks, self.tasks)

    def _set_tasks(self, tasks: TaskSet) -> None:
        self._tasks = tasks
        self._indexed = with_room(tasks, self.num_envs)  # by index, as `_task_ids`, `_statements` and `_targets`
        self._task_ids = np.array([task.id for task in self._indexed], object)
        self._targets = np.array([task.target for task in self._indexed], np.int64)
        if self._arrays is None:
            self._statements = np.array([task.statement for task in self._indexed], object)
        else:
            self._arrays.set_tasks(tasks)
            self._statements = np.stack([self._arrays.row(task.statement) for task in self._indexed])
            self._targets = self._targets[:, None]
        self._seeds: list[int | None] = [None] * self.num_envs
        self._is_started = False  # whether every environment has been reset

    def _add_tasks(self, results: Sequence[NewTasks | None]) -> None:
        """Enters the new tasks of each process. Raises ValueError if observations cannot show a statement."""
        for tasks in results:
            for index, task in (tasks or {}).items():
                check_statement(task, self.single_observation_space, self._arrays)
                self._indexed[index] = task
                self._task_ids[index] = task.id
                self._targets[index] = task.target
                self._statements[index] = task.statement if self._arrays is None else self._arrays.row(task.statement)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: AnyMapping | None = None
    ) -> tuple[Observations, Infos]:
        """Resets every environment, or those chosen.

        Args:
            seed: An int s seeds environment i with s + i, a sequence seeds each, None keeps the generators.
            options: "reset_mask", bool (N,): environments to reset. "task": a task id or `Task` for all environments,
                or one for each (None: drawn at random).

        Returns:
            The observations, and infos.

        Raises:
            ValueError: For a wrong option, seed or task, before anything changes.
        """
        self._check_open()
        options = checked_options(options, RESET_OPTIONS)
        env_ids = self._chosen(options.get("reset_mask"))
        tasks = self._chosen_tasks(options.get("task"))
        if len(env_ids) < self.num_envs and not self._is_started:
            raise gym.error.ResetNeeded("the first reset must be of all environments; leave out reset_mask")
        self._draw_on_its_own()
        seeds = self._fresh_seeds(seed, env_ids)
        chosen_seeds, chosen_tasks = ([column[env_id] for env_id in env_ids.tolist()] for column in (seeds, tasks))
        request = ResetRequest(env_ids, chosen_seeds, chosen_tasks, all_envs="reset_mask" not in options)
        self._add_tasks(self._everywhere(Engine.reset, request))
        for env_id in env_ids.tolist():
            self._seeds[env_id] = self._seeds[env_id] if seeds[env_id] is None else seeds[env_id]
        self._is_started = True
        return self._observe(), self._start_infos()

    def _chosen(self, mask: object) -> Int64Array:
        if mask is None:
            return np.arange(self.num_envs)
        if not isinstance(mask, np.ndarray) or mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ValueError(f"reset_mask must be a bool array of shape ({self.num_envs},), not {mask!r}")
        if not mask.any():
            raise ValueError("reset_mask selects no environment; leave it out to reset all")
        return np.flatnonzero(mask)

    def _chosen_tasks(self, task: object) -> Sequence[int | Task | None]:
        choices = cast("Sequence[Any]", task) if _is_list(task) else [task] * self.num_envs
        if len(choices) != self.num_envs:
            raise ValueError(f"task must be one id or {self.num_envs}, one for each environment, not {len(choices)}")
        return [choice if choice is None else self._chosen_task(choice) for choice in choices]

    def _chosen_task(self, choice: object) -> int | Task:
        if not isinstance(choice, Task):
            return self.tasks.index_of(choice)
        check_statement(choice, self.single_observation_space, self._arrays)
        return checked_task(choice, self.dynamics, self._buffers.items.shape[2])

    def _fresh_seeds(self, seed: int | Sequence[int | None] | None, env_ids: Int64Array) -> list[int | None]:
        """For each environment the seed of a new generator, or None to keep the old one."""
        if _is_list(seed):
            seed = cast("Sequence[int | None]", seed)
            if len(seed) != self.num_envs:
                raise ValueError(
                    f"seed must be one number or {self.num_envs}, one for each environment, not {len(seed)}"
                )
            seeds = [checked_seed(one) for one in seed]
        else:
            first = checked_seed(seed)
            seeds = [None if first is None else first + env_id for env_id in range(self.num_envs)]
        for env_id in env_ids.tolist():
            if seeds[env_id] is not None:
                self._unseeded.discard(env_id)
            elif self._seeds[env_id] is None:
                self._unseeded.add(env_id)
                seeds[env_id] = _new_seed()
        return seeds

    def _draw_on_its_own(self) -> None:
        """In a forked process, where environments that were never seeded would draw the tasks of the other process."""
        if self._process == (process := os.getpid()):
            return
        self._process = process
        for env_id in self._unseeded:
            seed = self._seeds[env_id] = _new_seed()
            self._engine.seed(env_id, seed)

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:
        """The seed of each environment's generator; None before the first reset."""
        return tuple(self._seeds)

    def step(self, actions: Any) -> tuple[Observations, Float64Array, BoolArray, BoolArray, Infos]:
        """Takes one action in each environment.

        Args:
            actions: (N,) integers; environments about to be reset ignore theirs.

        Returns:
            Observations, rewards (N,), terminated (N,), truncated (N,) and infos.

        Raises:
            ActionError: For a wrong shape, type or action.
            ResetNeeded: Before the first reset and, without autoreset, when an episode has ended.
        """
        self._check_started()  # also checks that the environment is open, before anything is written
        self._draw_on_its_own()
        self._buffers.action[:] = self._checked(actions)
        self._add_tasks(self._everywhere(Engine.step))
        result = self._buffers.result
        ended = self._buffers.ended
        table = self._results
        # `count_nonzero` is five times as fast as `any`, like `nonzero` compared with `flatnonzero`.
        infos = self._end_infos(ended.copy()) if np.count_nonzero(ended) else {}
        return (
            self._observe(),
            table.rewards.take(result),
            table.terminated.take(result),
            table.truncated.take(result),
            infos | self._start_infos(),
        )

    def _check_started(self) -> None:
        self._check_open()
        if not self._is_started:
            raise gym.error.ResetNeeded("there are no episodes before the first reset; call reset first")

    def _checked(self, actions: Any) -> Int64Array:
        array = checked_actions(actions, self.num_envs)
        count = self.single_action_space.n
        ended = self._buffers.ended
        if self.autoreset_mode is AutoresetMode.DISABLED and ended.any():
            env_ids = ", ".join(map(str, np.flatnonzero(ended)))
            raise gym.error.ResetNeeded(f"environments {env_ids} have ended; reset them with a reset_mask first")
        outside = (array < 0) | (array >= count)
        if np.count_nonzero(outside):
            if self.autoreset_mode is AutoresetMode.NEXT_STEP:
                outside &= ~ended
                array = np.where(ended, 0, array)
            for env_id in np.flatnonzero(outside).tolist():
                raise ActionError(
                    f"action {array[env_id]} of environment {env_id} is out of range; choose from 0 .. {count - 1}"
                )
        return array

    def _observe(self) -> Observations:
        tasks = self._buffers.task
        statements: Any = self._statements.take(tasks, axis=0)
        if self._arrays is None:
            statements = tuple(statements.tolist())
        return {"image": self._images(), "statement": statements, "target": self._targets.take(tasks, axis=0)}

    def _images(self) -> UInt8Array:
        """(N, height, width, 3) the images of observations; a copy if `copy`."""
        return self._buffers.image.copy() if self.copy else self._buffers.image

    def _start_infos(self) -> Infos:
        """Infos in the format of Gymnasium's vector environments: arrays (N,), each with a mask `_name`."""
        started = self._buffers.started.copy()
        env_ids = started.nonzero()[0]
        if not len(env_ids):
            return {}
        task_ids = np.empty(self.num_envs, object)  # None at first
        task_ids[env_ids] = self._task_ids[self._buffers.task[env_ids]]
        return {"task": task_ids, "_task": started}

    def _end_infos(self, ended: BoolArray) -> Infos:
        buffers = self._buffers
        results = self._results
        infos: Infos = {
            "outcome": results.endings[buffers.result],
            "_outcome": ended,
            "is_success": results.successes[buffers.result],
            "_is_success": ended.copy(),
        }
        invalid = buffers.invalid != NO_REASON
        if np.count_nonzero(invalid):
            infos |= {"invalid_reason": _REASON_NAMES[buffers.invalid], "_invalid_reason": invalid}
        if self._evaluation:
            infos |= {"repeated": buffers.repeated & ended, "_repeated": ended.copy()}
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            final = np.empty(self.num_envs, object)  # None at first
            for env_id in ended.nonzero()[0].tolist():
                final[env_id] = self._last_observation(env_id)
            return {
                "final_obs": final,
                "_final_obs": ended.copy(),
                "final_info": infos,
                "_final_info": ended.copy(),
            }
        return infos

    def _last_action(self, env_id: int, state: State) -> tuple[int, Transition] | None:
        buffers = self._buffers
        result = int(buffers.result[env_id])
        if result == NO_ACTION or buffers.started[env_id]:
            return None
        reason = int(buffers.invalid[env_id])
        invalid = None if reason == NO_REASON else INVALID_REASONS[reason]
        return int(buffers.action[env_id]), Transition(state, self.dynamics.step_results[result], invalid)

    def _last_observation(self, env_id: int) -> Observation | AnyDict:
        task = int(self._buffers.last_task[env_id])
        statement = self._statements[task]
        target = self._targets[task]
        if self._arrays is None:
            target = int(target)
        else:
            statement = statement.copy()
            target = target.copy()
        return {"image": self._buffers.last_image[env_id].copy(), "statement": statement, "target": target}

    @property
    def evaluation_finished(self) -> bool:
        """With `evaluation=True`: whether every task of the split has been completed since the last reset."""
        self._check_open()
        return self._evaluation and bool(self._buffers.evaluated.sum() >= len(self.tasks))

    @property
    def task_indices(self) -> Int64Array:
        """(N,) a new array: index in `tasks` of each current task; `len(tasks)` or more for one that is not there."""
        self._check_open()
        return self._buffers.task.copy()

    @property
    def steps(self) -> Int64Array:
        """(N,) a new array: actions taken in each current episode."""
        self._check_open()
        return self._buffers.steps.copy()

    def action_masks(self) -> BoolArray:
        """(N, actions) a new array: whether each action is valid now."""
        return self._written(Engine.write_masks, "mask")

    def goal_reached(self) -> BoolArray:
        """(N,) a new array: whether STOP would be rewarded +1 now."""
        return self._written(Engine.write_goals, "goal")

    def scene_array(self) -> Int16Array:
        """(N, 3, capacity, 5) a new array: `observation.item_array` of each scene."""
        return self._written(Engine.write_items, "items")

    def _written(self, write: Callable[[Engine], None], name: str) -> Any:
        self._check_started()
        self._everywhere(write)
        return getattr(self._buffers, name).copy()

    def states(self) -> list[State]:
        """The current state of each environment."""
        self._check_started()
        return [state for states in self._everywhere(Engine.states) for state in states]

    def save_state(self) -> list[tuple[EnvSnapshot, int | None]]:
        """A snapshot of each environment, with its random generator. Picklable; nothing changes it."""
        self._check_started()
        snapshots = [snapshot for part in self._everywhere(Engine.save) for snapshot in part]
        return list(zip(snapshots, self._seeds, strict=True))

    def restore_state(self, state: Sequence[tuple[EnvSnapshot, int | None]]) -> None:
        """Continues from a `save_state()` of a batch of this configuration.

        Args:
            state: The snapshot, or N of its elements in any order: `[state[0]] * N` puts all environments into the
                state of the first.

        Raises:
            ValueError: Unless there are N, for a batch of other scenes, rules or horizon, and for tasks that do not fit
                this batch.
        """
        self._check_open()
        if len(state) != self.num_envs:
            raise ValueError(f"state must have {self.num_envs} elements, one for each environment, not {len(state)}")
        snapshots, seeds = (list(column) for column in zip(*state, strict=True))
        for snapshot in snapshots:
            if snapshot.identity != self._identity:
                raise ValueError(
                    f"this state cannot be played here: saved in {snapshot.identity}; this batch is {self._identity}"
                )
            self._chosen_task(snapshot.state.task)
        self._seeds = seeds
        self._unseeded.clear()
        self._add_tasks(self._everywhere(Engine.restore, snapshots))
        self._is_started = True

    def last_states(self, env_ids: Int64Array) -> list[State]:
        """The final states of the episodes that ended last (autoreset mode SAME_STEP).

        Args:
            env_ids: int64 (k,), the environments.
        """
        self._check_open()
        buffers = self._buffers
        tasks = [self._indexed[task] for task in buffers.last_task[env_ids].tolist()]
        columns = zip(
            tasks, map(scene_of, buffers.last_items[env_ids]), buffers.last_steps[env_ids].tolist(), strict=True
        )
        return [State(*fields) for fields in columns]

    def render(self) -> tuple[UInt8Array | str, ...] | None:
        """A frame (304, 784, 3) or text for each environment, by render mode."""
        self._check_open()
        if (renderer := self._renderer) is None:
            warn_of_no_mode(self.spec.id if self.spec else type(self).__name__)
            return None
        shown = (
            renderer.show(state, self.dynamics, self._last_action(env_id, state))
            for env_id, state in enumerate(self.states())
        )
        return tuple(cast("Iterator[UInt8Array | str]", shown))


class BatchedEnv(LilGymVectorEnv):
    """N environments in this process: what `gymnasium.make_vec` returns.

    Observations are {"image": uint8 (N, 50, 190, 3), "statement": a tuple of N strings, "target": int64 (N,)}.
    Rewards, flags and infos equal those of N single environments in Gymnasium's SyncVectorEnv.
    """

    def __init__(
        self, num_envs: int = 1, *, render_mode: str | None = None, copy: bool = True, **settings: Any
    ) -> None:
        """Makes all environments; `reset` draws their first tasks.

        Args:
            num_envs: The number of environments, N.
            render_mode: As for a single environment.
            copy: Whether returned images are copies; otherwise they are valid until the next call.
            settings: The fields of `engine.BatchSettings`: those of a single environment, and two more.
                `autoreset_mode`: Gymnasium's, NEXT_STEP by default. `evaluation`: play every task of the split once, in
                file order across the batch, instead of random tasks. An environment with none left repeats one, with
                "repeated" true in its infos; see `evaluation_finished`.

        Raises:
            ValueError: For invalid settings; the message names the value and the choices.
            CorpusError: For unusable data (a ValueError).
        """
        checked = BatchSettings.of({"num_envs": num_envs, **settings}, "render_mode", "copy")
        buffers = Buffers.new(checked.array_specs())
        super().__init__(checked, buffers, render_mode=render_mode, copy=copy)
        self._engine = Engine(checked, buffers)


def _new_seed() -> int:
    return int(np.random.SeedSequence().generate_state(1, np.uint64)[0])


def batch_spec(id: str) -> EnvSpec:
    """The spec of a batch's id, "MODULE:ID" or "ID", of which MODULE is imported first, as in `gymnasium.make`.

    Its kwargs include the `max_episode_steps` of an id of one's own, as `gymnasium.make_vec` passes it: batches refuse
    it, because their rules end the episodes.

    Raises:
        gymnasium.error.Error: For an unknown id, one of the release, or one with wrappers of single environments.
    """
    module, _, name = id.rpartition(":")
    if module:
        resolve_name(module)
    spec = gym.spec(name)
    if spec.additional_wrappers:
        wrappers = ", ".join(each.name for each in spec.additional_wrappers)
        raise gym.error.Error(f"{name} is registered with additional_wrappers, which wrap no batches: {wrappers}")
    kwargs = dict(spec.kwargs)
    if "new_id" in kwargs:
        refuse_old_id(**kwargs)
    if spec.max_episode_steps is not None:
        kwargs.setdefault("max_episode_steps", spec.max_episode_steps)
    return replace(spec, kwargs=kwargs)


def checked_actions(actions: Any, num_envs: int) -> Int64Array:
    """The actions as an array. Raises ActionError unless they are (num_envs,) whole numbers."""
    array = np.asarray(actions)
    if array.shape != (num_envs,) or array.dtype.kind not in "iu":
        advice = ARRAY_ADVICE if array.ndim > 1 else ""
        raise ActionError(
            f"actions must be {num_envs} whole numbers, one for each environment,"
            f" not {array.dtype} of shape {array.shape}{advice}"
        )
    return array


def batched(single: spaces.Space[Any], count: int) -> Any:
    """Gymnasium's `batch_space` in less memory: without N equal Text spaces, and with one array of bounds for N boxes,
    which saves 117 MB for 1,024 images."""
    if isinstance(single, spaces.Dict):
        return spaces.Dict({name: batched(part, count) for name, part in single.spaces.items()})
    if isinstance(single, spaces.Text):
        return spaces.Tuple([single] * count)
    if not isinstance(single, spaces.Box):
        return batch_space(single, count)
    box = cast("spaces.Box", batch_space(single, 1))
    shape = box._shape = (count, *single.shape)
    for name in ("low", "high", "bounded_below", "bounded_above"):
        setattr(box, name, np.broadcast_to(getattr(box, name), shape))
    return box


def _is_list(value: object) -> bool:
    """Whether `value` is a sequence other than a string, or an array of at least one dimension."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)
