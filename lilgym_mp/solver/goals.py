"""What the searches ask of a task's goal."""

from __future__ import annotations

from lilgym_mp.programs.task import ProgramGoal, Task


def has_program_goal(task: Task) -> bool:
    """Whether success depends on program values alone, unlike e.g. in `corpus.matching`."""
    return isinstance(task.goal, ProgramGoal)


def programs_of(task: Task) -> tuple[str, ...]:
    """The programs in the task's goal; the task's own if the goal is of another kind."""
    return tuple(program for program, _ in _targets_of(task))


def target_bits(task: Task) -> int:
    """The targets of `programs_of(task)` as a bit mask; bit i is the target of program i."""
    return sum(1 << index for index, (_, target) in enumerate(_targets_of(task)) if target)


def _targets_of(task: Task) -> tuple[tuple[str, bool], ...]:
    return task.goal.targets if isinstance(task.goal, ProgramGoal) else ((task.program, task.target),)
