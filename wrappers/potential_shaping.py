"""Rewards shaped by what the expert still needs. Source: Ng, Harada, Russell 1999 (potential-based shaping)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from lilgym_mp.arrays import Float64Array
from lilgym_mp.rules import State
from lilgym_mp.solver import Solver
from lilgym_mp.solver.value import value
from lilgym_mp.wrappers.env_state import EnvDescription
from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Transformation


class Shaping(Transformation):
    """The potential of a state is the return of the expert's solution from it."""

    changes_rewards = True

    def __init__(self, description: EnvDescription, *, discount: float, budget: int | None) -> None:
        super().__init__(description)
        if not 0 <= discount <= 1:
            raise ValueError(f"discount must be between 0 and 1, not {discount!r}")
        self._discount = discount
        self._solver = Solver(description.dynamics, budget)

    def values(self, states: Sequence[State]) -> Float64Array:
        solutions = map(self._solver.solve_from, states)
        return np.array([value(one, self.env_description.dynamics, self._discount) for one in solutions], np.float64)

    def rewards(self, rewards: Float64Array, before: Float64Array, after: Float64Array) -> Float64Array:
        return rewards + self._discount * after - before


class PotentialShaping(EnvWrapper[Shaping]):
    """Adds `discount` * potential(after) - potential(before) to each reward.

    The potential of a state is the return of the expert's solution from it, and 0 once the episode is over. So
    the best policies stay the best, and an action of a shortest solution is rewarded 0 at once, any other with
    what it loses (discount 1, where the expert's solutions are shortest). Each episode's return falls by its
    start's potential. info["unshaped_reward"] keeps the environment's own reward. In the proposer-verifier game both
    agents' rewards are shaped alike, whenever a turn changes the MDP or ends it.

    The expert solves every state that is entered: about 0.1 ms in Tower, 1 ms in Scatter, sometimes much more.
    `budget`: scenes it looks at per state, None its own; states that it cannot solve count as lost.
    Raises ValueError for a discount outside 0 .. 1 or a budget below 1.
    """

    transformation_class = Shaping

    def __init__(self, env: gym.Env[Any, Any], discount: float = 1.0, budget: int | None = None) -> None:
        super().__init__(env, discount=discount, budget=budget)


potential_shaping_v0 = factory(PotentialShaping)
