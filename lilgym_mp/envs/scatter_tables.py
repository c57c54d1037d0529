"""The geometry of Scatter in the form that array operations read: the tables of `PlacementTables`, laid out flat.

A place (x, y) in a box is the number x * PLACE_PITCH + y. As no place is further than FARTHEST from another in x or
y, the difference of two tells how they lie to each other.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances.placement import (
    FIRST_TOO_FAR,
    LARGEST_MOVE,
    LARGEST_SIDE,
    OFFSET_COUNT,
    OFFSET_LIMIT,
    cell_areas,
    placement_tables,
)
from lilgym_mp.appearances.scatter import LOOKS
from lilgym_mp.envs.block import BoolArray, Int64Array
from lilgym_mp.scene import BOX_SIDE, KIND_COUNT, KIND_PIXELS, Size

NO_LOOK = len(LOOKS)  # the look of an empty slot
NO_KIND = KIND_COUNT  # the kind of an empty slot
KINDS = np.array([*(shape * len(Size) + size for shape, _, size in LOOKS), NO_KIND])  # (28,) by look

PLACE_PITCH = 2 * BOX_SIDE
FARTHEST = BOX_SIDE - 1
SAME_PLACE = FARTHEST * PLACE_PITCH + FARTHEST  # in a pair's table, where two places do not differ
PAIR_SIZE = (2 * FARTHEST + 1) * PLACE_PITCH  # entries of a pair's table
NEW_KIND_SIZE = (KIND_COUNT + 1) * PAIR_SIZE
EMPTY_SLOT = -NO_KIND * PAIR_SIZE

Code = TypeVar("Code", np.uint8, np.int16)

TIED = np.iinfo(np.int16).max  # instead of a move: nearest points that `PlacementTables.move` must settle


class Geometry(NamedTuple):
    """What new items are to items in slots.

    A slot holds an item's place less PAIR_SIZE for each step of its kind, or EMPTY_SLOT: so that a slot taken from a
    new item's `origins` is where the tables tell of the two.
    """

    clearance: NDArray[np.uint8]  # (9 * 10 * PAIR_SIZE,) by new kind, kind in the slot, offset: clearance codes
    moves: NDArray[np.int16]  # (9 * 10 * PAIR_SIZE,) likewise, where near: the snap move, as a difference of places
    within: BoolArray  # (9 * REACH,) by kind and place, also by LARGEST_MOVE outside: whether it is in the box


REACH_START = LARGEST_MOVE * PLACE_PITCH + LARGEST_MOVE  # of the box's first place in `Geometry.within`
REACH = (BOX_SIDE + 2 * LARGEST_MOVE) * PLACE_PITCH


def origins(kinds: Int64Array, places: Int64Array) -> Int64Array:
    """Where in the tables new items stand before the slot is subtracted."""
    return kinds * NEW_KIND_SIZE + (SAME_PLACE + places)


def in_box(kinds: Int64Array, places: Int64Array) -> BoolArray:
    """Whether items lie inside their box."""
    return geometry().within.take(kinds * REACH + (REACH_START + places))


def packed(kinds: Int64Array, places: Int64Array) -> Int64Array:
    """What slots hold of items."""
    return places - kinds * PAIR_SIZE


@cache
def geometry() -> Geometry:
    tables = placement_tables()
    codes, moves = (
        np.frombuffer(b"".join(map(b"".join, by_kinds)), np.uint8) for by_kinds in (tables.clearance, tables.moves)
    )
    across, down = np.divmod(moves.astype(np.int16), 2 * LARGEST_MOVE)
    moves = (across - LARGEST_MOVE) * np.int16(PLACE_PITCH) + down - np.int16(LARGEST_MOVE)
    moves[list(tables.ties)] = TIED
    return Geometry(_by_offset(codes, FIRST_TOO_FAR), _by_offset(moves, 0), _within())


def _by_offset(near: NDArray[Code], far: int) -> NDArray[Code]:
    """(9 * 10 * PAIR_SIZE,) a table (9 * 9 * 69 * 69,) of `PlacementTables`; `far` beyond it and for empty slots."""
    table = np.full((KIND_COUNT, KIND_COUNT + 1, 2 * FARTHEST + 1, PLACE_PITCH), far, near.dtype)
    offsets = slice(FARTHEST - OFFSET_LIMIT, FARTHEST + OFFSET_LIMIT + 1)
    table[:, :NO_KIND, offsets, offsets] = near.reshape(KIND_COUNT, KIND_COUNT, OFFSET_COUNT, OFFSET_COUNT)
    return table.ravel()


def _within() -> BoolArray:
    lasts = BOX_SIDE - np.array(KIND_PIXELS)[:, None]
    along = np.arange(-LARGEST_MOVE, BOX_SIDE + LARGEST_MOVE)
    inside = (along >= 0) & (along <= lasts)  # (9, 116)
    table = np.zeros((KIND_COUNT, BOX_SIDE + 2 * LARGEST_MOVE, PLACE_PITCH), np.bool_)
    table[:, :, : inside.shape[1]] = inside[:, :, None] & inside[:, None, :]
    return table.ravel()


@cache
def area_ranks(cell_width: int, cell_height: int) -> NDArray[np.uint16]:
    """(10 * PAIR_SIZE,) by kind and how a cell lies to an item: larger where more of the item is in the cell, or 0."""
    areas = np.array(cell_areas(cell_width, cell_height))
    _, ranks = np.unique(areas, return_inverse=True)
    table = np.zeros((KIND_COUNT + 1, 2 * FARTHEST + 1, PLACE_PITCH), np.uint16)
    columns = slice(FARTHEST - cell_width + 1, FARTHEST + LARGEST_SIDE)
    rows = slice(FARTHEST - cell_height + 1, FARTHEST + LARGEST_SIDE)
    table[:NO_KIND, columns, rows] = ranks.reshape(areas.shape)
    return table.ravel()
