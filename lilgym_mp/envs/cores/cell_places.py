"""Lookup tables for masks: the places in the cells of a Scatter grid that items leave free.

Each place that a new item may take in a cell, by its footprint, is one bit of the cell's 64-bit masks, set in an empty
box. An item clears some of them, depending on its own footprint and its offset from the cell: the masks of the empty
box, ANDed with what each item of the box keeps, show which footprints can be added. One more bit is cleared by items
that cover part of the cell, and shows whether something can be removed. Source: docs/spec.md, "Legality and effects".
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.scene import BOX_SIDE, FOOTPRINT_COUNT
from lilgym_mp.scene.appearances.legality import allowed_corners
from lilgym_mp.scene.appearances.numbering import ITEM_TYPE_FOOTPRINTS
from lilgym_mp.scene.appearances.placement import LARGEST_SIDE, cell_areas, clear_templates
from lilgym_mp.scene.arrays import BoolArray, Int64Array

MASK_BITS = 64
HIGHEST_PART = 25  # rows; higher cells are divided into parts, as they would have too many places
LOW_PART = 10  # rows; a divisor of the heights of all higher cells
REMOVABLE = 1 << FOOTPRINT_COUNT  # the bit for REMOVE in a cell's legal edits, above one bit for each footprint to add

Bits = NDArray[np.uint64]  # masks of 64 flags


class CellPlaces(NamedTuple):
    """Lookup tables for one cell size. A part is a range of rows of a cell, usually all of them."""

    part_height: int  # rows
    empty: Bits  # (parts, cells of a box, masks) masks in an empty box
    kept: Bits  # (distinct lines, masks) the bits that an item keeps set; line 0 keeps all
    kept_index: NDArray[np.unsignedinteger]  # (9, columns, rows) by footprint and `offset`: index in `kept`
    # index in `kept_index` of equal top-left corners; increases with the offset of a part from the item
    offset: tuple[int, int]
    edits: Int64Array  # (masks,) bit of the footprint, legal if the mask is not 0; last: REMOVABLE, legal if 0
    adds: BoolArray  # (2 * REMOVABLE, 27) by bitmask of legal edits: whether each item type can be added


class _Mask(NamedTuple):
    """One mask of every cell; its bits belong to one footprint, or to REMOVE."""

    edit: int  # a bit
    kept: Bits  # (9, x, y) by footprint of an item and offset of a part from it: bits kept set
    empty: Bits  # (parts, cells)


@cache
def cell_places(cell_width: int, cell_height: int, *, searches: bool) -> CellPlaces:
    """The tables for a cell size in pixels; `searches`: whether an ADD may place the item elsewhere in its cell."""
    height = cell_height if cell_height <= HIGHEST_PART else LOW_PART
    allowed = _allowed_places(cell_width, cell_height, height, searches=searches)
    masks = [*_adding(allowed), _removing(cell_width, height, allowed.shape[3:])]
    width = len(masks)
    empty = np.zeros((*allowed.shape[3:], width), np.uint64)
    window = masks[0].kept.shape
    kept = np.zeros((*window, width), np.uint64)
    for index, mask in enumerate(masks):
        empty[..., index], kept[..., index] = mask.empty, mask.kept
    everything = np.bitwise_or.reduce(empty.reshape(-1, width))
    distinct, indices = _distinct(np.concatenate([everything[None], kept.reshape(-1, width)]))
    columns, rows = window[1:]
    return CellPlaces(
        part_height=height,
        empty=empty,
        kept=distinct,
        kept_index=indices[1:].reshape(window).astype(np.min_scalar_type(indices.max())),
        offset=(columns - LARGEST_SIDE - 1, rows - LARGEST_SIDE - 1),
        edits=np.array([mask.edit for mask in masks]),
        adds=(np.arange(2 * REMOVABLE)[:, None] >> np.array(ITEM_TYPE_FOOTPRINTS) & 1).astype(np.bool_),
    )


def _allowed_places(width: int, cell_height: int, height: int, *, searches: bool) -> BoolArray:
    """(9, width, height, parts, cells) whether an item can be placed at the pixel of a part."""
    allowed = allowed_corners(width, cell_height, searches=searches)
    shape = FOOTPRINT_COUNT, BOX_SIDE // width, width, BOX_SIDE // cell_height, cell_height // height, height
    by_pixel = allowed.reshape(shape).transpose(0, 2, 5, 4, 1, 3)
    return by_pixel.reshape(*by_pixel.shape[:4], -1)


def _adding(allowed: BoolArray) -> Iterator[_Mask]:
    """The masks of all footprints, from `_allowed_places`.

    Offsets of a part from an item range from -LARGEST_SIDE minus the part's last pixel to LARGEST_SIDE, in x and y.
    """
    _, width, height, *_ = allowed.shape
    margins = [(0, 0), (0, 0), (width - 1, width - 1), (height - 1, height - 1)]
    clear = np.pad(clear_templates(), margins, constant_values=True)
    for footprint, places in enumerate(allowed):
        pixels = np.argwhere(places.any(axis=(2, 3))).tolist()
        columns, rows = clear.shape[2] - width + 1, clear.shape[3] - height + 1
        for first in range(0, len(pixels), MASK_BITS):
            some = pixels[first : first + MASK_BITS]
            kept = _packed([clear[:, footprint, x : x + columns, y : y + rows] for x, y in some])
            yield _Mask(1 << footprint, kept, _packed([places[x, y] for x, y in some]))


def _removing(width: int, height: int, cells: tuple[int, ...]) -> _Mask:
    """The mask for REMOVE, for (parts, cells) `cells`, over the same offsets as those of `_adding`."""
    uncovered = np.array(cell_areas(width, height)) == 0
    beyond = LARGEST_SIDE, 1  # offsets beyond those of `cell_areas`, where nothing is covered
    kept = np.pad(uncovered, [(0, 0), beyond, beyond], constant_values=True)
    return _Mask(REMOVABLE, _packed([kept]), np.ones(cells, np.uint64))


def _packed(flags: Sequence[BoolArray]) -> Bits:
    """Packs flags into masks, the first flag being the lowest bit."""
    packed = np.zeros(flags[0].shape, np.uint64)
    for bit, flag in enumerate(flags):
        packed |= flag.astype(np.uint64) << np.uint64(bit)
    return packed


def _distinct(lines: Bits) -> tuple[Bits, Int64Array]:
    """The distinct lines in order of first occurrence, and the index of each of `lines` among them."""
    numbers: dict[bytes, int] = {}
    found = np.array([numbers.setdefault(line.tobytes(), len(numbers)) for line in lines])
    return np.frombuffer(b"".join(numbers), lines.dtype).reshape(-1, lines.shape[1]), found
