"""Legal ADDs and REMOVEs of a box, by cell, for all footprints at once.

Flags of pixels are packed into words along the columns, so that a few operations on small arrays find the positions
that items leave free. Source: docs/spec.md, "Legality and effects".
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.scene import BOX_SIDE, FOOTPRINT_COUNT, Item
from lilgym_mp.scene.appearances.cell_search import search_offsets
from lilgym_mp.scene.appearances.placement import (
    LARGEST_SIDE,
    cell_areas,
    clear_templates,
    inside_corners,
)
from lilgym_mp.scene.arrays import BoolArray

WORD_BITS = (8, 16, 32, 64)
CACHED_ITEMS = 20_000  # triples (footprint, x, y) whose masks are cached

Words = NDArray[Any]  # unsigned integers
Place = tuple[slice, ...]


@cache
def box_legality(cell_width: int, cell_height: int, *, searches: bool) -> BoxLegality:
    """Legality for a cell size in pixels; `searches`: whether an ADD may place the item elsewhere in its cell."""
    return BoxLegality(cell_width, cell_height, searches=searches)


class BoxLegality:
    """Computes which edits are legal in each cell of a box."""

    def __init__(self, cell_width: int, cell_height: int, *, searches: bool) -> None:
        self._cell = cell_width, cell_height
        self._grid = BOX_SIDE // cell_width, BOX_SIDE // cell_height
        self._pixels = cell_height if cell_height <= WORD_BITS[-1] else cell_height // 2  # pixels of a column per word
        # (footprints, words, 100) bitmasks by column: where a corner can be in an empty box.
        self._allowed = self._packed(allowed_corners(cell_width, cell_height, searches=searches))
        self._clear = [self._clear_words(footprint) for footprint in range(FOOTPRINT_COUNT)]
        self._covers = np.array(cell_areas(cell_width, cell_height)) > 0
        self._clear_of = lru_cache(CACHED_ITEMS)(self._compute_clear)
        self._covered_by = lru_cache(CACHED_ITEMS)(self._compute_covered)

    def addable(self, items: Iterable[Item]) -> BoolArray:
        """(columns, rows, footprints): whether an ADD to the cell is valid in a box with `items`."""
        free = self._allowed.copy()  # bitmasks of free corners
        for item in items:
            place, clear = self._clear_of(item.footprint, item.x, item.y)
            here = free[place]
            here &= clear
        columns, rows = self._grid
        by_column = free.reshape(FOOTPRINT_COUNT, rows, -1, columns, self._cell[0])
        by_cell = np.bitwise_or.reduce(by_column, axis=-1)
        return by_cell.any(axis=2).transpose(2, 1, 0)

    def removable(self, items: Iterable[Item]) -> BoolArray:
        """(columns, rows): whether one of `items` covers part of the cell."""
        found = np.zeros(self._grid, np.bool_)
        for item in items:
            place, covers = self._covered_by(item.footprint, item.x, item.y)
            here = found[place]
            here |= covers
        return found

    def _compute_clear(self, footprint: int, x: int, y: int) -> tuple[Place, Words]:
        """The slice of words around an item of `footprint` at (x, y), and masks of the bits that it leaves free."""
        columns, shown_columns = _overlap(x - LARGEST_SIDE, 2 * LARGEST_SIDE + 1, BOX_SIDE)
        first, phase = divmod(y - LARGEST_SIDE, self._pixels)
        words = self._clear[footprint][phase]
        rows, shown_rows = _overlap(first, words.shape[1], self._allowed.shape[1])
        return (slice(None), rows, columns), words[:, shown_rows, shown_columns]

    def _compute_covered(self, footprint: int, x: int, y: int) -> tuple[Place, BoolArray]:
        """The slice of cells around an item of `footprint` at (x, y), and which of them it covers in part."""
        (column, left), (row, top) = divmod(x, self._cell[0]), divmod(y, self._cell[1])
        width, height = self._cell
        covers = self._covers[footprint, width - 1 - left :: width, height - 1 - top :: height]
        columns, shown_columns = _overlap(column, covers.shape[0], self._grid[0])
        rows, shown_rows = _overlap(row, covers.shape[1], self._grid[1])
        return (columns, rows), covers[shown_columns, shown_rows]

    def _clear_words(self, footprint: int) -> Sequence[Words]:
        """(footprints, words, 61) bitmasks of the corners at which new items do not overlap an item of `footprint`.

        Corners up to LARGEST_SIDE from the item's, indexed by the position of the first one within its word.
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
        """Packs (footprints, x, y) flags into (footprints, words, x) words."""
        by_word = pixels.reshape(*pixels.shape[:2], -1, self._pixels).transpose(0, 2, 1, 3)
        bits = next(bits for bits in WORD_BITS if bits >= self._pixels)
        values = np.left_shift(np.uint64(1), np.arange(self._pixels, dtype=np.uint64))
        return np.ascontiguousarray((by_word * values).sum(axis=3, dtype=np.uint64).astype(f"u{bits // 8}"))


def allowed_corners(cell_width: int, cell_height: int, *, searches: bool) -> BoolArray:
    """(footprints, 100, 100) by footprint, x, y: whether an ADD to that pixel's cell can put the corner there."""
    columns, rows = BOX_SIDE // cell_width, BOX_SIDE // cell_height
    in_cell = np.zeros((FOOTPRINT_COUNT, cell_width, cell_height), np.bool_)
    if searches:
        in_cell |= search_offsets(cell_width, cell_height)
    in_cell[:, 0, 0] = True
    return np.tile(in_cell, (1, columns, rows)) & inside_corners()


def _overlap(start: int, length: int, size: int) -> tuple[slice, slice]:
    """The overlap of an axis of `size` with a window of `length` from `start`, in coordinates of each."""
    first = max(0, start)
    stop = max(first, min(size, start + length))
    return slice(first, stop), slice(first - start, stop - start)
