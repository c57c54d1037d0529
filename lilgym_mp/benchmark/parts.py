"""What a step is made of, each part timed alone while a course is played.

The clock is read around every call, so each figure holds about a tenth of a microsecond of reading it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from lilgym_mp.benchmark.players import Play, Timed, batched_env
from lilgym_mp.benchmark.traces import Workload, vector_trace
from lilgym_mp.render import Canvas, draw
from lilgym_mp.rules import Dynamics, State

Part = Callable[[State], object]


def _in_play(workload: Workload, make_part: Callable[[Dynamics], Part], *, every: int = 1) -> Play:
    """The time that a part takes in every n-th episode's states, each scene met for the first time."""
    env = workload.recorder
    dynamics, decode = env.dynamics, env.dynamics.appearance.decode
    part = make_part(dynamics)
    (script,) = workload.scripts(1)
    games = [
        (env.tasks.by_id(e.task), [decode(action) for action in e.actions[:-1]]) for e in script.episodes[::-every]
    ]

    def play() -> Timed:
        seconds, count = 0.0, 0
        for task, edits in games:
            state = dynamics.start(task)
            for edit in edits:
                state = dynamics.step(state, edit).state
                started = perf_counter()
                part(state)
                seconds += perf_counter() - started
                count += 1
        return Timed(count, seconds)

    return play


@contextmanager
def truth(workload: Workload) -> Iterator[Play]:
    """Whether STOP would succeed: the program's truth in the scene."""
    yield _in_play(workload, lambda dynamics: dynamics.goal_reached)


@contextmanager
def mask(workload: Workload) -> Iterator[Play]:
    """The mask of all actions."""
    yield _in_play(workload, lambda dynamics: dynamics.legal_mask)


@contextmanager
def image(workload: Workload) -> Iterator[Play]:
    """Bringing the image up to date, without copying it."""
    canvas = Canvas()
    yield _in_play(workload, lambda dynamics: lambda state: canvas.show(state.scene))


@contextmanager
def whole_image(workload: Workload) -> Iterator[Play]:
    """Drawing a scene from nothing, as the image is defined."""
    yield _in_play(workload, lambda dynamics: lambda state: draw(state.scene, "half"), every=20)


@contextmanager
def reset(workload: Workload) -> Iterator[Play]:
    """`reset` of one environment without wrappers, after an episode, its observation included."""
    env = workload.make_bare()
    (script,) = workload.scripts(1)

    def play() -> Timed:
        seconds = 0.0
        env.reset(seed=script.seed)
        for episode in script.episodes:
            for action in episode.actions:
                env.step(action)
            started = perf_counter()
            env.reset()
            seconds += perf_counter() - started
        return Timed(len(script.episodes), seconds)

    yield play
    env.close()


@contextmanager
def batched_masks(workload: Workload, num_envs: int) -> Iterator[Play]:
    """`action_masks` of a batch, an environment's share."""
    env = batched_env(workload, num_envs)
    trace = vector_trace(workload.scripts(num_envs), env.metadata["autoreset_mode"])

    def play() -> Timed:
        seconds = 0.0
        env.reset(seed=0)
        for row in trace.rows:
            env.step(row)
            started = perf_counter()
            env.action_masks()
            seconds += perf_counter() - started
        return Timed(len(trace.rows) * num_envs, seconds)

    yield play
    env.close()


@contextmanager
def batched_reset(workload: Workload, num_envs: int) -> Iterator[Play]:
    """`reset` of a whole batch, an environment's share."""
    env = batched_env(workload, num_envs, copy=True)
    env.reset(seed=0)
    resets = 10

    def play() -> Timed:
        started = perf_counter()
        for _ in range(resets):
            env.reset()
        return Timed(resets * num_envs, perf_counter() - started)

    yield play
    env.close()
