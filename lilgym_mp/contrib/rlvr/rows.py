"""Rows: tasks for language models, complete in themselves, so that replies can be scored without any corpus.

Each prompt states the rules, the task and the form of the answer.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

from PIL import Image

from lilgym_mp.envs.rules import Dynamics, State, make_dynamics
from lilgym_mp.programs import ProgramError, ProgramRuntimeError, compile_program
from lilgym_mp.programs.costs import BOUNDED_STEPS
from lilgym_mp.programs.task import Task
from lilgym_mp.programs.words import WORDS
from lilgym_mp.scene import SceneError
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.scene.arrays import AnyDict
from lilgym_mp.scene.choices import choose
from lilgym_mp.solver import Solver
from lilgym_mp.wrappers.text import SCENE_STYLES, content_of, picture, shown_lines

FORMAT = "lilgym_mp row 2"
BUDGET_SHARE = 100  # the solver examines at most a hundredth of its usual number of scenes
WITH_PICTURE = ("plan", "truth", "verify")  # kinds
PICTURE = "A picture has three boxes with items in them."
ANSWER_LAST = 'You may think before; a thought in "<think>...</think>" is not read.'
SYNTAX = (
    "A program is one expression, true or false of a picture, in a small part of Python: the names all_boxes and"
    " all_items, lambdas, and, or, not, comparisons, +, integers, lists, sets, Color.YELLOW, Color.BLACK, Color.BLUE,"
    " Shape.CIRCLE, Shape.SQUARE, Shape.TRIANGLE, Size.SMALL, Size.MEDIUM, Size.BIG, Side.TOP, Side.BOTTOM, Side.LEFT,"
    " Side.RIGHT, Side.ANY, box.all_items_in_box(), box.is_tower(), item.box, item.color, item.shape, item.size, and"
    " these functions:"
)


class RowError(ValueError):
    """A row that cannot be scored; the message names what is wrong."""


@dataclass(frozen=True, slots=True)
class Row:
    """One task for a language model.

    plan: make `task.statement` have the value `task.target` from `task.start`. truth: its value in `task.start`.
    verify: whether the claim is true that it has the value `task.target` in `task.start`.
    program: a program with its meaning.
    """

    kind: str
    appearance: str
    task: Task
    level: int | None = None  # difficulty level of a generated statement
    steps: int | None = None  # actions of a shortest plan from the start, STOP included; None if unknown

    @property
    def id(self) -> str:
        """Identifies the row; replies to score name it."""
        return self.task.id

    @property
    def prompt(self) -> str:
        """The whole text for the model."""
        return _prompt(self, "list")

    def to_json(self) -> AnyDict:
        """An unknown level or number of steps is 0, and the start scene is JSON text: in tables, columns of rows of all
        kinds have the same types."""
        return {
            "format": FORMAT,
            "id": self.id,
            "kind": self.kind,
            "appearance": self.appearance,
            "level": self.level or 0,
            "steps": self.steps or 0,
            "prompt": self.prompt,
            "task": {**self.task.to_json(), "start": json.dumps(self.task.start.to_json())},
        }

    @classmethod
    def from_json(cls, data: object) -> Row:
        """Reads `to_json`'s form; the prompt is made again. Raises RowError for any other data.

        The program must compile and have a value in the start scene, which a plan must have to change.
        """
        record = cast("Mapping[str, Any]", data) if isinstance(data, Mapping) else {}
        if record.get("format") != FORMAT:
            raise RowError(f"a row must have the format {FORMAT!r}, not {record.get('format')!r:.80}")
        try:
            kind, appearance, told = (cast("Any", record.get(name)) for name in ("kind", "appearance", "task"))
            choose("kind", kind, _PROMPTS)
            if isinstance(told, Mapping):
                fields = cast("Mapping[str, Any]", told)
                told = {**fields, "start": json.loads(fields.get("start", "null"))}
            task = Task.from_json(told)
            make_appearance(appearance).check_scene(task.start)
            value = compile_program(task.program).evaluate(task.start, step_limit=BOUNDED_STEPS)
            if kind == "plan" and value == task.target:
                raise ValueError("the statement has the target value at the start, so there is no plan")
            level, steps = (record.get(name) or None for name in ("level", "steps"))
            if {type(level), type(steps)} - {int, type(None)}:
                raise ValueError("level and steps must be whole numbers or null")
        except (ProgramError, ProgramRuntimeError, ValueError, TypeError, RecursionError, SceneError) as error:
            raise RowError(f"row {record.get('id')!r:.80}: {error}") from None
        return cls(kind, appearance, task, level, steps)


@cache
def dynamics_of(appearance: str) -> Dynamics:
    """The rules under which plans are made: the paper's, on the released grid. Raises ValueError."""
    return make_dynamics(make_appearance(appearance))


@cache
def solver_of(appearance: str) -> Solver:
    """A solver with a small budget."""
    dynamics = dynamics_of(appearance)
    return Solver(dynamics, Solver(dynamics).budget // BUDGET_SHARE)


def right_answer(row: Row) -> bool:
    """The answer to a truth or verify row."""
    task = row.task
    return task.truth(task.start) if row.kind == "truth" else task.solved_by(task.start)


def expert_reply(row: Row) -> str:
    """A right reply."""
    if row.kind in ("truth", "verify"):
        return str(right_answer(row)).lower()
    if row.kind == "program":
        return row.task.program
    solver = solver_of(row.appearance)
    solution = solver.solve(row.task)
    if not solution.solved:  # the generator searches so, and finds more
        solution = solver.solve_distant(State(row.task, row.task.start, 0), 1)
    return "\n".join(map(describe, solution.actions))


def _prompt(row: Row, scene: str) -> str:
    return "\n".join(_PROMPTS[row.kind](dynamics_of(row.appearance), row.task, scene))


def images_of(row: Row) -> list[Image.Image]:
    """The picture of a plan or truth row, in a list as TRL's column "images"; empty for other rows."""
    return [picture(row.task.start)] if row.kind in WITH_PICTURE else []


def messages_of(row: Row, scene: str = "list", *, inline: bool = True) -> list[AnyDict]:
    """The prompt as one user message. `scene`: "list", "image" or "both", of rows with a picture.

    A picture is a content part before the text: PNG in a data URL, as OpenAI's chat API takes it, or, unless `inline`,
    {"type": "image"}, which stands for `images_of(row)`, as in TRL and transformers. Raises ValueError for another
    style, and for a picture of a row without one.
    """
    is_seen = choose("scene", scene, SCENE_STYLES)
    if is_seen and row.kind not in WITH_PICTURE:
        raise ValueError(f"a {row.kind} row has no picture to show; choose from {', '.join(WITH_PICTURE)} rows")
    images = images_of(row) if is_seen else []
    return [{"role": "user", "content": content_of(_prompt(row, scene), images, inline=inline)}]


def _plan_lines(dynamics: Dynamics, task: Task, scene: str) -> Iterator[str]:
    appearance = dynamics.appearance
    yield (
        f"{PICTURE} You are told a statement about it, and whether to make it true or false. Write a plan that does"
        f" so, of at most {dynamics.horizon} actions, the last one STOP. An action that is illegal when it is taken"
        " ends the plan without success."
    )
    yield from appearance.explain(dynamics.rules.placement)
    yield "Answer with one action on each line, in order, ending with STOP, such as"
    yield from (describe(appearance.example), "STOP", f"Write nothing else on these lines. {ANSWER_LAST}")
    yield f"Statement: {task.statement}"
    yield f"Make the statement {str(task.target).lower()}."
    yield from shown_lines(task.start, appearance, scene)


def _truth_lines(dynamics: Dynamics, task: Task, scene: str) -> Iterator[str]:
    yield f"{PICTURE} You are told a statement about it. Is the statement true or false?"
    yield f"Answer with true or false on a line of its own. {ANSWER_LAST}"
    yield f"Statement: {task.statement}"
    yield from shown_lines(task.start, dynamics.appearance, scene)


def _claim_lines(dynamics: Dynamics, task: Task, scene: str) -> Iterator[str]:
    wanted = str(task.target).lower()
    yield (
        f"{PICTURE} Someone was to make a statement about it {wanted}, has edited the picture, and claims that it now"
        " is. Is the claim true?"
    )
    yield f"Answer with true, if the claim is true, or false, on a line of its own. {ANSWER_LAST}"
    yield f"Statement: {task.statement}"
    yield f"Claim: the statement is {wanted}."
    yield from shown_lines(task.start, dynamics.appearance, scene)


def _program_lines(dynamics: Dynamics, task: Task, scene: str) -> Iterator[str]:
    yield f"{PICTURE} You are told a statement about pictures. Write a program with its meaning."
    yield SYNTAX
    yield from (word.signature for word in WORDS.values())
    yield f"Answer with the program as the last line. {ANSWER_LAST}"
    yield f"Statement: {task.statement}"


_PROMPTS: Mapping[str, Callable[[Dynamics, Task, str], Iterator[str]]] = {  # lines of the prompt, with a scene's style
    "plan": _plan_lines,
    "truth": _truth_lines,
    "verify": _claim_lines,
    "program": _program_lines,
}
KINDS = tuple(_PROMPTS)
