"""Prompts, as texts and as messages with pictures. Each states the rules, the task and the form of the answer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

from PIL import Image

from lilgym_mp.envs.rules import Dynamics, make_dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.programs.words import WORDS
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import BOX_NAMES, describe
from lilgym_mp.scene.appearances import Appearance, make_appearance
from lilgym_mp.scene.choices import choose
from lilgym_mp.wrappers.text import SCENE_STYLES, image_part, picture, scale_line, shown_lines

if TYPE_CHECKING:
    from lilgym_mp.contrib.rlvr.rows import Row

PICTURE = "A picture has three boxes with items in them."
ANSWER_LAST = 'You may think before; a thought in "<think>...</think>" is not read.'
SYNTAX = (
    "A program is one expression, true or false of a picture, in a small part of Python: the names all_boxes and"
    " all_items, lambdas, and, or, not, comparisons, +, integers, lists, sets, Color.YELLOW, Color.BLACK, Color.BLUE,"
    " Shape.CIRCLE, Shape.SQUARE, Shape.TRIANGLE, Size.SMALL, Size.MEDIUM, Size.BIG, Side.TOP, Side.BOTTOM, Side.LEFT,"
    " Side.RIGHT, Side.ANY, box.all_items_in_box(), box.is_tower(), item.box, item.color, item.shape, item.size, and"
    " these functions:"
)


@cache
def dynamics_of(appearance: str) -> Dynamics:
    """The rules under which plans are made: the paper's, on the released grid. Raises ValueError."""
    return make_dynamics(make_appearance(appearance))


def plan_lines(dynamics: Dynamics, task: Task, scene: str = "list") -> Iterator[str]:
    appearance = dynamics.appearance
    yield (
        f"{PICTURE} You are told a statement about it, and whether to make it true or false. Write a plan that does"
        f" so, of at most {dynamics.horizon} actions, the last one STOP. An action that is illegal when it is taken"
        " ends the plan without success."
    )
    yield from appearance.explain(dynamics.rules.placement)
    yield "Answer with one action on each line, in order, ending with STOP, such as"
    yield from (describe(appearance.example), "STOP", f"Other lines are ignored. {ANSWER_LAST}")
    yield f"Statement: {task.statement}"
    yield f"Make the statement {_value(task.target)}."
    yield from shown_lines(task.start, appearance, scene)


def truth_lines(dynamics: Dynamics, task: Task, scene: str = "list") -> Iterator[str]:
    yield f"{PICTURE} You are told a statement about it. Is the statement true or false?"
    yield f"Answer with true or false on a line of its own. {ANSWER_LAST}"
    yield f"Statement: {task.statement}"
    yield from shown_lines(task.start, dynamics.appearance, scene)


def scene_answer_lines(dynamics: Dynamics, task: Task) -> Iterator[str]:
    yield f"{PICTURE} You are told a statement. Describe a picture in which it is {_value(task.target)}."
    yield from _scene_rules(dynamics.appearance)
    yield ANSWER_LAST
    yield f"Statement: {task.statement}"


def program_lines(dynamics: Dynamics, task: Task) -> Iterator[str]:
    yield f"{PICTURE} You are told a statement about pictures. Write a program with its meaning."
    yield SYNTAX
    yield from (word.signature for word in WORDS.values())
    yield f"Answer with the program as the last line. {ANSWER_LAST}"
    yield f"Statement: {task.statement}"


# The lines of the prompt for a task, by kind; those with a picture take the style of the scene as well
PROMPTS: Mapping[str, Callable[..., Iterator[str]]] = {
    "plan": plan_lines,
    "truth": truth_lines,
    "scene": scene_answer_lines,
    "program": program_lines,
}
WITH_PICTURE = ("plan", "truth")


def images_of(row: Row) -> list[Image.Image]:
    """The picture of a plan or truth row, in a list as TRL's column "images"; empty for other rows."""
    return [picture(row.task.start)] if row.kind in WITH_PICTURE else []


def messages_of(row: Row, scene: str = "list", *, inline: bool = True) -> list[dict[str, Any]]:
    """The prompt as one user message. `scene`: "list", "drawing", "image" or "both", of rows with a picture.

    A picture is a content part before the text: PNG in a data URL, as OpenAI's chat API takes it, or, unless `inline`,
    {"type": "image"}, which stands for `images_of(row)`, as in TRL and transformers. Raises ValueError for another
    style, and for a picture of a row without one.
    """
    is_seen = choose("scene", scene, SCENE_STYLES)
    if row.kind not in WITH_PICTURE:
        if is_seen:
            raise ValueError(f"a {row.kind} row has no picture to show; choose from {', '.join(WITH_PICTURE)} rows")
        return [{"role": "user", "content": row.prompt}]
    text = "\n".join(PROMPTS[row.kind](dynamics_of(row.appearance), row.task, scene))
    if not is_seen:
        return [{"role": "user", "content": text}]
    shown = [image_part(image) if inline else {"type": "image"} for image in images_of(row)]
    return [{"role": "user", "content": [*shown, {"type": "text", "text": text}]}]


def _scene_rules(appearance: Appearance) -> Iterator[str]:
    yield "Answer with a line for each box, LEFT, MIDDLE and RIGHT, with its items separated by semicolons."
    if appearance.grid is not None:
        yield scale_line()
        yield (
            "An item is its size (small: 10 pixels, medium: 20, large: 30), colour (yellow, black, blue), shape"
            " (circle, square, triangle) and top-left corner; items lie in their box and do not overlap. For example"
        )
        yield from ("LEFT: small blue circle (10, 20); large black square (50, 70)", "MIDDLE:", "RIGHT:")
    else:
        yield "Items are blocks, named by colour (yellow, black, blue), from the bottom; a box holds 4. For example"
        yield from ("LEFT: blue; black", "MIDDLE:", "RIGHT: yellow")


def scene_answer(scene: Scene, appearance: Appearance) -> str:
    """The scene in the form in which a model should answer."""
    return "\n".join(
        f"{name}: "
        + "; ".join(
            f"{item.size.name} {item.colour.name} {item.shape.name} ({item.x}, {item.y})".lower()
            if appearance.grid is not None
            else item.colour.name.lower()
            for item in box.items
        )
        for name, box in zip(BOX_NAMES, scene.boxes, strict=True)
    )


def _value(target: bool) -> str:
    return str(target).lower()
