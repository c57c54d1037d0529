"""Episodes that start near success, so that learning can begin at the end and work backwards."""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium as gym

from lilgym_mp.solver.curriculum import tasks_near_success
from lilgym_mp.wrappers.env_state import EnvDescription, WrongEnvironment
from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import TaskChange


class NearSuccess(TaskChange):
    """Every task started where so many edits of a shortest solution are left."""

    def __init__(self, description: EnvDescription, *, edits: int, budget: int | None) -> None:
        super().__init__(description)
        mdp = description.dynamics
        self.change = partial(tasks_near_success, mdp.appearance, mdp.rules.name, mdp.horizon, edits, budget)


class ReverseCurriculum(EnvWrapper[NearSuccess]):
    """Starts each episode `edits` edits from success, on a shortest solution of the task that was drawn.

    Tasks that need fewer edits, or for which the expert finds no solution, start where they did; with `edits` 0
    only STOP is left to be learned. Every task is solved when it wraps the first environment of its kind: seconds
    for the official data. `budget`: scenes the expert looks at per task, None its own. It is meant for training.

    It must stand beneath all wrappers but those that change the tasks too.
    Raises ValueError for a negative number of edits or a budget below 1.
    """

    transformation_class = NearSuccess

    def __init__(self, env: gym.Env[Any, Any], edits: int, budget: int | None = None) -> None:
        super().__init__(env, edits=edits, budget=budget)


_lifted = factory(ReverseCurriculum)


def reverse_curriculum_v0(env: Any, edits: int, budget: int | None = None) -> Any:
    """`ReverseCurriculum` around an environment, or around a vector environment of Tower.

    Raises WrongEnvironment for vector environments of Scatter: they have room for what boxes can come to hold from
    the corpus's own starts, and these starts hold more.
    """
    dynamics = getattr(getattr(env, "unwrapped", None), "dynamics", None)
    if isinstance(env, gym.vector.VectorEnv) and dynamics is not None and dynamics.appearance.box_capacity is None:
        raise WrongEnvironment(
            "ReverseCurriculum wraps vector environments of Tower only; for Scatter wrap each environment:"
            ' gymnasium.make_vec(id, vectorization_mode="sync", wrappers=[...], ...)'
        )
    return _lifted(env, edits, budget)
