"""A task: a statement, its program, the target truth value and the start scene.

Source: docs/spec.md, "Tasks" (Wu et al. 2023, section 4: a context is a statement and a target).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene

_KEYS: Mapping[str, type] = {"id": str, "statement": str, "program": str, "target": bool}  # fields before `start`


@dataclass(frozen=True, slots=True)
class Task:
    """Make `statement` have the truth value `target`, from the scene `start`."""

    id: str
    statement: str
    program: str  # source in the program language; compiled on first use
    target: bool
    start: Scene

    def to_json(self) -> dict[str, object]:
        """All fields; the scene in the released form."""
        return {**{name: getattr(self, name) for name in _KEYS}, "start": self.start.to_json()}

    @classmethod
    def from_json(cls, data: object) -> Task:
        """Reads `to_json`'s form. Checks types and form only: not the program, nor what an appearance allows.

        Raises ValueError naming the field at fault.
        """
        if not isinstance(data, Mapping):
            raise ValueError(f"a task must be an object, not {data!r:.80}")
        record = cast("Mapping[str, Any]", data)
        for name, expected in _KEYS.items():
            if type(record.get(name)) is not expected:
                raise ValueError(f"a task's {name} must be of type {expected.__name__}, not {record.get(name)!r:.80}")
        return cls(**{name: record[name] for name in _KEYS}, start=Scene.from_json(record.get("start")))

    def truth(self, scene: Scene) -> bool:
        """The statement's truth value in `scene`; false if the program raises, which it counts."""
        return compile_program(self.program)(scene)

    def solved_by(self, scene: Scene) -> bool:
        """Whether STOP succeeds in `scene`."""
        return compile_program(self.program)(scene) == self.target
