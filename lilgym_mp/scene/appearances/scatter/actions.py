"""The actions of a Scatter grid by index; scalar, array and compiled code all use these functions.

0 is STOP; then the ADDs, ordered by cell and, within a cell, by item type; then the REMOVEs, ordered by cell. The
functions take Python integers and NumPy arrays alike, and numba compiles them.
"""

from __future__ import annotations

from functools import cache

from lilgym_mp.scene import FOOTPRINTS, Colour, Shape, Size
from lilgym_mp.scene.actions import STOP, Action, AddItem, RemoveItem, Stop
from lilgym_mp.scene.appearances.base import ArrayForm, Grid

ITEM_TYPES = [(shape, colour, size) for shape in Shape for colour in Colour for size in Size]
ITEM_TYPE_COUNT = len(ITEM_TYPES)
ITEM_TYPE_FOOTPRINTS = tuple(FOOTPRINTS[shape][size] for shape, _, size in ITEM_TYPES)
REMOVES = ITEM_TYPE_COUNT  # sentinel instead of an item type: the action is a REMOVE
MAX_DECODED = 20_000  # actions kept decoded; finer grids decode on demand
ITEM_TYPE_INDICES = {item_type: index for index, item_type in enumerate(ITEM_TYPES)}


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


def decoded(grid: Grid, index: int) -> Action:
    """The action of a grid with this index."""
    if index == 0:
        return STOP
    columns, rows = grid
    cell, item_type = cell_and_item_type(index, columns * rows)
    column, row = divmod(cell, rows)
    return RemoveItem(column, row) if item_type == REMOVES else AddItem(column, row, *ITEM_TYPES[item_type])


@cache
def all_actions(grid: Grid) -> tuple[Action, ...]:
    """All actions of a grid."""
    return tuple(decoded(grid, index) for index in range(action_count(grid[0] * grid[1])))


def array_form(grid: Grid) -> ArrayForm:
    """The released array form of a grid's actions."""
    columns, rows = map(range, grid)
    slots = {"x": columns, "y": rows, "shape": tuple(Shape), "colour": tuple(Colour), "size": tuple(Size)}
    return ArrayForm("scatter", slots, (Stop, AddItem, RemoveItem))
