"""Actions as named tuples. Their effects on scenes are defined by `appearances`.

Source: docs/spec.md, "Actions" (Wu et al. 2023, section 4).
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from typing import Any, NamedTuple, SupportsIndex, cast

from lilgym_mp.scene import Colour, Shape, Size
from lilgym_mp.scene.arrays import BOOLEANS


class ActionType(IntEnum):
    """First slot of the released array form."""

    STOP = 0
    ADD = 1
    REMOVE = 2


class ActionError(ValueError):
    """An action that does not exist: an error of the caller, unlike an invalid action of the MDP."""


ARRAY_ADVICE = (
    "; for actions in the released array form use env.unwrapped.encode_action, or the wrapper MultiDiscreteActions"
    " (multi_discrete_actions_v0 for batches)"
)


def checked_index(action: object, count: int, agent: str = "") -> int:
    """`action` as an int; `agent`: named in errors. Raises ActionError unless it is a whole number 0 .. `count` - 1."""
    try:
        index = None if isinstance(action, BOOLEANS) else operator.index(cast("SupportsIndex", action))
    except TypeError:
        index = None
    whose = f" of {agent}" if agent else ""
    if index is None:
        is_array = hasattr(cast("Any", action), "__len__") and not isinstance(action, str)
        advice = ARRAY_ADVICE if is_array and not agent else ""
        raise ActionError(f"an action{whose} must be a whole number 0 .. {count - 1}, not {action!r}{advice}")
    if not 0 <= index < count:
        raise ActionError(f"action {action!r}{whose} is out of range; choose from 0 .. {count - 1}")
    return index


class Stop(NamedTuple):
    """Declare that the statement now has the target value."""


class AddBlock(NamedTuple):
    """Tower: put a block on top of a box's tower."""

    box: int
    colour: Colour


class RemoveBlock(NamedTuple):
    """Tower: remove the top block of a box's tower."""

    box: int


class AddItem(NamedTuple):
    """Scatter: put an item into the grid's cell (column, row), counted over the whole image."""

    column: int
    row: int
    shape: Shape
    colour: Colour
    size: Size


class RemoveItem(NamedTuple):
    """Scatter: remove the item that covers most of the cell (column, row)."""

    column: int
    row: int


TowerAction = Stop | AddBlock | RemoveBlock
ScatterAction = Stop | AddItem | RemoveItem
Action = TowerAction | ScatterAction

STOP = Stop()

BOX_NAMES = ("LEFT", "MIDDLE", "RIGHT")


def describe(action: Action) -> str:
    """The action as people write it, such as ADD(LEFT, BLUE) or REMOVE(3, 4)."""
    match action:
        case Stop():
            return "STOP"
        case AddBlock(box, colour):
            return f"ADD({BOX_NAMES[box]}, {colour.name})"
        case RemoveBlock(box):
            return f"REMOVE({BOX_NAMES[box]})"
        case AddItem(column, row, shape, colour, size):
            return f"ADD({column}, {row}, {shape.name}, {colour.name}, {size.name})"
        case RemoveItem(column, row):
            return f"REMOVE({column}, {row})"


_NAME = re.compile(r"\s*(\w+)\s*(?:\(([^()]*)\))?\s*")
_BOX: Callable[[str], int] = BOX_NAMES.index
_READERS: Mapping[tuple[str, int], tuple[Callable[..., Action], Sequence[Callable[[str], Any]]]] = {
    ("STOP", 0): (Stop, ()),
    ("ADD", 2): (AddBlock, (_BOX, Colour.__getitem__)),
    ("REMOVE", 1): (RemoveBlock, (_BOX,)),
    ("ADD", 5): (AddItem, (int, int, Shape.__getitem__, Colour.__getitem__, Size.__getitem__)),
    ("REMOVE", 2): (RemoveItem, (int, int)),
}


def named(name: str) -> Action:
    """The action that `describe` calls `name`, in any case and spacing. Raises ActionError."""
    found = _NAME.fullmatch(name.upper())
    if found:
        word, inside = found.groups()
        arguments = [argument.strip() for argument in inside.split(",")] if inside and inside.strip() else []
        action, readers = _READERS.get((word, len(arguments)), (None, ()))
        try:
            if action is not None:
                return action(*(read(argument) for read, argument in zip(readers, arguments, strict=True)))
        except (KeyError, ValueError):
            pass
    raise ActionError(f"{name!r} is not an action; actions look like {', '.join(map(describe, _EXAMPLES))}")


_EXAMPLES: tuple[Action, ...] = (
    STOP,
    AddBlock(0, Colour.BLUE),
    RemoveBlock(2),
    AddItem(3, 4, Shape.CIRCLE, Colour.BLACK, Size.LARGE),
    RemoveItem(3, 4),
)
