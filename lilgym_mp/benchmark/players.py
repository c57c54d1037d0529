"""Players: each runs the environments in one way, and returns a function that plays a workload and times it.

A step is one action of the MDP (in the AEC game, one agent's turn). Resets are timed but do not count as steps, except
the initial one, which seeds the generators and is not timed. Each player is a context manager.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import perf_counter
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.benchmark.traces import Trace, Workload, vector_trace
from lilgym_mp.envs.workers import WorkerVectorEnv

COPIES = 2_048  # images copied per play


class Timing(NamedTuple):
    """Steps and their duration."""

    steps: int
    seconds: float


Play = Callable[[], Timing]
Wrap = Callable[[Any], Any]


def unwrapped(env: Any) -> Any:
    return env


@contextmanager
def copying(workload: Workload, num_envs: int) -> Iterator[Play]:
    """Copying N images: an upper bound on the speed of any environment that copies its observations."""
    image = workload.recorder.reset(seed=0)[0]["image"]
    images = np.repeat(image[None], num_envs, 0)
    count = -(-COPIES // num_envs)

    def play() -> Timing:
        copy = images.copy
        started = perf_counter()
        for _ in range(count):
            copy()
        return Timing(count * num_envs, perf_counter() - started)

    yield play


@contextmanager
def single(workload: Workload, *, wrap: Wrap = unwrapped, masks: bool = False) -> Iterator[Play]:
    """One environment from `gymnasium.make`; `masks`: also get the mask before each action."""
    env = wrap(workload.make())
    (script,) = workload.scripts(1)
    count = sum(len(episode.actions) for episode in script.episodes)
    get_masks = getattr(env, "action_masks", env.unwrapped.action_masks) if masks else None

    def play() -> Timing:
        step, reset = env.step, env.reset
        reset(seed=script.seed)
        started = perf_counter()
        for episode in script.episodes:
            for action in episode.actions:
                if get_masks is not None:
                    get_masks()
                step(action)
            reset()
        return Timing(count, perf_counter() - started)

    yield play
    env.close()


def batched_env(workload: Workload, num_envs: int, *, copy: bool = True) -> Any:
    return gym.make_vec(workload.environment_id, num_envs=num_envs, copy=copy, **workload.arguments)


def worker_env(workload: Workload, num_envs: int, *, processes: int, copy: bool = True) -> Any:
    return WorkerVectorEnv(workload.environment_id, num_envs, processes, copy=copy, **workload.arguments)


@contextmanager
def vector(
    workload: Workload, num_envs: int, make: Callable[[Workload, int], Any], *, masks: bool = False
) -> Iterator[Play]:
    """One of this package's vector environments."""
    env = make(workload, num_envs)
    trace = vector_trace(workload.scripts(num_envs), env.metadata["autoreset_mode"])
    play = _timed_steps(trace, lambda: env.reset(seed=0), env.step, env.action_masks if masks else None)
    try:
        yield play
    finally:
        env.close()


def _timed_steps(
    trace: Trace, reset: Callable[[], object], step: Callable[[Any], object], get_masks: Callable[[], object] | None
) -> Play:
    def play() -> Timing:
        reset()
        started = perf_counter()
        if get_masks is None:
            for row in trace.rows:
                step(row)
        else:
            for row in trace.rows:
                get_masks()
                step(row)
        return Timing(trace.actions, perf_counter() - started)

    return play


def wrapped(workload: Workload, num_envs: int, *, wrap: Wrap) -> Any:
    return wrap(batched_env(workload, num_envs))


@contextmanager
def sb3(workload: Workload, num_envs: int, backend: str, *, masks: bool = False, **options: Any) -> Iterator[Play]:
    """A Stable-Baselines3 `VecEnv` with monitor, as used in training."""
    from lilgym_mp.sb3 import make_vec_env

    if backend == "subproc" and "fork" in multiprocessing.get_all_start_methods():
        options["start_method"] = "fork"  # starts in a second instead of a minute; stepping is equally fast
    venv = make_vec_env(workload.environment_id, num_envs, backend, **workload.arguments, **options)
    trace = vector_trace(workload.scripts(num_envs), AutoresetMode.SAME_STEP)

    def reset() -> None:
        venv.seed(0)
        venv.reset()

    get_masks = (lambda: venv.env_method("action_masks")) if masks else None
    try:
        yield _timed_steps(trace, reset, venv.step, get_masks)
    finally:
        with suppress(OSError, EOFError):  # after Ctrl-C, SB3's processes may have ended
            venv.close()


def game_settings(workload: Workload) -> dict[str, Any]:
    """Arguments of a proposer-verifier game in which every round takes one action of the MDP."""
    configuration = {"appearance": workload.appearance, "start": workload.start}
    return {**configuration, **workload.arguments, "protocol": "joint", "ending": "either"}


@contextmanager
def parallel_game(workload: Workload) -> Iterator[Play]:
    """The PettingZoo parallel environment: the proposer plays the script, the verifier continues."""
    from lilgym_mp.envs.proposer_verifier import AGENTS, parallel_env

    env = parallel_env(**game_settings(workload))
    (script,) = workload.scripts(1)
    proposer, verifier = AGENTS
    games = [(e.task, [{proposer: action, verifier: 0} for action in e.actions]) for e in script.episodes]
    count = sum(len(pairs) for _, pairs in games)

    def play() -> Timing:
        started = perf_counter()
        for task, pairs in games:
            env.reset(options={"task": task})
            for pair in pairs:
                env.step(pair)
        return Timing(count, perf_counter() - started)

    yield play
    env.close()


@contextmanager
def turn_game(workload: Workload, *, checked: bool) -> Iterator[Play]:
    """The PettingZoo AEC environment: each turn calls `step` and `last`."""
    from lilgym_mp.envs.proposer_verifier import env as checked_env
    from lilgym_mp.envs.proposer_verifier import raw_env

    env = (checked_env if checked else raw_env)(**game_settings(workload))
    (script,) = workload.scripts(1)
    games = [(e.task, [turn for action in e.actions for turn in (action, 0)]) for e in script.episodes]
    count = sum(len(turns) for _, turns in games)

    def play() -> Timing:
        started = perf_counter()
        for task, turns in games:
            env.reset(options={"task": task})
            for action in turns:
                env.step(action)
                env.last()
        return Timing(count, perf_counter() - started)

    yield play
    env.close()


@contextmanager
def batched_games(workload: Workload, num_envs: int, *, copy: bool) -> Iterator[Play]:
    """N games in one process."""
    from lilgym_mp.envs.proposer_verifier import AGENTS, BatchedGames

    games = BatchedGames(num_envs, copy=copy, **game_settings(workload))
    trace = vector_trace(workload.scripts(num_envs), AutoresetMode.SAME_STEP)
    proposer, verifier = AGENTS
    continues = np.zeros(num_envs, np.int64)

    def step(row: Any) -> None:
        games.step({proposer: row, verifier: continues})

    yield _timed_steps(trace, lambda: games.reset(seed=0), step, None)
    games.close()
