"""The expert: an agent that plays shortest solutions from any state."""

from __future__ import annotations

from typing import Any, cast

from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.scene.actions import STOP, Action
from lilgym_mp.solver.solution import ActionSet, Solution
from lilgym_mp.solver.solver import Solver


class Expert:
    """Plans in an environment of this package, which may be wrapped. It never steps the environment.

    >>> import gymnasium as gym, lilgym_mp
    >>> env = gym.make("lilgym_mp/TowerFlipIt-v0")
    >>> expert = Expert(env)
    >>> _ = env.reset(seed=0)
    >>> ended = False
    >>> while not ended:
    ...     _, reward, terminated, truncated, info = env.step(expert.act())
    ...     ended = terminated or truncated
    >>> info["outcome"]
    'success'
    """

    def __init__(self, env: object, budget: int | None = None) -> None:
        """Prepares a solver for the environment's rules.

        Args:
            env: An environment of this package, which may be wrapped.
            budget: How many scenes a plan may examine; None is the default of the appearance.

        Raises:
            TypeError: If `env` is not an environment of this package.
            ValueError: For a budget below 1.
        """
        base: Any = getattr(env, "unwrapped", env)
        base_type = cast("Any", type(base))  # `base.state` raises before the first reset, so ask the type
        if not isinstance(getattr(base, "dynamics", None), Dynamics) or not hasattr(base_type, "state"):
            raise TypeError(f"the expert needs an environment of lilgym-mp with `dynamics` and `state`, not {env!r}")
        self._env = base
        self._solver = Solver(self._env.dynamics, budget)
        self._expected: State | None = None  # the state in which the plan continues
        self._planned: tuple[Action, ...] = ()

    def act(self) -> int:
        """The index of the next action of a shortest solution.

        Replans whenever the state is not the one that its last action led to, so it can advise a learner in any state.
        Without a solution the action is STOP, which then loses least.
        """
        state = self._env.state
        if not self._planned or state != self._expected:
            self._planned = self.plan().actions or (STOP,)
        action, *rest = self._planned
        self._planned = tuple(rest)
        self._expected = self._env.dynamics.step(state, action).state
        return self._env.dynamics.appearance.encode(action)

    def plan(self) -> Solution:
        """A shortest solution from the current state.

        Raises:
            ValueError: If the episode is over.
        """
        return self._solver.solve_from(self._env.state)

    def optimal_actions(self) -> ActionSet:
        """The first actions of shortest solutions from the current state."""
        return self._solver.optimal_actions(self._env.state)
