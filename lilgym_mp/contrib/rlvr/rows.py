"""Rows: tasks for language models, complete in themselves, so that replies can be scored without any corpus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

from lilgym_mp.contrib.rlvr.prompts import PROMPTS, dynamics_of
from lilgym_mp.programs import ProgramError, ProgramRuntimeError, compile_program
from lilgym_mp.programs.costs import BOUNDED_STEPS
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import SceneError
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.choices import choose
from lilgym_mp.solver import Solver

FORMAT = "lilgym_mp row 1"
KINDS = tuple(PROMPTS)  # plan, truth, scene, program
BUDGET_SHARE = 100  # the solver examines at most a hundredth of its usual number of scenes


class RowError(ValueError):
    """A row that cannot be scored; the message names what is wrong."""


@dataclass(frozen=True, slots=True)
class Row:
    """One task for a language model.

    plan: make `task.statement` have the value `task.target` from `task.start`. truth: its value in `task.start`. scene:
    a scene in which it has the value `task.target`. program: a program with its meaning.
    """

    kind: str
    appearance: str
    task: Task
    level: int | None = None  # difficulty level of a generated statement
    steps: int | None = None  # actions of a shortest plan from the start, STOP included; None if unknown
    pair: str | None = None  # shared by two truth rows whose scenes are one edit apart

    @property
    def id(self) -> str:
        return self.task.id

    @property
    def prompt(self) -> str:
        """The whole text for the model."""
        return "\n".join(PROMPTS[self.kind](dynamics_of(self.appearance), self.task))

    def to_json(self) -> dict[str, Any]:
        """An unknown level or number of steps is 0, no pair "": rows of all kinds have the same types."""
        return {
            "format": FORMAT,
            "id": self.id,
            "kind": self.kind,
            "appearance": self.appearance,
            "level": self.level or 0,
            "steps": self.steps or 0,
            "pair": self.pair or "",
            "prompt": self.prompt,
            "task": self.task.to_json(),
        }

    @classmethod
    def from_json(cls, data: object) -> Row:
        """Reads `to_json`'s form; the prompt is made anew. Raises RowError for any other data.

        The program must compile and have a value in the start scene, which a plan must have to change.
        """
        record = cast("Mapping[str, Any]", data) if isinstance(data, Mapping) else {}
        if record.get("format") != FORMAT:
            raise RowError(f"a row must have the format {FORMAT!r}, not {record.get('format')!r:.80}")
        try:
            choose("kind", record.get("kind"), PROMPTS)
            choose("appearance", record.get("appearance"), APPEARANCES)
            task = Task.from_json(record.get("task"))
            APPEARANCES[record["appearance"]].check_scene(task.start)
            value = compile_program(task.program).evaluate(task.start, step_limit=BOUNDED_STEPS)
        except (ProgramError, ProgramRuntimeError) as error:
            raise RowError(f"row {task.id!r:.80}: its program: {error}") from None  # pyright: ignore[reportPossiblyUnbound]
        except (ValueError, SceneError) as error:
            raise RowError(f"row {record.get('id')!r:.80}: {error}") from None
        if record["kind"] == "plan" and value == task.target:
            raise RowError(f"row {task.id!r:.80}: the statement has the target value at the start, so there is no plan")
        level, steps, pair = (record.get(name) for name in ("level", "steps", "pair"))
        if not all(each is None or type(each) is int for each in (level, steps)) or not isinstance(pair, str | None):
            raise RowError(f"row {task.id!r:.80}: level and steps must be whole numbers, pair a text, or null")
        return cls(record["kind"], record["appearance"], task, level or None, steps or None, pair or None)


@cache
def solver_of(appearance: str) -> Solver:
    """A solver with a small budget."""
    dynamics = dynamics_of(appearance)
    return Solver(dynamics, Solver(dynamics).budget // BUDGET_SHARE)
