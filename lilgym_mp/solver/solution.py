"""What a solver answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from lilgym_mp.actions import Action
from lilgym_mp.solver.search import Budget


class Status(StrEnum):
    """How far a search came."""

    SOLVED = "solved"
    UNSOLVABLE = "unsolvable"  # proven: nothing within the horizon succeeds
    NOT_FOUND = "not_found"  # neither a solution nor a proof that there is none


@dataclass(frozen=True, slots=True)
class Solution:
    """The best that was found from one state."""

    status: Status
    actions: tuple[Action, ...]  # edits, then STOP; empty when not solved
    least_edits: int  # proven: no solution has fewer edits
    scenes: int  # looked at by the search
    reason: str = ""  # why there is no solution

    @property
    def solved(self) -> bool:
        return self.status is Status.SOLVED

    @property
    def steps(self) -> int:
        """Actions to success, STOP included; 0 when not solved."""
        return len(self.actions)

    @property
    def proven_optimal(self) -> bool:
        """Whether no shorter sequence succeeds."""
        return self.solved and self.least_edits == self.steps - 1


@dataclass(frozen=True, slots=True)
class ActionSet:
    """First actions of shortest solutions."""

    actions: tuple[int, ...]  # as the appearance numbers them, ascending; empty when no solution is known
    complete: bool  # whether every action that starts a shortest solution is among them
    steps: int  # actions to success, STOP included; 0 when no solution is known


def solved(actions: tuple[Action, ...], least_edits: int, budget: Budget) -> Solution:
    return Solution(Status.SOLVED, actions, least_edits, budget.scenes_looked_at)


def unsolvable(reason: str, least_edits: int, budget: Budget) -> Solution:
    return Solution(Status.UNSOLVABLE, (), least_edits, budget.scenes_looked_at, reason)


def not_found(least_edits: int, budget: Budget, reason: str = "") -> Solution:
    reason = reason or f"nothing found in {budget.scenes_looked_at:,} scenes; a larger budget may help"
    return Solution(Status.NOT_FOUND, (), least_edits, budget.scenes_looked_at, reason)
