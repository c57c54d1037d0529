"""The annotators' tutorial: small annotation tasks with advice."""

from __future__ import annotations

from typing import NamedTuple

from lilgym_mp.scene import Colour, Item, Scene, Shape, Size


class TutorialTask(NamedTuple):
    """A statement with labelled scenes: the first is shown, the others are hidden."""

    name: str
    title: str
    statement: str
    advice: str
    scenes: tuple[tuple[Scene, bool], ...]


def _block(level: int, colour: Colour) -> Item:
    return Item(40, 80 - 21 * level, Shape.SQUARE, colour, Size.MEDIUM)


def _towers(*colours: str) -> Scene:
    """A scene of towers; each string names the colours (y, k, b) of a box from the bottom up."""
    by_letter = {"y": Colour.YELLOW, "k": Colour.BLACK, "b": Colour.BLUE}
    return Scene.of(*([_block(level, by_letter[letter]) for level, letter in enumerate(box)] for box in colours))


def _item(x: int, y: int, shape: Shape, colour: Colour, size: Size = Size.MEDIUM) -> Item:
    return Item(x, y, shape, colour, size)


_CIRCLE, _SQUARE, _TRIANGLE = Shape
_YELLOW, _BLACK, _BLUE = Colour

TASKS: tuple[TutorialTask, ...] = (
    TutorialTask(
        "exist",
        "Existence",
        "At least one of the items is blue.",
        "filter_obj(items, condition) keeps the items for which the condition holds; exist(...) is true if any are "
        "left. all_items holds the items of all three boxes. Try: exist(filter_obj(all_items, lambda x: is_blue(x)))",
        (
            (_towers("yb", "k", ""), True),
            (_towers("yk", "k", ""), False),
            (_towers("", "", "b"), True),
            (_towers("", "", ""), False),
        ),
    ),
    TutorialTask(
        "count",
        "Counting boxes",
        "Exactly two towers have a black block at the base.",
        "all_boxes holds the three boxes; a box can be used wherever a collection of items is expected. is_bottom(x) "
        "is true if the item is the lowest in its box. Count the boxes that hold such an item: "
        "equal_int(count(filter_obj(all_boxes, lambda b: ...)), 2)",
        (
            (_towers("ky", "kb", "yk"), True),
            (_towers("ky", "kb", "k"), False),
            (_towers("k", "bk", "y"), False),
            (_towers("kkk", "", "kb"), True),
        ),
    ),
    TutorialTask(
        "faithful",
        "Be faithful to the statement",
        "Every triangle is yellow.",
        "A program that agrees with the shown scene may still fail on the hidden ones: here it is also true that some "
        "triangle is yellow, but that is not what the statement says. Express what it says, as briefly as possible: "
        "All(items, condition).",
        (
            (Scene.of([_item(5, 70, _TRIANGLE, _YELLOW)], [_item(30, 30, _CIRCLE, _BLACK)], []), True),
            (Scene.of([_item(5, 70, _TRIANGLE, _YELLOW)], [_item(30, 30, _TRIANGLE, _BLACK)], []), False),
            (Scene.of([_item(5, 5, _CIRCLE, _BLUE)], [_item(30, 30, _TRIANGLE, _YELLOW)], []), True),
            (Scene.of([], [_item(30, 30, _TRIANGLE, _BLUE)], [_item(60, 60, _TRIANGLE, _YELLOW)]), False),
        ),
    ),
    TutorialTask(
        "touching",
        "Touching",
        "A circle touches a wall.",
        "is_touching_wall(x) takes an item and, if the statement names one, a side such as Side.BOTTOM.",
        (
            (Scene.of([_item(0, 40, _CIRCLE, _BLUE)], [_item(40, 80, _SQUARE, _BLACK)], []), True),
            (Scene.of([_item(30, 40, _CIRCLE, _BLUE)], [_item(40, 80, _SQUARE, _BLACK)], []), False),
            (Scene.of([], [_item(40, 80, _CIRCLE, _BLACK)], [_item(10, 10, _CIRCLE, _YELLOW)]), True),
            (Scene.of([], [_item(80, 10, _TRIANGLE, _BLACK)], [_item(10, 10, _CIRCLE, _YELLOW)]), False),
        ),
    ),
)
TASKS_BY_NAME = {task.name: task for task in TASKS}
