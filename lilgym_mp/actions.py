"""What an agent can do, as plain named tuples. What each does to a scene is told by `appearances`.

Source: SPEC section 3 (Wu et al. 2023, section 4).
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from lilgym_mp.scene import Colour, Shape, Size


class ActionType(IntEnum):
    """First slot of the released array form."""

    STOP = 0
    ADD = 1
    REMOVE = 2


class ActionError(ValueError):
    """An action that does not exist: the caller's mistake, unlike an invalid action of the MDP."""


class Stop(NamedTuple):
    """Declare that the statement now has the target value."""


class AddBlock(NamedTuple):
    """Tower: put a block on top of a box's tower."""

    box: int
    colour: Colour


class RemoveBlock(NamedTuple):
    """Tower: take the top block of a box's tower."""

    box: int


class AddItem(NamedTuple):
    """Scatter: put an item into the grid's cell (column, row), counted over the whole image."""

    column: int
    row: int
    shape: Shape
    colour: Colour
    size: Size


class RemoveItem(NamedTuple):
    """Scatter: take away the item that fills the cell (column, row) most."""

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
