"""The value of a state when a shortest solution is played from it."""

from __future__ import annotations

from lilgym_mp.rules import Dynamics, Outcome
from lilgym_mp.solver.solution import Solution


def value(solution: Solution, dynamics: Dynamics, discount: float = 1.0) -> float:
    """The discounted return of the solution; without one, of an immediate STOP, which is then the best action."""
    signals = dynamics.rules.signals
    if not solution.solved:
        return signals[Outcome.WRONG_STOP].reward
    edits = solution.steps - 1
    per_edit, success = signals[Outcome.CONTINUES].reward, signals[Outcome.SUCCESS].reward
    return sum(per_edit * discount**step for step in range(edits)) + success * discount**edits


def edit_cost(dynamics: Dynamics) -> float:
    """The probability of success that makes up for the reward of one more edit."""
    signals = dynamics.rules.signals
    return -signals[Outcome.CONTINUES].reward / (signals[Outcome.SUCCESS].reward - signals[Outcome.WRONG_STOP].reward)
