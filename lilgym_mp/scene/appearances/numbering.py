"""Indices of the actions of a Scatter grid; scalar, array and compiled code all use these functions.

0 is STOP; then the ADDs, ordered by cell and, within a cell, by item type; then the REMOVEs, ordered by cell. The
functions take Python integers and NumPy arrays alike, and numba compiles them.
"""

from __future__ import annotations

from lilgym_mp.scene import FOOTPRINTS, Colour, Shape, Size

ITEM_TYPES = [(shape, colour, size) for shape in Shape for colour in Colour for size in Size]
ITEM_TYPE_COUNT = len(ITEM_TYPES)
ITEM_TYPE_FOOTPRINTS = tuple(FOOTPRINTS[shape][size] for shape, _, size in ITEM_TYPES)
REMOVES = ITEM_TYPE_COUNT  # sentinel instead of an item type: the action is a REMOVE


def item_type_of(shape: int, colour: int, size: int) -> int:
    """The index of an item type in ITEM_TYPES."""
    return (shape * len(Colour) + colour) * len(Size) + size


def action_count(cells: int) -> int:
    """The number of actions on a grid with `cells` cells."""
    return 1 + cells * (ITEM_TYPE_COUNT + 1)


def add_index(cell: int, item_type: int) -> int:
    """The index of the action that adds an item type to a cell."""
    return 1 + cell * ITEM_TYPE_COUNT + item_type


def remove_index(cell: int, cells: int) -> int:
    """The index of the action that removes from a cell."""
    return 1 + cells * ITEM_TYPE_COUNT + cell


def cell_and_item_type(index: int, cells: int) -> tuple[int, int]:
    """The cell of the edit with this index, and the item type that it adds, or REMOVES."""
    edit = index - 1
    if edit < cells * ITEM_TYPE_COUNT:
        return edit // ITEM_TYPE_COUNT, edit % ITEM_TYPE_COUNT
    return edit - cells * ITEM_TYPE_COUNT, REMOVES
