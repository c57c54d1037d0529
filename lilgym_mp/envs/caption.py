"""The lines under a rendered scene."""

from __future__ import annotations

from typing import NamedTuple

from lilgym_mp.actions import describe
from lilgym_mp.appearances import InvalidReason
from lilgym_mp.rules import Dynamics, State, StepResult


class LastAction(NamedTuple):
    """The action that led to the state shown."""

    index: int
    result: StepResult
    invalid: InvalidReason | None


def caption(state: State, dynamics: Dynamics, last: LastAction | None) -> list[str]:
    """The statement, the target with the number of actions taken, and the result of the last action."""
    lines = [
        state.task.statement,
        f"Make it {state.task.target}.  Action {state.steps} of {dynamics.horizon}.",
    ]
    if last is not None:
        name = describe(dynamics.appearance.decode(last.index))
        reason = f" ({last.invalid})" if last.invalid else ""
        lines.append(f"{name}: {last.result.outcome}{reason}, reward {last.result.reward:+.1f}")
    return lines
