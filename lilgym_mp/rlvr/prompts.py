"""The texts of the prompts. Each states the rules, the task and the form of the answer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache

from lilgym_mp.actions import BOX_NAMES, describe
from lilgym_mp.appearances import Appearance, make_appearance
from lilgym_mp.programs.words import WORDS
from lilgym_mp.rules import Dynamics, make_dynamics
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task
from lilgym_mp.wrappers.text import scale_line, scene_lines

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


def plan_lines(dynamics: Dynamics, task: Task) -> Iterator[str]:
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
    yield from scene_lines(task.start, appearance)


def truth_lines(dynamics: Dynamics, task: Task) -> Iterator[str]:
    yield f"{PICTURE} You are told a statement about it. Is the statement true or false?"
    yield f"Answer with true or false on a line of its own. {ANSWER_LAST}"
    yield f"Statement: {task.statement}"
    yield from scene_lines(task.start, dynamics.appearance)


def scene_answer_lines(dynamics: Dynamics, task: Task) -> Iterator[str]:
    yield f"{PICTURE} You are told a statement. Describe a picture in which it is {_value(task.target)}."
    yield from _scene_rules(dynamics.appearance)
    yield ANSWER_LAST
    yield f"Statement: {task.statement}"
    yield f"Describe a picture in which the statement is {_value(task.target)}."


def program_lines(dynamics: Dynamics, task: Task) -> Iterator[str]:
    yield f"{PICTURE} You are told a statement about pictures. Write a program with its meaning."
    yield SYNTAX
    yield from (word.signature for word in WORDS.values())
    yield f"Answer with the program as the last line. {ANSWER_LAST}"
    yield f"Statement: {task.statement}"


# The lines of the prompt for a task, by kind
PROMPTS: Mapping[str, Callable[[Dynamics, Task], Iterator[str]]] = {
    "plan": plan_lines,
    "truth": truth_lines,
    "scene": scene_answer_lines,
    "program": program_lines,
}


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
