"""A task: a statement, its program, the target truth value, the start scene, and the goal that a STOP must reach.

Source: docs/spec.md, "Tasks" (Wu et al. 2023, section 4: a context is a statement and a target).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene

_KEYS = {"id": str, "statement": str, "program": str, "target": bool}  # fields before `start`


class Goal(Protocol):
    """The scenes in which STOP succeeds."""

    def reached_in(self, scene: Scene) -> bool:
        """Whether stopping in the scene succeeds."""
        ...


@dataclass(frozen=True, slots=True)
class ProgramGoal:
    """Each program has its target; a program that raises is false, and counts the error."""

    targets: tuple[tuple[str, bool], ...]  # programs and their targets

    def reached_in(self, scene: Scene) -> bool:
        return all(compile_program(program)(scene) == target for program, target in self.targets)


@dataclass(frozen=True, slots=True)
class Task:
    """Make `statement` have the truth value `target`, from the scene `start`.

    Attributes:
        id: Names the task within its task set.
        statement: The text that agents read.
        program: Its source in the program language; compiled on first use.
        target: The truth value to reach.
        start: The start scene.
        other_goal: Where STOP does not succeed exactly when the program has the target.
        tags: Annotations of the statement by the corpus's authors.
    """

    id: str
    statement: str
    program: str  # source in the program language; compiled on first use
    target: bool
    start: Scene
    other_goal: Goal | None = None  # where STOP does not succeed exactly when the program has the target
    tags: tuple[str, ...] = field(default=(), compare=False)  # annotations of the statement by the corpus's authors

    def __init_subclass__(cls) -> None:
        raise TypeError(
            f"{cls.__name__}: a Task cannot be subclassed; give it an `other_goal` where STOP must reach another goal"
        )

    @property
    def goal(self) -> Goal:
        """What stopping must reach: the goal of another kind, or else the program's truth."""
        return self.other_goal or ProgramGoal(((self.program, self.target),))

    def to_json(self) -> dict[str, object]:
        """All fields except `other_goal` and `tags`; the scene in the released form."""
        return {**{name: getattr(self, name) for name in _KEYS}, "start": self.start.to_json()}

    @classmethod
    def from_json(cls, data: object) -> Task:
        """Reads `to_json`'s form. Checks types and form only: not the program, nor what an appearance allows.

        Args:
            data: The object read from JSON.

        Raises:
            ValueError: Naming the field at fault.
        """
        if not isinstance(data, Mapping):
            raise ValueError(f"a task must be an object, not {data!r:.80}")
        record = cast("Mapping[str, Any]", data)
        for name, expected in _KEYS.items():
            if type(record.get(name)) is not expected:
                raise ValueError(f"a task's {name} must be of type {expected.__name__}, not {record.get(name)!r:.80}")
        return cls(**{name: record[name] for name in _KEYS}, start=Scene.from_json(record.get("start")))

    def truth(self, scene: Scene) -> bool:
        """The statement's truth value in a scene; false if the program raises, which it counts.

        Args:
            scene: The scene.
        """
        return compile_program(self.program)(scene)

    def solved_by(self, scene: Scene) -> bool:
        """Whether STOP succeeds in a scene.

        Args:
            scene: The scene.
        """
        if self.other_goal is not None:
            return self.other_goal.reached_in(scene)
        return compile_program(self.program)(scene) == self.target
