"""Reverse curriculum: episodes that start near success. Source: Florensa et al. 2017."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import gymnasium as gym

from lilgym_mp.appearances import Appearance
from lilgym_mp.corpus import TaskSet
from lilgym_mp.rules import make_dynamics
from lilgym_mp.solver import Solver
from lilgym_mp.task import Task
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper, factory
from lilgym_mp.wrappers.transformation import EnvDescription, TaskChange, WrongEnvironment

CACHE_SIZE = 8  # task sets


@lru_cache(maxsize=CACHE_SIZE, typed=True)  # typed: True must be refused even after a call with 1
def tasks_near_success(
    appearance: Appearance, rules: str, horizon: int, edits: int, budget: int | None, tasks: TaskSet
) -> TaskSet:
    """The tasks with their starts moved along a shortest solution, to where `edits` edits are left.

    A task that needs fewer edits, or has no known solution, keeps its start. Ids do not change.
    Raises ValueError for a negative number of edits or a budget below 1.
    """
    if isinstance(edits, bool) or not isinstance(edits, int) or edits < 0:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ValueError(f"edits must be a whole number of at least 0, not {edits!r}")
    solver = Solver(make_dynamics(appearance, rules, horizon), budget)
    return TaskSet((_near_success(task, edits, solver) for task in tasks), tasks.provenance)


def _near_success(task: Task, edits: int, solver: Solver) -> Task:
    actions = solver.solve(task).actions
    state = solver.dynamics.start(task)
    for action in actions[: max(0, len(actions) - 1 - edits)]:
        state = solver.dynamics.step(state, action).state
    return replace(task, start=state.scene)


class NearSuccess(TaskChange):
    """Moves every task's start to `edits` edits before the end of a shortest solution."""

    def __init__(self, description: EnvDescription, *, edits: int, budget: int | None) -> None:
        super().__init__(description)
        mdp = description.dynamics
        self.change = partial(tasks_near_success, mdp.appearance, mdp.rules.name, mdp.horizon, edits, budget)


class ReverseCurriculum(EnvWrapper[NearSuccess]):
    """Starts each episode `edits` edits from success, on a shortest solution of the drawn task.

    Tasks that need fewer edits, or that the expert cannot solve, keep their start; with `edits` 0 only STOP remains to
    be learned. All tasks are solved when the first such wrapper is made, which takes seconds for the official corpus.
    `budget`: scenes the expert may examine per task, None for its default. For training only.

    Must be applied before all other wrappers but those that also change the tasks.
    Raises ValueError for a negative number of edits or a budget below 1.
    """

    transformation_class = NearSuccess

    def __init__(self, env: gym.Env[Any, Any], edits: int, budget: int | None = None) -> None:
        super().__init__(env, edits=edits, budget=budget)


_factory = factory(ReverseCurriculum)


def reverse_curriculum_v0(env: Any, edits: int, budget: int | None = None) -> Any:
    """Applies `ReverseCurriculum` to an environment, or to a vector environment of Tower.

    Raises WrongEnvironment for vector environments of Scatter: their buffers have capacity for the items reachable
    from the corpus's starts, and these starts have more.
    """
    dynamics = getattr(getattr(env, "unwrapped", None), "dynamics", None)
    if isinstance(env, gym.vector.VectorEnv) and dynamics is not None and dynamics.appearance.box_capacity is None:
        raise WrongEnvironment(
            "ReverseCurriculum wraps vector environments of Tower only; for Scatter, wrap each environment:"
            ' gymnasium.make_vec(id, vectorization_mode="sync", wrappers=[...], ...)'
        )
    return _factory(env, edits, budget)
