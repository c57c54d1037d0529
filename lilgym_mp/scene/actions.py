"""Actions as named tuples. Their effects on scenes are defined by `appearances`.

Source: docs/spec.md, "Actions" (Wu et al. 2023, section 4).
"""

from __future__ import annotations

import operator
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from enum import IntEnum
from functools import lru_cache
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


class BoxName(IntEnum):
    """Names of the boxes; the value is the index."""

    LEFT = 0
    MIDDLE = 1
    RIGHT = 2


BOX_NAMES = tuple(BoxName.__members__)

# By class of action: its verb, and the kinds of its fields
_FORMS: Mapping[type[Action], tuple[str, Sequence[Any]]] = {
    Stop: ("STOP", ()),
    AddBlock: ("ADD", (BoxName, Colour)),
    RemoveBlock: ("REMOVE", (BoxName,)),
    AddItem: ("ADD", (int, int, Shape, Colour, Size)),
    RemoveItem: ("REMOVE", (int, int)),
}


@lru_cache(maxsize=20_000, typed=True)  # actions of two classes can be equal, as tuples
def describe(action: Action) -> str:
    """The action as people write it, such as ADD(LEFT, BLUE) or REMOVE(3, 4)."""
    verb, kinds = _FORMS[type(action)]
    words = [str(value) if kind is int else kind(value).name for kind, value in zip(kinds, action, strict=True)]
    return f"{verb}({', '.join(words)})" if words else verb


_NAME = re.compile(r"\s*(\w+)\s*(?:\(([^()]*)\))?\s*")


def named(name: str) -> Action:
    """The action that `describe` calls `name`, in any case and spacing. Raises ActionError."""
    found = _NAME.fullmatch(name.upper())
    if found:
        word, inside = found.groups()
        words = [each.strip() for each in inside.split(",")] if inside and inside.strip() else []
        for action, (verb, kinds) in _FORMS.items():
            if (verb, len(kinds)) == (word, len(words)):
                with suppress(KeyError, ValueError):
                    pairs = zip(kinds, words, strict=True)
                    fields: list[Any] = [int(each) if kind is int else kind[each] for kind, each in pairs]
                    return action(*fields)
    raise ActionError(f"{name!r} is not an action; actions look like {', '.join(map(describe, _EXAMPLES))}")


_EXAMPLES: tuple[Action, ...] = (
    STOP,
    AddBlock(0, Colour.BLUE),
    RemoveBlock(2),
    AddItem(3, 4, Shape.CIRCLE, Colour.BLACK, Size.LARGE),
    RemoveItem(3, 4),
)
