"""The expert's distance to the goal, for the reward term `progress`. The one module of `envs` that uses the solver."""

from __future__ import annotations

import math

from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.scene import Scene
from lilgym_mp.solver import Solver

MOST_KNOWN = 400_000  # distances kept


class GoalDistance:
    """The number of actions in a shortest solution from a state, whatever the round; NaN where none is found."""

    def __init__(self, dynamics: Dynamics) -> None:
        """Raises ValueError for an appearance without a solver."""
        self._solver = Solver(dynamics)
        self._known: dict[tuple[str, bool, Scene], float] = {}  # by program, target and scene

    def __call__(self, mdp: State) -> float:
        key = mdp.task.program, mdp.task.target, mdp.scene
        if key not in self._known:
            if len(self._known) >= MOST_KNOWN:
                self._known.clear()
            self._known[key] = self._solver.distance(mdp) or math.nan
        return self._known[key]
