"""The places in the cells of a Scatter grid that items leave free: where an ADD puts its item, and what is legal.

Each place that a new item may take in a cell, by its footprint, is one bit, set in an empty box. An item clears some of
these bits, depending on its own footprint and its offset from the cell: the bits of the empty box, ANDed with what each
item of the box keeps, are the free places. One more bit is cleared by items that cover part of the cell, and shows
whether something can be removed. Source: docs/spec.md, "Legality and effects".
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.scene import BOX_SIDE, FOOTPRINT_COUNT, FOOTPRINTS, Item
from lilgym_mp.scene.appearances.base import LAST_CORNER
from lilgym_mp.scene.appearances.scatter.actions import ITEM_TYPE_FOOTPRINTS
from lilgym_mp.scene.appearances.scatter.geometry import (
    AREA_UNIT,
    LARGEST_SIDE,
    cell_areas,
    clear_templates,
    shape_area,
)
from lilgym_mp.scene.arrays import BoolArray, Int64Array, UInt16Array, UInt64Array

WORD_BITS = 64
HIGHEST_PART = 25  # rows; higher cells are divided into parts, as they would have too many places
LOW_PART = 10  # rows; a divisor of the heights of all higher cells
REMOVABLE = 1 << FOOTPRINT_COUNT  # the bit for REMOVE in a cell's legal edits, above one bit for each footprint to add

# (1024, 27) by legal edits of a cell: whether each item type can be added
ADDS = (np.arange(2 * REMOVABLE)[:, None] >> np.array(ITEM_TYPE_FOOTPRINTS) & 1).astype(bool)


class CellPlaces(NamedTuple):
    """Lookup tables for one cell size. A part is a range of rows of a cell, usually all of them."""

    part_height: int  # rows
    corners: Int64Array  # (places, 2) by bit, ordered by footprint, x and y: x and y in a part
    first_places: Int64Array  # (10,) the first bit of each footprint, and that for REMOVE
    empty: UInt64Array  # (cells of a box, parts, words) the bits in an empty box
    kept: UInt64Array  # (distinct lines, words) the bits that an item keeps set; line 0 keeps all
    kept_index: NDArray[np.unsignedinteger]  # (9, columns, rows) by footprint and `offset`: index in `kept`
    # index in `kept_index` of equal top-left corners; increases with the offset of a part from the item
    offset: tuple[int, int]
    words: Int64Array  # (groups,) word of each group of bits for one edit
    groups: UInt64Array  # (groups, 1, 1) the bits of the word
    edits: UInt16Array  # (groups, 1, 1) bit of the footprint, legal if a bit is set; last: REMOVABLE, legal if none is


@cache
def cell_places(cell_width: int, cell_height: int, *, searches: bool) -> CellPlaces:
    """The tables for a cell size in pixels; `searches`: whether an ADD may place the item elsewhere in its cell."""
    height = cell_height if cell_height <= HIGHEST_PART else LOW_PART
    allowed = _allowed_places(cell_width, cell_height, height, searches=searches)
    corners = np.argwhere(allowed.any(axis=(3, 4)))
    footprints = np.append(corners[:, 0], FOOTPRINT_COUNT)
    margins = [(0, 0), (0, 0), (cell_width - 1, cell_width - 1), (height - 1, height - 1)]
    clear = np.pad(clear_templates(), margins, constant_values=True)
    columns = clear.shape[2] - cell_width + 1
    rows = clear.shape[3] - height + 1
    kept_by_place = [clear[:, footprint, x : x + columns, y : y + rows] for footprint, x, y in corners.tolist()]
    kept = _packed([*kept_by_place, _uncovered(cell_width, height)])
    distinct, indices = _distinct(kept.reshape(-1, kept.shape[-1]))
    groups = [_packed(list(footprints == footprint)) for footprint in range(FOOTPRINT_COUNT + 1)]
    words = [(footprint, word) for footprint, bits in enumerate(groups) for word in np.flatnonzero(bits).tolist()]
    return CellPlaces(
        part_height=height,
        corners=corners[:, 1:],
        first_places=np.searchsorted(footprints, np.arange(FOOTPRINT_COUNT + 1)),
        empty=_packed([*allowed[tuple(corners.T)], np.ones(allowed.shape[3:], bool)]),
        kept=distinct,
        kept_index=indices.reshape(kept.shape[:-1]).astype(np.min_scalar_type(indices.max())),
        offset=(columns - LARGEST_SIDE - 1, rows - LARGEST_SIDE - 1),
        words=np.array([word for _, word in words]),
        groups=np.array([[[groups[footprint][word]]] for footprint, word in words]),
        edits=np.array([[[1 << footprint]] for footprint, _ in words], np.uint16),
    )


def legal_edits(items: Iterable[Item], cell: tuple[int, int], *, searches: bool) -> UInt16Array:
    """(cells,) the legal edits of each cell of a box, ordered by column: bits of footprints to add, and REMOVABLE."""
    places = cell_places(*cell, searches=searches)
    free = places.empty.copy()
    width = cell[0]
    height = places.part_height
    by_part = free.reshape(BOX_SIDE // width, BOX_SIDE // height, -1)
    for item in items:
        left = places.offset[0] - item.x
        top = places.offset[1] - item.y
        window = places.kept_index[item.footprint, left % width :: width, top % height :: height]
        columns, shown_columns = _overlap(-(left // width), window.shape[0], by_part.shape[0])
        rows, shown_rows = _overlap(-(top // height), window.shape[1], by_part.shape[1])
        near = by_part[columns, rows]
        near &= places.kept.take(window[shown_columns, shown_rows], axis=0)
    is_set = (np.moveaxis(free, -1, 0)[places.words] & places.groups) != 0
    is_set[-1] ^= True
    return np.bitwise_or.reduce(np.bitwise_or.reduce(is_set * places.edits), axis=1)


def searched(footprint: int, x: int, y: int, cell: tuple[int, int], items: Iterable[Item]) -> tuple[int, int] | None:
    """The first free position in the cell whose top-left pixel is (x, y), or None.

    The search goes by column from the left, and from top to bottom within a column.
    """
    places = cell_places(*cell, searches=True)
    empty, kept, kept_index = _as_ints(cell)
    _, columns, rows = places.kept_index.shape
    first, stop = places.first_places[footprint : footprint + 2].tolist()
    wanted = (1 << stop) - (1 << first)
    found: list[tuple[int, int]] = []
    for part, free in enumerate(empty[x // cell[0] * (BOX_SIDE // cell[1]) + y // cell[1]]):
        part_y = y + part * places.part_height
        for item in items:
            left = x - item[0] + places.offset[0]
            top = part_y - item[1] + places.offset[1]
            if 0 <= left < columns and 0 <= top < rows:
                free &= kept[kept_index[FOOTPRINTS[item[2]][item[4]], left, top]]
        free &= wanted
        if free:
            dx, dy = places.corners[(free & -free).bit_length() - 1].tolist()
            found.append((x + dx, part_y + dy))
    return min(found, default=None)


@cache
def _as_ints(cell: tuple[int, int]) -> tuple[list[list[int]], list[int], memoryview]:
    """`empty` and `kept` of `CellPlaces` with one int for all words, and `kept_index`: faster for single cells."""
    places = cell_places(*cell, searches=True)
    empty, kept = (
        [int.from_bytes(line.tobytes(), "little") for line in lines.reshape(-1, lines.shape[-1])]
        for lines in (places.empty, places.kept)
    )
    parts = places.empty.shape[1]
    return [empty[index : index + parts] for index in range(0, len(empty), parts)], kept, places.kept_index.data


def _overlap(start: int, length: int, size: int) -> tuple[slice, slice]:
    """The overlap of an axis of `size` with a window of `length` from `start`, in coordinates of each."""
    first = max(0, start)
    stop = max(first, min(size, start + length))
    return slice(first, stop), slice(first - start, stop - start)


def _allowed_places(width: int, cell_height: int, height: int, *, searches: bool) -> BoolArray:
    """(9, width, height, cells, parts) by footprint, pixel of a part, cell and part: whether an ADD to the cell can put
    the item there in an empty box."""
    in_cell = np.zeros((FOOTPRINT_COUNT, width, cell_height), bool)
    if searches:
        in_cell |= _search_offsets(width, cell_height)
    in_cell[:, 0, 0] = True
    along = np.arange(BOX_SIDE) <= np.array(LAST_CORNER)[:, None]
    columns = BOX_SIDE // width
    rows = BOX_SIDE // cell_height
    allowed = np.tile(in_cell, (1, columns, rows)) & along[:, :, None] & along[:, None, :]
    by_pixel = allowed.reshape(FOOTPRINT_COUNT, columns, width, rows, -1, height).transpose(0, 2, 5, 1, 3, 4)
    return by_pixel.reshape(FOOTPRINT_COUNT, width, height, columns * rows, -1)


def _search_offsets(cell_width: int, cell_height: int) -> BoolArray:
    """(9, cell width, cell height) by footprint and offset in the cell: whether the search may place an item there.

    It may if half of the item lies in the cell or the item covers half of the cell.
    """
    areas = cell_areas(cell_width, cell_height)[:, :cell_width, :cell_height]
    inside = areas[:, ::-1, ::-1]
    half_items = np.array([shape_area(footprint) for footprint in range(FOOTPRINT_COUNT)])[:, None, None]
    half_cell = cell_width * cell_height * AREA_UNIT
    return (2 * inside >= half_items) | (2 * inside >= half_cell)


def _uncovered(width: int, height: int) -> BoolArray:
    """(9, columns, rows) by footprint of an item and `CellPlaces.offset`: whether it covers nothing of a part."""
    uncovered = cell_areas(width, height) == 0
    beyond = LARGEST_SIDE, 1  # offsets beyond those of `cell_areas`
    return np.pad(uncovered, [(0, 0), beyond, beyond], constant_values=True)


def _packed(flags: Sequence[BoolArray | np.bool_]) -> UInt64Array:
    """(..., words) the flags as bits, the first being the lowest of the first word."""
    byte_count = -(-len(flags) // WORD_BITS) * WORD_BITS // 8
    packed = np.zeros((byte_count, *flags[0].shape), np.uint8)
    for bit, flag in enumerate(flags):
        packed[bit // 8] |= flag.astype(np.uint8) << np.uint8(bit % 8)
    return np.ascontiguousarray(np.moveaxis(packed, 0, -1)).view("<u8")


def _distinct(lines: UInt64Array) -> tuple[UInt64Array, Int64Array]:
    """The distinct lines, the first being one that keeps all bits, and the index of each of `lines` among them."""
    values = lines.view(np.dtype((np.void, lines.strides[0]))).ravel().tolist()
    indices = {line: index for index, line in enumerate(dict.fromkeys(values))}
    return np.frombuffer(b"".join(indices), lines.dtype).reshape(-1, lines.shape[1]), np.array(
        [*map(indices.get, values)]
    )
