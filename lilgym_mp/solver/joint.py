"""Several truth values wanted at once: the conjunction of programs, each with its target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task


@dataclass(frozen=True, slots=True)
class JointTask(Task):
    """A task whose success is that other programs, too, have their targets. Each counts as in `Task.truth`."""

    others: tuple[tuple[str, bool], ...] = ()  # programs and their targets

    def solved_by(self, scene: Scene) -> bool:
        if compile_program(self.program)(scene) != self.target:
            return False
        return all(compile_program(program)(scene) == target for program, target in self.others)


def joint_task(wanted: Sequence[tuple[str, bool]], start: Scene) -> Task:
    """The task of giving each of these programs, at least one, its target."""
    (program, target), *others = wanted
    return JointTask("", "", program, target, start, tuple(others)) if others else Task("", "", program, target, start)


def programs_of(task: Task) -> tuple[str, ...]:
    """The programs on whose truth a task's success hangs."""
    others = task.others if isinstance(task, JointTask) else ()
    return (task.program, *(program for program, _ in others))


def truths_wanted(task: Task) -> int:
    """Which of `programs_of` a task wants to be true, the first as the lowest bit."""
    others = task.others if isinstance(task, JointTask) else ()
    return sum(1 << number for number, target in enumerate((task.target, *(target for _, target in others))) if target)


def judged_by_program(task: Task) -> bool:
    """Whether success is the truth of programs, and not something else as in `corpus.matching`."""
    return type(task).solved_by in (Task.solved_by, JointTask.solved_by)
