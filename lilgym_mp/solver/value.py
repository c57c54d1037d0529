"""What a state is worth to one who plays a shortest solution from it."""

from __future__ import annotations

from lilgym_mp.rules import Dynamics, Outcome
from lilgym_mp.solver.solution import Solution


def value(solution: Solution, dynamics: Dynamics, discount: float = 1.0) -> float:
    """The return of the solution; of an immediate STOP where there is none, since nothing left is worth more."""
    worth = dynamics.rules.signals
    if not solution.solved:
        return worth[Outcome.WRONG_STOP].reward
    edits = solution.steps - 1
    edit_worth = worth[Outcome.CONTINUES].reward
    return sum(edit_worth * discount**step for step in range(edits)) + worth[Outcome.SUCCESS].reward * discount**edits
