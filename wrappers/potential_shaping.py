"""Rewards shaped by what the expert still needs. Source: Ng, Harada, Russell 1999 (potential-based shaping)."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
from gymnasium.utils import RecordConstructorArgs

from lilgym_mp.rules import State
from lilgym_mp.solver import Solver
from lilgym_mp.solver.value import value
from lilgym_mp.wrappers.gymnasium_lift import world_of
from lilgym_mp.wrappers.moment import WrongEnvironment

REWARD = "unshaped_reward"  # the info's key


class PotentialShaping(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Adds `discount` * potential(after) - potential(before) to each reward.

    The potential of a state is the return of the expert's solution from it, and 0 once the episode is over. So
    the best policies stay the best, and an action of a shortest solution is rewarded 0 at once, any other with
    what it loses (discount 1, where the expert's solutions are shortest). Each episode's return falls by its
    start's potential. info["unshaped_reward"] keeps the environment's own reward.

    The expert solves every state that is entered: about 0.1 ms in Tower, 1 ms in Scatter, sometimes much more.
    `budget`: scenes it looks at per state, None its own; states that it cannot solve count as lost.
    Raises ValueError for a discount outside 0 .. 1 or a budget below 1.
    """

    def __init__(self, env: gym.Env[Any, Any], discount: float = 1.0, budget: int | None = None) -> None:
        RecordConstructorArgs.__init__(self, discount=discount, budget=budget)
        gym.Wrapper.__init__(self, env)
        if not 0 <= discount <= 1:
            raise ValueError(f"discount must be between 0 and 1, not {discount!r}")
        self._discount = discount
        self._dynamics = world_of(env, type(self).__name__).dynamics
        self._solver = Solver(self._dynamics, budget)
        self._potential = 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        self._potential = self._potential_of(self._state)
        return observation, info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        before = self._potential
        self._potential = 0.0 if terminated or truncated else self._potential_of(self._state)
        shaped = float(reward) + self._discount * self._potential - before
        return observation, shaped, terminated, truncated, {**info, REWARD: reward}

    @property
    def _state(self) -> State:
        return self.env.unwrapped.state  # pyright: ignore[reportAttributeAccessIssue]

    def _potential_of(self, state: State) -> float:
        return value(self._solver.solve_from(state), self._dynamics, self._discount)


def potential_shaping_v0(env: Any, discount: float = 1.0, budget: int | None = None) -> PotentialShaping:
    """`PotentialShaping` around one environment. Raises WrongEnvironment for other kinds, saying what to do."""
    if isinstance(env, gym.Env):
        return PotentialShaping(env, discount, budget)
    raise WrongEnvironment(
        f"PotentialShaping wraps one Gymnasium environment of this package, not {env!r}; for many, wrap each:"
        ' gymnasium.make_vec(id, vectorization_mode="sync", wrappers=[PotentialShaping], ...)'
    )
