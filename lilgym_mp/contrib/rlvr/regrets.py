"""Credit for each action of a plan task: the return that it loses against the expert, as in `PotentialShaping`."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

from lilgym_mp.contrib.rlvr.rows import dynamics_of, solver_of
from lilgym_mp.envs.rules import Outcome, State
from lilgym_mp.solver.solution import Solution, Status, value

KNOWN_STATES = 16_384  # whose solutions are cached
DECIMALS = 6


class Credit(NamedTuple):
    """What an action lost. None: the solver proved nothing within its budget (`solver_of`)."""

    regret: float | None  # return of the paper's rules that it lost, at least 0
    distance_before: int | None  # actions of a shortest solution, STOP included; None also if there is none
    distance_after: int | None  # the same; 0 after success, None after another end


def credit(appearance: str, before: State, after: State, outcome: str, *, asked_again: bool = False) -> Credit:
    """The credit of an action, or of the last of several replies without one, with an outcome that the rules lack.

    `asked_again`: there was no action, but the episode continues.
    """
    dynamics = dynamics_of(appearance)
    signals = dynamics.rules.signals
    first = solution_from(appearance, before)
    potential = _potential(appearance, first)
    distance = first.steps or None if potential is not None else None
    if asked_again:
        return Credit(None if potential is None else 0.0, distance, distance)
    if outcome != Outcome.CONTINUES:
        ended = Outcome(outcome) if outcome in list(Outcome) else Outcome.INVALID_ACTION
        left = 0.0
        later = 0 if ended is Outcome.SUCCESS else None
        reward = signals[ended].reward
    else:
        second = solution_from(appearance, after)
        left = _potential(appearance, second)
        later = second.steps or None
        reward = signals[Outcome.CONTINUES].reward
    if potential is None or left is None:
        return Credit(None, distance, later if left is not None else None)
    return Credit(round(potential - reward - left, DECIMALS) + 0.0, distance, later)  # no -0.0


@lru_cache(maxsize=KNOWN_STATES)
def solution_from(appearance: str, state: State) -> Solution:
    """The solution that the small-budget solver finds from a state."""
    return solver_of(appearance).solve_from(state)


def _potential(appearance: str, solution: Solution) -> float | None:
    """The return of the solution if it is proven best."""
    is_exact = solution.proven_optimal or solution.status is Status.UNSOLVABLE
    return value(solution, dynamics_of(appearance)) if is_exact else None
