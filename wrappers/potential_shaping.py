"""Potential-based reward shaping with the expert's returns. Source: Ng, Harada, Russell 1999."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from lilgym_mp.arrays import Float64Array
from lilgym_mp.rules import State
from lilgym_mp.solver import Solver
from lilgym_mp.solver.solution import value
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import EnvDescription, Transformation


class Shaping(Transformation):
    """The potential of a state is the return of the expert's solution from it."""

    changes_rewards = True

    def __init__(self, description: EnvDescription, *, discount: float, budget: int | None) -> None:
        super().__init__(description)
        if not 0 <= discount <= 1:
            raise ValueError(f"discount must be between 0 and 1, not {discount!r}")
        self._discount = discount
        self._solver = Solver(description.dynamics, budget)

    def potentials(self, states: Sequence[State]) -> Float64Array:
        solutions = map(self._solver.solve_from, states)
        return np.array([value(one, self.env_description.dynamics, self._discount) for one in solutions], np.float64)

    def rewards(self, rewards: Float64Array, before: Float64Array, after: Float64Array) -> Float64Array:
        return rewards + self._discount * after - before


class PotentialShaping(EnvWrapper[Shaping]):
    """Adds `discount` * potential(after) - potential(before) to each reward.

    The potential of a state is the return of the expert's solution from it, and 0 after the end of the episode. This
    preserves optimal policies. With discount 1 and shortest solutions by the expert, an optimal action gets reward 0,
    any other minus the return it loses. Each episode's return is reduced by the potential of its start. Infos keep the
    environment's reward as "unshaped_reward". In the proposer-verifier game both agents' rewards are shaped, whenever a
    turn changes the MDP or ends it.

    The expert solves every state visited: about 0.1 ms in Tower, 1 ms in Scatter, sometimes much more. `budget`: scenes
    it may examine per state, None for its default; a state that it cannot solve counts as lost.
    Raises ValueError for a discount outside 0 .. 1 or a budget below 1.
    """

    transformation_class = Shaping

    def __init__(self, env: gym.Env[Any, Any], discount: float = 1.0, budget: int | None = None) -> None:
        super().__init__(env, discount=discount, budget=budget)
