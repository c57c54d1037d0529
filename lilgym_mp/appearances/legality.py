"""Where in a box an item can be added and removed, cell by cell, for every footprint at once.

A word of bits holds some pixels of a column, so that one operation on a small array of words tells where an item
leaves room for others. Source: SPEC section 4.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances.placement import LARGEST_SIDE, cell_areas, clear_templates, inside_corners, search_offsets
from lilgym_mp.arrays import BoolArray
from lilgym_mp.scene import BOX_SIDE, FOOTPRINT_COUNT, Item

WORD_BITS = (8, 16, 32, 64)
REMEMBERED = 20_000  # footprints and places of items whose surroundings are kept

Words = NDArray[Any]  # unsigned integers
Place = tuple[slice, ...]


class _Span(NamedTuple):
    """Some of an array's axis over which something is laid that may stick out on both sides."""

    there: slice  # of the axis
    own: slice  # of what is laid over it

    @classmethod
    def of(cls, start: int, length: int, size: int) -> _Span:
        """Over an axis of `size`, from `start`, which may be negative."""
        first = max(0, start)
        stop = max(first, min(size, start + length))
        return cls(slice(first, stop), slice(first - start, stop - start))


@cache
def box_legality(cell_width: int, cell_height: int, *, searches: bool) -> BoxLegality:
    """The legality of cells of that size in pixels; `searches`: whether an item may go elsewhere in its cell."""
    return BoxLegality(cell_width, cell_height, searches=searches)


class BoxLegality:
    """Arrays over the cells of one box, by column and row."""

    def __init__(self, cell_width: int, cell_height: int, *, searches: bool) -> None:
        self._cell = cell_width, cell_height
        self._grid = BOX_SIDE // cell_width, BOX_SIDE // cell_height
        self._pixels = cell_height if cell_height <= WORD_BITS[-1] else cell_height // 2  # of a column, in a word
        # (footprints, words, 100) bits by column: where a corner may be in an empty box.
        self._allowed = self._packed(allowed_corners(cell_width, cell_height, searches=searches))
        self._clear = [self._clear_words(footprint) for footprint in range(FOOTPRINT_COUNT)]
        self._covers = np.array(cell_areas(cell_width, cell_height)) > 0
        self._left_clear = lru_cache(REMEMBERED)(self._new_clear)
        self._covered = lru_cache(REMEMBERED)(self._new_covered)

    def addable(self, items: Iterable[Item]) -> BoolArray:
        """(columns, rows, footprints): whether an ADD to the cell is valid in a box with `items`."""
        by_cell = np.bitwise_or.reduce(self._room(items), axis=-1)
        return by_cell.any(axis=2).transpose(2, 1, 0)

    def first_places(self, items: Iterable[Item]) -> tuple[NDArray[np.int64], NDArray[np.int64], BoolArray]:
        """(cells, footprints): x and y where an item of the footprint added to the cell is placed before snapping, and
        whether there is such a place. Cells are in the order of their columns, then rows."""
        columns, rows = self._grid
        width, height = self._cell
        room = self._room(items).transpose(3, 1, 0, 4, 2).reshape(columns * rows, FOOTPRINT_COUNT, -1)
        some = room != 0
        first = some.argmax(axis=2)  # columns from left to right, and the words of a column from the top
        word = np.take_along_axis(room, first[:, :, None], axis=2)[:, :, 0].astype(np.uint64)
        lowest = np.frexp((word & (~word + np.uint64(1))).astype(np.float64))[1] - 1
        pixel_column, part = np.divmod(first, height // self._pixels)
        column, row = np.divmod(np.arange(columns * rows)[:, None], rows)
        return column * width + pixel_column, row * height + part * self._pixels + lowest, some.any(axis=2)

    def _room(self, items: Iterable[Item]) -> Words:
        """(footprints, rows, words of a cell's column, columns, cell width) bits: free corners beside `items`."""
        room = self._allowed.copy()
        for item in items:
            place, clear = self._left_clear(item.footprint, item.x, item.y)
            here = room[place]
            here &= clear
        columns, rows = self._grid
        return room.reshape(FOOTPRINT_COUNT, rows, -1, columns, self._cell[0])

    def removable(self, items: Iterable[Item]) -> BoolArray:
        """(columns, rows) whether one of `items` covers part of each cell."""
        found = np.zeros(self._grid, np.bool_)
        for item in items:
            place, covers = self._covered(item.footprint, item.x, item.y)
            here = found[place]
            here |= covers
        return found

    def _new_clear(self, footprint: int, x: int, y: int) -> tuple[Place, Words]:
        """The words around an item of `footprint` at (x, y), and their bits that it leaves clear."""
        columns = _Span.of(x - LARGEST_SIDE, 2 * LARGEST_SIDE + 1, BOX_SIDE)
        first, phase = divmod(y - LARGEST_SIDE, self._pixels)
        words = self._clear[footprint][phase]
        rows = _Span.of(first, words.shape[1], self._allowed.shape[1])
        return (slice(None), rows.there, columns.there), words[:, rows.own, columns.own]

    def _new_covered(self, footprint: int, x: int, y: int) -> tuple[Place, BoolArray]:
        """The cells that an item of `footprint` at (x, y) may reach, and which of them it covers in part."""
        (column, left), (row, top) = divmod(x, self._cell[0]), divmod(y, self._cell[1])
        width, height = self._cell
        covers = self._covers[footprint, width - 1 - left :: width, height - 1 - top :: height]
        columns = _Span.of(column, covers.shape[0], self._grid[0])
        rows = _Span.of(row, covers.shape[1], self._grid[1])
        return (columns.there, rows.there), covers[columns.own, rows.own]

    def _clear_words(self, footprint: int) -> Sequence[Words]:
        """(footprints, words, 61): how far below a word's first pixel the window around an item of `footprint` starts.

        The window reaches LARGEST_SIDE from the item's corner; its bits are where items stay clear.
        """
        clear = clear_templates()[footprint]
        window = clear.shape[-1]
        padded = -(-(self._pixels - 1 + window) // self._pixels) * self._pixels
        phases: list[Words] = []
        for phase in range(self._pixels):
            pixels = np.ones((*clear.shape[:-1], padded), np.bool_)
            pixels[..., phase : phase + window] = clear
            phases.append(self._packed(pixels))
        return phases

    def _packed(self, pixels: BoolArray) -> Words:
        """(footprints, x, y) flags as (footprints, words, x) words."""
        by_word = pixels.reshape(*pixels.shape[:2], -1, self._pixels).transpose(0, 2, 1, 3)
        bits = next(bits for bits in WORD_BITS if bits >= self._pixels)
        values = np.left_shift(np.uint64(1), np.arange(self._pixels, dtype=np.uint64))
        return np.ascontiguousarray((by_word * values).sum(axis=3, dtype=np.uint64).astype(f"u{bits // 8}"))


def allowed_corners(cell_width: int, cell_height: int, *, searches: bool) -> BoolArray:
    """(footprints, 100, 100) by footprint, x, y: whether an ADD to that pixel's cell may put the corner there."""
    columns, rows = BOX_SIDE // cell_width, BOX_SIDE // cell_height
    in_cell = np.zeros((FOOTPRINT_COUNT, cell_width, cell_height), np.bool_)
    if searches:
        in_cell |= search_offsets(cell_width, cell_height)
    in_cell[:, 0, 0] = True
    return np.tile(in_cell, (1, columns, rows)) & inside_corners()
