"""How the actions of a Scatter grid are numbered: the only home of that order, for scalars, arrays and compiled code.

0 is STOP, then come the ADDs, cell by cell and look by look, then the REMOVEs, cell by cell. The functions take Python
integers and NumPy arrays alike, and numba compiles them.
"""

from __future__ import annotations

from lilgym_mp.scene import KINDS, Colour, Shape, Size

LOOKS = [(shape, colour, size) for shape in Shape for colour in Colour for size in Size]  # by look
LOOK_COUNT = len(LOOKS)
LOOK_KINDS = tuple(KINDS[shape][size] for shape, _, size in LOOKS)  # by look: the item's kind
REMOVES = LOOK_COUNT  # in place of a look: the action is a REMOVE


def look_of(shape: int, colour: int, size: int) -> int:
    """The index of a look in LOOKS."""
    return (shape * len(Colour) + colour) * len(Size) + size


def action_count(cells: int) -> int:
    """The number of actions on a grid of so many cells."""
    return 1 + cells * (LOOK_COUNT + 1)


def add_index(cell: int, look: int) -> int:
    """The index of the ADD of a look to a cell."""
    return 1 + cell * LOOK_COUNT + look


def remove_index(cell: int, cells: int) -> int:
    """The index of the REMOVE from a cell."""
    return 1 + cells * LOOK_COUNT + cell


def cell_and_look(index: int, cells: int) -> tuple[int, int]:
    """The cell of the edit with that index, and the look that it adds or REMOVES."""
    edit = index - 1
    if edit < cells * LOOK_COUNT:
        return edit // LOOK_COUNT, edit % LOOK_COUNT
    return edit - cells * LOOK_COUNT, REMOVES
