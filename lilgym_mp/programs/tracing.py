"""How a program comes to its value in a scene: the values of its parts, and what satisfies its conditions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import Enum
from typing import Any, NamedTuple, cast

from lilgym_mp.programs.errors import ProgramRuntimeError
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.reference import Evaluation, build_closure
from lilgym_mp.programs.syntax import (
    Call,
    Constant,
    Lambda,
    Node,
    SceneName,
    Variable,
    WordName,
    children,
    parse,
)
from lilgym_mp.programs.values import BoxView, ItemView
from lilgym_mp.scene import BOX_SIDE, Scene

BOX_TITLES = ("left", "middle", "right")
SIZE_NAMES = {"BIG": "large"}  # by the name in programs, where it is another than elsewhere


ItemIndex = tuple[int, int]  # box, and position among the box's items


class TraceEntry(NamedTuple):
    """A part of a program, and its value in words."""

    depth: int  # parts within which it lies
    source: str
    value: str
    items: tuple[ItemIndex, ...] = ()  # those that the value is or holds, in scene order


def trace(source: str, scene: Scene) -> list[TraceEntry]:
    """The parts of a program that have a value of their own, the whole first, and, under each call that takes a
    condition, which of the elements satisfy it. Raises ProgramError for what is no program."""
    return list(_parts(parse(source), scene, 0))


def _parts(node: Node, scene: Scene, depth: int) -> Iterator[TraceEntry]:
    if isinstance(node, Constant | SceneName | WordName | Lambda) or _free(node):
        return
    yield TraceEntry(depth, source_of(node), *_value(node, scene))
    if isinstance(node, Call):
        yield from _conditions(node, scene, depth + 1)
    for child in children(node):
        yield from _parts(child, scene, depth + 1)


def _conditions(call: Call, scene: Scene, depth: int) -> Iterator[TraceEntry]:
    """For each condition among the arguments, the elements of the first argument that satisfy it."""
    elements, *others = call.arguments
    for other in others:
        if elements is not None and isinstance(other, Lambda) and not _free(other) and not _free(elements):
            yield TraceEntry(depth, source_of(other), *_satisfying(elements, other, scene))


def _satisfying(elements: Node, condition: Lambda, scene: Scene) -> tuple[str, tuple[ItemIndex, ...]]:
    run = Evaluation(scene)
    try:
        collection = build_closure(elements)(run, {})
        body = build_closure(condition.body)
        held = [element for element in collection if _holds(body(run, {condition.parameter: element}))]
        return f"satisfied by {_told(held) if held else 'none'} of {len(collection)}", _places(held)
    except (ProgramRuntimeError, TypeError) as fault:
        return f"no value: {fault}", ()


def _holds(value: Any) -> bool:
    """As `filter_obj` takes it: lambdas may return collections."""
    return bool(len(value)) if isinstance(value, BoxView) else bool(value)


def _value(node: Node, scene: Scene) -> tuple[str, tuple[ItemIndex, ...]]:
    try:
        value = build_closure(node)(Evaluation(scene), {})
    except ProgramRuntimeError as fault:
        return f"no value: {fault}", ()
    return _told(value), _places(value)


def _places(value: Any) -> tuple[ItemIndex, ...]:
    """The places of the items that a value is or holds, at any level."""
    match value:
        case ItemView():
            return ((value.box.index, value.index),)
        case list() | tuple() | set() | frozenset() | BoxView():
            parts = map(_places, cast("Iterable[Any]", value))
            return tuple(sorted({place for part in parts for place in part}))
        case _:
            return ()


def _free(node: Node, bound: frozenset[str] = frozenset()) -> bool:
    """Whether a node has a variable that no lambda within it binds."""
    if isinstance(node, Variable):
        return node.name not in bound
    if isinstance(node, Lambda):
        return _free(node.body, bound | {node.parameter})
    return any(_free(child, bound) for child in children(node))


def _told(value: Any) -> str:
    """A value in words."""
    match value:
        case ItemView():
            return _item(value)
        case BoxView():
            return f"the {BOX_TITLES[value.index]} box"
        case Enum():
            return str(value)
        case list() | tuple() | set() | frozenset():
            return _listed(cast("Iterable[Any]", value))
        case _:
            return str(value)


def _listed(values: Iterable[Any]) -> str:
    """Elements in scene order where they are items."""
    elements = list(values)
    if elements and all(isinstance(element, ItemView) for element in elements):
        elements.sort(key=lambda item: (item.box.index, item.index))
    return f"[{', '.join(map(_told, elements))}]"


def _item(item: ItemView) -> str:
    size = SIZE_NAMES.get(item.size.name, item.size.name.lower())
    words = f"{size} {item.color.name} {item.shape.name}".lower()
    return f"{words} at ({item.left}, {BOX_SIDE - item.top}) in the {BOX_TITLES[item.box.index]} box"
