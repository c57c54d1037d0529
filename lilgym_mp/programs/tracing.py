"""Traces an evaluation on a scene: the value of each subexpression, and which elements satisfy each condition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, cast

from lilgym_mp.programs.compiler import compile_program
from lilgym_mp.programs.errors import ProgramError, ProgramRuntimeError
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.reference import Evaluation, build_closure
from lilgym_mp.programs.syntax import (
    Call,
    Constant,
    Lambda,
    Node,
    SceneName,
    WordName,
    children,
    free_variables,
    own_size,
    parse,
    word_names,
)
from lilgym_mp.programs.values import BoxView, ItemView
from lilgym_mp.programs.words import elements
from lilgym_mp.scene import BOX_PITCH, Item, Scene, Shape, Size
from lilgym_mp.scene.appearances.tower.geometry import BLOCK_X, LEVEL_Y

BOX_TITLES = ("left", "middle", "right")
CELL_SIDE = 20  # pixels of a cell of the released grid
LEVELS = ("at the bottom", *(f"{name} from the bottom" for name in ("second", "third", "fourth")))  # of blocks


ItemIndex = tuple[int, int]  # box index, index in the box


class TraceEntry(NamedTuple):
    """A subexpression and its value as text."""

    depth: int  # nesting depth
    source: str
    value: str
    items: tuple[ItemIndex, ...] = ()  # the items that the value is or contains, in scene order


def trace(source: str, scene: Scene, step_limit: int | None = None) -> list[TraceEntry]:
    """The closed subexpressions of a program in pre-order; under each call that takes a condition, an entry says which
    elements satisfy it. Raises ProgramError for an invalid program.

    `step_limit`: of all evaluations together, as in `Program.evaluate`. Parts evaluated beyond it have no value.
    """
    return list(_entries(parse(source), Evaluation(scene, step_limit), 0))


def _begin(node: Node, evaluation: Evaluation) -> None:
    """Charges for an evaluation of the node; the last one may have ended with an error."""
    evaluation.held = evaluation.call_depth = 0
    evaluation.charge(own_size(node))


def _entries(node: Node, evaluation: Evaluation, depth: int) -> Iterator[TraceEntry]:
    is_trivial = isinstance(node, Constant | SceneName | WordName | Lambda)
    if is_trivial or free_variables(node):
        return
    yield TraceEntry(depth, source_of(node), *_value(node, evaluation))
    if isinstance(node, Call):
        yield from _conditions(node, evaluation, depth + 1)
    for child in children(node):
        yield from _entries(child, evaluation, depth + 1)


def _conditions(call: Call, evaluation: Evaluation, depth: int) -> Iterator[TraceEntry]:
    """An entry per lambda argument of a closed call: the elements of the first argument that satisfy it."""
    collection, *others = call.arguments
    for other in others:
        if collection and isinstance(other, Lambda) and not free_variables(other):
            yield TraceEntry(depth, source_of(other), *_satisfied_by(collection, other, evaluation))


def _satisfied_by(tested: Node, condition: Lambda, evaluation: Evaluation) -> tuple[str, tuple[ItemIndex, ...]]:
    try:
        _begin(condition, evaluation)
        collection = build_closure(tested)(evaluation, {})
        body = build_closure(condition.body)
        satisfying = [each for each in collection if _holds(body(evaluation, {condition.parameter: each}))]
        evaluation.measure(satisfying)
        text = _value_text(satisfying) if satisfying else "none"
        return f"satisfied by {text} of {len(collection)}", _item_indices(satisfying)
    except (ProgramRuntimeError, TypeError) as fault:
        return f"no value: {fault}", ()


def _holds(value: Any) -> bool:
    """Truthiness as in `filter_obj`: lambdas may return collections."""
    return bool(len(value)) if isinstance(value, BoxView) else bool(value)


def _value(node: Node, evaluation: Evaluation) -> tuple[str, tuple[ItemIndex, ...]]:
    try:
        _begin(node, evaluation)
        value = build_closure(node)(evaluation, {})
        evaluation.measure(value)
    except ProgramRuntimeError as fault:
        return f"no value: {fault}", ()
    return _value_text(value), _item_indices(value)


def _item_indices(value: Any) -> tuple[ItemIndex, ...]:
    """The indices of the items that a value is or contains, at any level."""
    match value:
        case ItemView():
            return ((value.box.index, value.index),)
        case list() | tuple() | set() | frozenset() | BoxView():
            parts = map(_item_indices, cast("Iterable[Any]", value))
            return tuple(sorted({place for part in parts for place in part}))
        case _:
            return ()


def _value_text(value: Any) -> str:
    match value:
        case ItemView():
            return _item_text(value)
        case BoxView():
            return f"the {BOX_TITLES[value.index]} box"
        case list() | tuple() | set() | frozenset():
            return f"[{', '.join(map(_value_text, elements(cast('Iterable[Any]', value))))}]"
        case _:
            return str(value)


def _item_text(view: ItemView) -> str:
    box = view.box
    return f"{item_text(box.index, view.index, box.content.items[view.index])} in the {BOX_TITLES[box.index]} box"


def item_text(box_index: int, index: int, item: Item) -> str:
    """An item of a box in words, with its level if it lies where a stack has its block, else with its cell."""
    colour = item.colour.name.lower()
    if index < len(LEVELS) and item == (BLOCK_X, LEVEL_Y[index], Shape.SQUARE, item.colour, Size.MEDIUM):
        return f"{colour} block {LEVELS[index]}"
    middle_x = box_index * BOX_PITCH + item.x + item.side // 2
    middle_y = item.y + item.side // 2
    cell = f"column {middle_x // CELL_SIDE}, row {middle_y // CELL_SIDE}"
    return f"{item.size.name} {colour} {item.shape.name} at {cell}".lower()


def explain_program(source: str) -> str:
    """Human-readable text about a program, valid or not.

    Args:
        source: The program's text.

    Returns:
        The error in the source, or the words it uses and its value on the empty scene.
    """
    try:
        program = compile_program(source)
    except ProgramError as fault:
        return f"invalid program: {fault.explain()}"
    try:
        value = str(program.evaluate(Scene.empty()))
    except ProgramRuntimeError as fault:
        value = f"no value ({fault})"
    words = ", ".join(sorted(word_names(program.tree))) or "none"
    return f"valid program\nwords: {words}\non the empty scene: {value}"
