"""The components of a step, each timed on its own while a workload is played.

The clock is read around every call, which adds about a tenth of a microsecond to each figure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from lilgym_mp.benchmark.players import Play, Timing, batched_env, timed
from lilgym_mp.benchmark.traces import Workload, vector_trace
from lilgym_mp.render import Canvas, draw
from lilgym_mp.rules import Dynamics, State

Component = Callable[[State], object]


@contextmanager
def truth(workload: Workload) -> Iterator[Play]:
    """Evaluating the program in a scene: whether STOP would succeed."""
    yield _timed_in_states(workload, lambda dynamics: dynamics.goal_reached)


@contextmanager
def mask(workload: Workload) -> Iterator[Play]:
    """The mask of all actions."""
    yield _timed_in_states(workload, lambda dynamics: dynamics.legal_mask)


@contextmanager
def image_update(workload: Workload) -> Iterator[Play]:
    """Updating the image, without copying it."""
    canvas = Canvas()
    yield _timed_in_states(workload, lambda dynamics: lambda state: canvas.show(state.scene))


@contextmanager
def full_image(workload: Workload) -> Iterator[Play]:
    """Drawing the whole image, with the reference implementation."""
    yield _timed_in_states(workload, lambda dynamics: lambda state: draw(state.scene, "half"), every=20)


@contextmanager
def reset(workload: Workload) -> Iterator[Play]:
    """`reset` of one environment without wrappers after an episode, including the observation."""
    env = workload.make_bare()
    (script,) = workload.scripts(1)

    def play() -> Timing:
        seconds = 0.0
        env.reset(seed=script.seed)
        for episode in script.episodes:
            for action in episode.actions:
                env.step(action)
            started = perf_counter()
            env.reset()
            seconds += perf_counter() - started
        return Timing(len(script.episodes), seconds)

    yield play
    env.close()


@contextmanager
def batched_masks(workload: Workload, num_envs: int) -> Iterator[Play]:
    """`action_masks` of a batch, per environment."""
    env = batched_env(workload, num_envs)
    trace = vector_trace(workload.scripts(num_envs), env.metadata["autoreset_mode"])

    def play() -> Timing:
        seconds = 0.0
        env.reset(seed=0)
        for row in trace.rows:
            env.step(row)
            started = perf_counter()
            env.action_masks()
            seconds += perf_counter() - started
        return Timing(len(trace.rows) * num_envs, seconds)

    yield play
    env.close()


@contextmanager
def batched_reset(workload: Workload, num_envs: int) -> Iterator[Play]:
    """`reset` of a whole batch, per environment."""
    env = batched_env(workload, num_envs, copy=True)
    env.reset(seed=0)
    resets = 10

    def reset_all() -> None:
        for _ in range(resets):
            env.reset()

    yield timed(resets * num_envs, reset_all)
    env.close()


def _timed_in_states(workload: Workload, make_component: Callable[[Dynamics], Component], *, every: int = 1) -> Play:
    """Times a component in all states of every n-th episode; no scene is reused, so nothing is cached."""
    env = workload.recorder
    dynamics, decode = env.dynamics, env.dynamics.appearance.decode
    component = make_component(dynamics)
    (script,) = workload.scripts(1)
    games = [
        (env.tasks.by_id(e.task), [decode(action) for action in e.actions[:-1]]) for e in script.episodes[::-every]
    ]

    def play() -> Timing:
        seconds, count = 0.0, 0
        for task, edits in games:
            state = dynamics.start(task)
            for edit in edits:
                state = dynamics.step(state, edit).state
                started = perf_counter()
                component(state)
                seconds += perf_counter() - started
                count += 1
        return Timing(count, seconds)

    return play
