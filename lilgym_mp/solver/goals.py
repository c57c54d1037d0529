"""Goals as programs with target values, and tasks whose goal is a conjunction of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task


@dataclass(frozen=True, slots=True)
class ConjunctiveTask(Task):
    """A task that also requires further programs to have their targets. Errors count as false, as in `Task.truth`."""

    others: tuple[tuple[str, bool], ...] = ()  # programs and their targets

    def solved_by(self, scene: Scene) -> bool:
        return all(compile_program(program)(scene) == target for program, target in _goals_of(self))


def conjunctive_task(goals: Sequence[tuple[str, bool]], start: Scene) -> Task:
    """The task of giving each program its target; `goals` has at least one (program, target) pair."""
    (program, target), *others = goals
    if others:
        return ConjunctiveTask("", "", program, target, start, tuple(others))
    return Task("", "", program, target, start)


def programs_of(task: Task) -> tuple[str, ...]:
    """The programs in the task's goal."""
    return tuple(program for program, _ in _goals_of(task))


def target_bits(task: Task) -> int:
    """The targets of `programs_of(task)` as a bit mask; bit i is the target of program i."""
    return sum(1 << index for index, (_, target) in enumerate(_goals_of(task)) if target)


def _goals_of(task: Task) -> tuple[tuple[str, bool], ...]:
    others = task.others if isinstance(task, ConjunctiveTask) else ()
    return ((task.program, task.target), *others)


def has_program_goal(task: Task) -> bool:
    """Whether success depends on program values alone, unlike e.g. in `corpus.matching`."""
    return type(task).solved_by in (Task.solved_by, ConjunctiveTask.solved_by)
