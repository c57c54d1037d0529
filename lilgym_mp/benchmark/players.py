"""Players: each runs the environments in one way, and returns a function that plays a workload and times it.

A step is one action of the MDP (in the AEC game, one agent's turn). Resets are timed but do not count as steps, except
the initial one, which seeds the generators and is not timed. Each player is a context manager.

The components of a step are timed on their own while a workload is played; their clock is read around every call, which
adds about a tenth of a microsecond to each figure.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from time import perf_counter
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.benchmark.traces import SPLIT, Trace, Workload, vector_trace
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.render import Canvas, draw
from lilgym_mp.rules import Dynamics, State

COPIES = 2_048  # images copied per play


class Timing(NamedTuple):
    """Steps and their duration."""

    steps: int
    seconds: float


Play = Callable[[], Timing]
Wrap = Callable[[Any], Any]
Component = Callable[[State], object]


def timed(steps: int, work: Callable[[], object], prepare: Callable[[], object] = lambda: None) -> Play:
    """Plays by calling `work`, which takes that many steps, after `prepare`, which is not timed."""

    def play() -> Timing:
        prepare()
        started = perf_counter()
        work()
        return Timing(steps, perf_counter() - started)

    return play


@contextmanager
def copying(workload: Workload, num_envs: int) -> Iterator[Play]:
    """Copying N images: an upper bound on the speed of any environment that copies its observations."""
    image = workload.recorder.reset(seed=0)[0]["image"]
    images = np.repeat(image[None], num_envs, 0)
    count = -(-COPIES // num_envs)

    def copy_all() -> None:
        copy = images.copy
        for _ in range(count):
            copy()

    yield timed(count * num_envs, copy_all)


@contextmanager
def single(workload: Workload, *, wrap: Wrap = lambda env: env, masks: bool = False) -> Iterator[Play]:
    """One environment from `gymnasium.make`; `masks`: also get the mask before each action."""
    env = wrap(workload.make())
    (script,) = workload.scripts(1)
    count = sum(len(episode.actions) for episode in script.episodes)
    get_masks = getattr(env, "action_masks", env.unwrapped.action_masks) if masks else None

    def episodes() -> None:
        step, reset = env.step, env.reset
        for episode in script.episodes:
            for action in episode.actions:
                if get_masks is not None:
                    get_masks()
                step(action)
            reset()

    yield timed(count, episodes, lambda: env.reset(seed=script.seed))
    env.close()


def make_vector(
    workload: Workload, num_envs: int, *, processes: int = 0, copy: bool = True, wrap: Wrap = lambda env: env
) -> Any:
    """One of this package's vector environments; with `processes`, that of workers."""
    if processes:
        return WorkerVectorEnv(workload.environment_id, num_envs, processes, copy=copy, **workload.arguments)
    return wrap(gym.make_vec(workload.environment_id, num_envs=num_envs, copy=copy, **workload.arguments))


@contextmanager
def vector(workload: Workload, num_envs: int, *, masks: bool = False, **options: Any) -> Iterator[Play]:
    """`options` as for `make_vector`."""
    env = make_vector(workload, num_envs, **options)
    trace = vector_trace(workload.scripts(num_envs), env.metadata["autoreset_mode"])
    with closing(env):
        yield _timed_steps(trace, lambda: env.reset(seed=0), env.step, env.action_masks if masks else None)


def _timed_steps(
    trace: Trace, reset: Callable[[], object], step: Callable[[Any], object], get_masks: Callable[[], object] | None
) -> Play:
    def rows() -> None:
        if get_masks is None:
            for row in trace.rows:
                step(row)
        else:
            for row in trace.rows:
                get_masks()
                step(row)

    return timed(trace.actions, rows, reset)


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
def game(workload: Workload, form: str) -> Iterator[Play]:
    """A PettingZoo environment, made by "parallel_env", "raw_env" or "env": the verifier continues after each action.

    In an AEC environment, each turn calls `step` and `last`.
    """
    from lilgym_mp.envs import proposer_verifier

    env = getattr(proposer_verifier, form)(**game_settings(workload))
    is_parallel = form == "parallel_env"
    proposer, verifier = proposer_verifier.AGENTS
    (script,) = workload.scripts(1)
    games: list[tuple[str, list[Any]]] = []
    for episode in script.episodes:
        pairs = [{proposer: action, verifier: 0} for action in episode.actions]
        games.append((episode.task, pairs if is_parallel else [turn for pair in pairs for turn in pair.values()]))

    def play_all() -> None:
        for task, turns in games:
            env.reset(options={"task": task})
            for turn in turns:
                env.step(turn)
                if not is_parallel:
                    env.last()

    yield timed(sum(len(turns) for _, turns in games), play_all)
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


@contextmanager
def component(workload: Workload, make: Callable[[Dynamics], Component], *, every: int = 1) -> Iterator[Play]:
    """A component in all states of every n-th episode; no scene is reused, so nothing is cached."""
    env = workload.recorder
    dynamics, decode = env.dynamics, env.dynamics.appearance.decode
    (script,) = workload.scripts(1)
    games = [
        (env.tasks.by_id(e.task), [decode(action) for action in e.actions[:-1]]) for e in script.episodes[::-every]
    ]

    def states() -> Iterator[State]:
        for task, edits in games:
            state = dynamics.start(task)
            for edit in edits:
                state = dynamics.step(state, edit).state
                yield state

    yield _timed_calls(make(dynamics), states)


def canvas(dynamics: Dynamics) -> Component:
    """Updating the image, without copying it."""
    canvas = Canvas()
    return lambda state: canvas.show(state.scene)


def drawing(dynamics: Dynamics) -> Component:
    """Drawing the whole image, with the reference implementation."""
    return lambda state: draw(state.scene, "half")


@contextmanager
def reset(workload: Workload) -> Iterator[Play]:
    """`reset` of one environment without wrappers after an episode, including the observation."""
    env = workload.settings.make(SPLIT)
    (script,) = workload.scripts(1)

    def ends() -> Iterator[None]:
        env.reset(seed=script.seed)
        for episode in script.episodes:
            for action in episode.actions:
                env.step(action)
            yield

    yield _timed_calls(lambda _: env.reset(), ends)
    env.close()


@contextmanager
def batched_masks(workload: Workload, num_envs: int) -> Iterator[Play]:
    """`action_masks` of a batch, per environment."""
    env = make_vector(workload, num_envs)
    trace = vector_trace(workload.scripts(num_envs), env.metadata["autoreset_mode"])

    def steps() -> Iterator[None]:
        env.reset(seed=0)
        for row in trace.rows:
            env.step(row)
            yield

    yield _timed_calls(lambda _: env.action_masks(), steps, num_envs)
    env.close()


@contextmanager
def batched_reset(workload: Workload, num_envs: int) -> Iterator[Play]:
    """`reset` of a whole batch, per environment."""
    env = make_vector(workload, num_envs)
    env.reset(seed=0)
    resets = 10

    def reset_all() -> None:
        for _ in range(resets):
            env.reset()

    yield timed(resets * num_envs, reset_all)
    env.close()


def _timed_calls(work: Callable[[Any], object], prepare: Callable[[], Iterator[Any]], steps: int = 1) -> Play:
    """Plays by calling `work`, which takes that many steps, with all that `prepare` yields; only calls are timed."""

    def play() -> Timing:
        seconds, count = 0.0, 0
        for argument in prepare():
            started = perf_counter()
            work(argument)
            seconds += perf_counter() - started
            count += steps
        return Timing(count, seconds)

    return play
