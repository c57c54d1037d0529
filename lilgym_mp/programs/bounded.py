"""Truth values of programs of unknown origin, within a total time."""

from __future__ import annotations

from collections.abc import Sequence

from lilgym_mp.programs import costs
from lilgym_mp.programs.errors import ProgramRuntimeError, StepLimitError
from lilgym_mp.programs.reference import Evaluation, build_closure, evaluate
from lilgym_mp.programs.syntax import own_size, parse
from lilgym_mp.scene import Scene


def bounded_truths(source: str, scenes: Sequence[Scene], *, step_limit: int = costs.BOUNDED_STEPS) -> list[bool | None]:
    """The truth values of a program of unknown origin, None where it has none, within a total time.

    Compiling nothing and caching nothing, it takes at most about 40 milliseconds with the default limit on the steps of
    all evaluations together. Raises ProgramError when `source` is not a valid program, StepLimitError beyond the limit.
    """
    closure = build_closure(tree := parse(source))
    size = own_size(tree)
    truths: list[bool | None] = []
    steps_left = step_limit
    for scene in scenes:
        evaluation = Evaluation(scene, steps_left)
        try:
            evaluation.charge(size)
            truths.append(evaluate(closure, evaluation))
        except StepLimitError:
            raise StepLimitError(f"the program needs more than {step_limit} steps on {len(scenes)} scenes") from None
        except ProgramRuntimeError:
            truths.append(None)
        steps_left = evaluation.steps_left
    return truths
