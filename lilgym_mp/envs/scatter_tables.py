"""The geometry of Scatter in the form that array operations read: the tables of `PlacementTables`, laid out flat.

A place (x, y) in a box is the number x * PLACE_PITCH + y. As no place is further than FARTHEST from another in x or
y, the difference of two tells how they lie to each other.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances.placement import (
    FIRST_TOO_FAR,
    LARGEST_SIDE,
    NO_OFFSET,
    OFFSET_COUNT,
    OFFSET_LIMIT,
    OVERLAPPING,
    cell_areas,
    inside_corners,
    placement_tables,
    search_offsets,
)
from lilgym_mp.appearances.scatter import LOOKS
from lilgym_mp.envs.block import BoolArray, Int64Array
from lilgym_mp.scene import BOX_SIDE, KIND_COUNT, KIND_PIXELS, Size

NO_LOOK = len(LOOKS)  # the look of an empty slot, and of a REMOVE
NO_KIND = KIND_COUNT  # the kind of an empty slot
WORD_BITS = 64
KINDS = np.array([*(shape * len(Size) + size for shape, _, size in LOOKS), NO_KIND])  # (28,) by look
LAST_PLACES = BOX_SIDE - np.array(KIND_PIXELS)  # (9,) by kind: the largest x and y inside the box

PLACE_PITCH = 2 * BOX_SIDE
FARTHEST = BOX_SIDE - 1
SAME_PLACE = FARTHEST * PLACE_PITCH + FARTHEST  # in a pair's table, where two places do not differ
PAIR_SIZE = (2 * FARTHEST + 1) * PLACE_PITCH  # entries of a pair's table
NEW_KIND_SIZE = (KIND_COUNT + 1) * PAIR_SIZE
EMPTY_SLOT = -NO_KIND * PAIR_SIZE

TIED = 255  # instead of a move: nearest points that `PlacementTables.move` must settle


class Geometry(NamedTuple):
    """What new items, and cells, are to items in slots.

    A slot holds an item's place less PAIR_SIZE for each step of its kind, or EMPTY_SLOT: so that a slot taken from a
    new item's place points into the tables.
    """

    clearance: NDArray[np.uint8]  # (9 * 10 * PAIR_SIZE,) by new kind, kind in the slot, offset: clearance codes
    moves: NDArray[np.uint8]  # (9 * 9 * 69 * 69,) as `PlacementTables.moves`, with TIED where a tie matters

    def closest(self, kinds: Int64Array, places: Int64Array, slots: Int64Array) -> tuple[Int64Array, NDArray[np.uint8]]:
        """`PlacementTables.closest` for new items (k,) at places (k,) inside the box, among those in slots (k, slots).

        (k,) the first slots with the smallest clearance code, and (k,) that code.
        """
        codes = self.clearance.take((kinds * NEW_KIND_SIZE + SAME_PLACE + places)[:, None] - slots)
        closest = codes.argmin(1)
        return closest, codes[np.arange(len(closest)), closest]

    def snap_moves(self, kinds: Int64Array, places: Int64Array, slots: Int64Array) -> Int64Array:
        """(k,) move codes (x + LARGEST_MOVE) * 16 + y + LARGEST_MOVE of new items to near ones, slots (k,), or TIED."""
        other_kinds, other_places = unpacked(slots)
        (xs, ys), (other_xs, other_ys) = np.divmod(places, PLACE_PITCH), np.divmod(other_places, PLACE_PITCH)
        offsets = (xs - other_xs) * OFFSET_COUNT + ys - other_ys + NO_OFFSET
        return self.moves[(kinds * KIND_COUNT + other_kinds) * OFFSET_COUNT**2 + offsets].astype(np.int64)


def packed(kinds: Int64Array, places: Int64Array) -> Int64Array:
    """What slots hold of items."""
    return places - kinds * PAIR_SIZE


def unpacked(slots: Int64Array) -> tuple[Int64Array, Int64Array]:
    """Kinds and places of items in slots."""
    kinds = -(slots // PAIR_SIZE)
    return kinds, slots + kinds * PAIR_SIZE


def inside(kinds: Int64Array, xs: Int64Array, ys: Int64Array) -> BoolArray:
    """Whether items lie inside their box."""
    return (np.minimum(xs, ys) >= 0) & (np.maximum(xs, ys) <= LAST_PLACES[kinds])


def search(
    cell: tuple[int, int], kinds: Int64Array, places: Int64Array, slots: Int64Array
) -> tuple[BoolArray, Int64Array]:
    """`placement.searched` for new items of `kinds` (k,), in the cells at `places` (k,), among those in (k, slots).

    (k,) whether something is free, and (k,) the first place that is.
    """
    width, height = cell[0], _strip_height(cell[1])
    cell_xs, cell_ys = np.divmod(places, PLACE_PITCH)
    xs = cell_xs[:, None] + np.arange(width)
    ys = cell_ys[:, None] + np.arange(0, cell[1], height)
    allowed = _search_strips(*cell)[:, :, kinds].transpose(2, 0, 1)
    within = _inside_strips(height)[xs[:, :, None], ys[:, None] // height, kinds[:, None, None]]
    free = (allowed & within & ~_blocked(height, kinds, (xs, ys), slots)).reshape(len(kinds), -1)
    first = (free != 0).argmax(1)
    bits = free[np.arange(len(first)), first]
    columns, strips = np.divmod(first, ys.shape[1])
    # A power of two is exact in a double, and its exponent there is one more than here.
    rows = np.frexp((bits & (~bits + np.uint64(1))).astype(np.float64))[1] - 1
    return bits != 0, places + columns * PLACE_PITCH + strips * height + rows


def _strip_height(cell_height: int) -> int:
    """How many rows of a cell are told of by the bits of one number: all, or half of the highest cells'."""
    return cell_height if cell_height <= WORD_BITS else cell_height // 2


@cache
def _blocking_strips(height: int) -> NDArray[np.uint64]:
    """(10, 63, height + 62, 9) by other kind, x and y from the other to a strip's pixel, new kind: bits, by row.

    A strip is one pixel wide and `height` high. Bit j tells whether a new item at its row j would overlap the other.
    x has LARGEST_SIDE + 1 added, y LARGEST_SIDE + `height`; those beyond the first and last entry are as those, where
    nothing is in the way. So it is wherever the other kind is the tenth.
    """
    reach = slice(OFFSET_LIMIT - LARGEST_SIDE, OFFSET_LIMIT + LARGEST_SIDE + 1)
    blocking = (_clearance()[:, :, reach, reach] == OVERLAPPING).transpose(1, 2, 3, 0)  # (9, 61, 61, 9)
    window = blocking.shape[1]
    strips = np.zeros((KIND_COUNT + 1, window + 2, window + height + 1, KIND_COUNT), np.uint64)
    for row in range(height):
        strips[:NO_KIND, 1:-1, height - row : height - row + window] |= blocking.astype(np.uint64) << np.uint64(row)
    return strips


@cache
def _search_strips(cell_width: int, cell_height: int) -> NDArray[np.uint64]:
    """(cell width, strips of a column, 9) by kind: bits of where in a cell the search may place an item."""
    height = _strip_height(cell_height)
    offsets = search_offsets(cell_width, cell_height).reshape(KIND_COUNT, cell_width, cell_height // height, height)
    bits = np.left_shift(np.uint64(1), np.arange(height, dtype=np.uint64))
    return np.ascontiguousarray((offsets * bits).sum(-1, dtype=np.uint64).transpose(1, 2, 0))


@cache
def _inside_strips(height: int) -> NDArray[np.uint64]:
    """(100, 100 // height, 9) by x, strip and kind: bits of where an item lies inside the box."""
    bits = np.left_shift(np.uint64(1), np.arange(height, dtype=np.uint64))
    strips = inside_corners().reshape(KIND_COUNT, BOX_SIDE, BOX_SIDE // height, height)
    return np.ascontiguousarray((strips * bits).sum(-1, dtype=np.uint64).transpose(1, 2, 0))


def _blocked(
    height: int, kinds: Int64Array, strips: tuple[Int64Array, Int64Array], slots: Int64Array
) -> NDArray[np.uint64]:
    """(k, columns, strips of a column) bits of where new items of `kinds` would overlap any of those in slots.

    `strips`: x (k, columns) and y (k, strips of a column) of their first pixels.
    """
    table = _blocking_strips(height)
    _, widest, highest, _ = table.shape
    other_kinds, other_places = unpacked(slots)
    other_xs, other_ys = np.divmod(other_places, PLACE_PITCH)
    across = strips[0][:, None] - other_xs[:, :, None] + (LARGEST_SIDE + 1)  # (k, slots, columns)
    down = strips[1][:, None] - other_ys[:, :, None] + (LARGEST_SIDE + height)  # (k, slots, strips of a column)
    across, down = np.minimum(np.maximum(across, 0), widest - 1), np.minimum(np.maximum(down, 0), highest - 1)
    across += (other_kinds * widest)[:, :, None]
    across *= highest * KIND_COUNT
    down *= KIND_COUNT
    down += kinds[:, None, None]
    return np.bitwise_or.reduce(table.reshape(-1).take(across[..., None] + down[:, :, None]), axis=1)


@cache
def _clearance() -> NDArray[np.uint8]:
    """(9, 9, 69, 69) `PlacementTables.clearance` by new kind, other kind, x and y."""
    codes = np.frombuffer(b"".join(map(b"".join, placement_tables().clearance)), np.uint8)
    return codes.reshape(KIND_COUNT, KIND_COUNT, OFFSET_COUNT, OFFSET_COUNT)


@cache
def geometry() -> Geometry:
    tables = placement_tables()
    moves = np.frombuffer(b"".join(map(b"".join, tables.moves)), np.uint8).copy()
    moves[list(tables.ties)] = TIED
    clearance = np.full((KIND_COUNT, KIND_COUNT + 1, 2 * FARTHEST + 1, PLACE_PITCH), FIRST_TOO_FAR, np.uint8)
    near = slice(FARTHEST - OFFSET_LIMIT, FARTHEST + OFFSET_LIMIT + 1)
    clearance[:, :NO_KIND, near, near] = _clearance()
    return Geometry(clearance.ravel(), moves)


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
