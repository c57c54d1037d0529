"""An agent that plays shortest solutions, from whatever state it finds."""

from __future__ import annotations

from typing import Any, Protocol, cast

from lilgym_mp.actions import STOP, Action
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.solver.solution import ActionSet, Solution
from lilgym_mp.solver.solver import Solver


class Plays(Protocol):
    """What the expert needs of an environment: the MDP and its current state."""

    @property
    def dynamics(self) -> Dynamics: ...
    @property
    def state(self) -> State: ...


class Expert:
    """Plans in an environment of this package, wrapped or not, and never steps it.

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
        """`budget`: scenes looked at per plan, at most; None is the appearance's own.

        Raises TypeError for what is no environment of this package, ValueError for a budget below 1.
        """
        self._env = _playable(env)
        self._solver = Solver(self._env.dynamics, budget)
        self._awaited: State | None = None  # where the plan goes on
        self._planned: tuple[Action, ...] = ()

    def act(self) -> int:
        """The number of the next action of a shortest solution.

        It plans anew when the state is not the one its last action led to, so it may be asked in any state, such
        as those that a learner strays into. Where it knows no solution it stops: nothing left is worth more.
        """
        state = self._env.state
        if not self._planned or state != self._awaited:
            self._planned = self.plan().actions or (STOP,)
        action, *rest = self._planned
        self._planned = tuple(rest)
        self._awaited = self._env.dynamics.step(state, action).state
        return self._env.dynamics.appearance.encode(action)

    def plan(self) -> Solution:
        """A shortest solution from the current state. Raises ValueError when the episode is over."""
        return self._solver.solve_from(self._env.state)

    def optimal_actions(self) -> ActionSet:
        """The first actions of shortest solutions from the current state."""
        return self._solver.optimal_actions(self._env.state)


def _playable(env: object) -> Plays:
    inner: Any = getattr(env, "unwrapped", env)
    kind = cast("Any", type(inner))  # asked for `state`, which the environment itself has from its first reset only
    if not isinstance(getattr(inner, "dynamics", None), Dynamics) or not hasattr(kind, "state"):
        raise TypeError(f"the expert needs an environment of lilgym_mp with `dynamics` and `state`, not {env!r}")
    return inner
