"""The solver's results: solutions and their values, and sets of optimal first actions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from lilgym_mp.envs.rules import Dynamics, Outcome
from lilgym_mp.scene.actions import Action
from lilgym_mp.solver.layered_search import Budget


class Status(StrEnum):
    """The result of a search."""

    SOLVED = "solved"
    UNSOLVABLE = "unsolvable"  # proven: nothing within the horizon succeeds
    NOT_FOUND = "not_found"  # neither a solution nor a proof that there is none


@dataclass(frozen=True, slots=True)
class Solution:
    """The best solution found from one state.

    Attributes:
        status: Whether a solution was found, proven impossible, or not found within the budget.
        actions: Edits, then STOP; empty when not solved.
        least_edits: Proven lower bound on the edits of any solution.
        scenes: Number of scenes examined by the search.
        reason: Why there is no solution.
    """

    status: Status
    actions: tuple[Action, ...]  # edits, then STOP; empty when not solved
    least_edits: int  # proven lower bound on the edits of any solution
    scenes: int  # number of scenes examined by the search
    reason: str = ""  # why there is no solution

    @property
    def solved(self) -> bool:
        """Whether a plan was found."""
        return self.status is Status.SOLVED

    @property
    def steps(self) -> int:
        """Actions to success, STOP included; 0 when not solved."""
        return len(self.actions)

    @property
    def proven_optimal(self) -> bool:
        """Whether the solution attains the lower bound, so that none is shorter."""
        return self.solved and self.least_edits == self.steps - 1


@dataclass(frozen=True, slots=True)
class ActionSet:
    """The first actions of shortest solutions from one state."""

    actions: tuple[int, ...]  # action indices, ascending; empty when no solution is known
    complete: bool  # whether every first action of a shortest solution is included
    steps: int  # actions to success, STOP included; 0 when no solution is known


def solved(actions: tuple[Action, ...], least_edits: int, budget: Budget) -> Solution:
    """The solution with a shortest plan."""
    return Solution(Status.SOLVED, actions, least_edits, budget.spent)


def unsolvable(reason: str, least_edits: int, budget: Budget) -> Solution:
    """The solution that proves that there is no plan, and why."""
    return Solution(Status.UNSOLVABLE, (), least_edits, budget.spent, reason)


def not_found(least_edits: int, budget: Budget, reason: str = "") -> Solution:
    """The solution of a search that gave up; `least_edits` is what it proved so far."""
    reason = reason or f"nothing found in {budget.spent:,} scenes; a larger budget may help"
    return Solution(Status.NOT_FOUND, (), least_edits, budget.spent, reason)


def value(solution: Solution, dynamics: Dynamics, discount: float = 1.0) -> float:
    """The discounted return of the solution; without one, of an immediate STOP, which is then the best action."""
    signals = dynamics.rules.signals
    if not solution.solved:
        return signals[Outcome.WRONG_STOP].reward
    edits = solution.steps - 1
    per_edit = signals[Outcome.CONTINUES].reward
    success = signals[Outcome.SUCCESS].reward
    return sum(per_edit * discount**step for step in range(edits)) + success * discount**edits
