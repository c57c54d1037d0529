"""What items leave free in the cells of a Scatter grid, as look-up tables for array operations.

Every place in a cell that an added item may take, for each kind of item, is a bit of the cell's words. An item takes
some of them away, depending on its kind and on how it lies to the cell: so the words that hold the bits of an empty
box, ANDed with what each of the box's items leaves, tell which kinds can be added. A last bit, which an item that
covers part of the cell takes away, tells in the same way whether something can be removed. Source: SPEC section 4.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances.legality import allowed_corners
from lilgym_mp.appearances.placement import LARGEST_SIDE, cell_areas, clear_templates
from lilgym_mp.envs.block import BoolArray, Int64Array
from lilgym_mp.envs.scatter_tables import FARTHEST, PLACE_PITCH, SAME_PLACE
from lilgym_mp.scene import BOX_SIDE, KIND_COUNT

WORD_BITS = 64
FLAGS = 8  # words whose emptiness a byte tells of
HIGHEST_PART = 25  # rows: of higher cells, whose places would be too many, parts are looked at one after another
LOW_PART = 10  # rows: divides the heights of all higher cells
REMOVABLE = 1 << KIND_COUNT  # in a cell's legal edits, beside a bit for each kind that can be added

Words = NDArray[np.uint64]


class CellRoom(NamedTuple):
    """The tables for one size of cells. A part is some rows of a cell, mostly all."""

    corners: Int64Array  # (parts, cells) places of the parts' top-left pixels, plus SAME_PLACE
    empty: Words  # (parts, cells, words) the parts' words in an empty box
    left: Words  # (lines, words) what an item leaves; all in line 0
    lines: NDArray[np.unsignedinteger]  # (10 * PAIR_SIZE,) by a corner less an item's slot: lines of `left`
    edits: NDArray[np.uint16]  # (words // 8, 256) by which of eight words are not 0: legal edits, to be ORed

    @property
    def cell_count(self) -> int:
        """In a box."""
        return self.corners.shape[1]

    def reached(self, slots: Int64Array) -> BoolArray:
        """(k, cells) whether items in slots (k,) may take something away from each cell."""
        return (self.lines.take(self.corners[:, None] - slots[:, None]) != 0).any(axis=0)

    def legal_edits(
        self, slots: Int64Array, counts: Int64Array, boxes: Int64Array, cells: Int64Array
    ) -> NDArray[np.uint16]:
        """(c,) a bit for each kind that can be added to `cells` (c,) of `boxes` (c,), ascending, and REMOVABLE.

        The boxes have slots (k, slots), of which `counts` (k,), descending, are filled.
        """
        filled = (-counts).searchsorted(-np.arange(int(counts[0])))  # (slots,) how many boxes fill each slot
        ends = boxes.searchsorted(filled).tolist()  # how many of the cells are theirs
        found = np.zeros(len(cells), np.uint16)
        for corners, empty in zip(self.corners, self.empty, strict=True):
            words, corners_there = empty.take(cells, axis=0), corners[cells]
            for slot, end in enumerate(ends):
                differences = corners_there[:end] - slots[:, slot].take(boxes[:end])
                words[:end] &= self.left.take(self.lines.take(differences), axis=0)
            flags = np.packbits(words != 0, bitorder="little").reshape(len(cells), len(self.edits))
            for group, edits in enumerate(self.edits):
                found |= edits.take(flags[:, group])
        return found


class _Word(NamedTuple):
    """A word of every cell, whose bits tell of one legal edit."""

    edit: int  # a bit
    left: Words  # (9, x, y) by kind of an item and how a part lies to it
    empty: Words  # (parts, cells)


@cache
def cell_room(cell_width: int, cell_height: int, *, searches: bool) -> CellRoom:
    """The tables for cells of that size in pixels; `searches`: whether an item may go elsewhere in its cell."""
    height = cell_height if cell_height <= HIGHEST_PART else LOW_PART
    allowed = _allowed_places(cell_width, cell_height, height, searches=searches)
    words = [*_adding(allowed), _removing(cell_width, height, allowed.shape[3:])]
    width = -(-len(words) // FLAGS) * FLAGS
    parts, cells = allowed.shape[3:]
    empty = np.zeros((parts, cells, width), np.uint64)
    window = words[0].left.shape
    left = np.zeros((*window, width), np.uint64)
    for index, word in enumerate(words):
        empty[..., index], left[..., index] = word.empty, word.left
    everything = np.bitwise_or.reduce(empty.reshape(-1, width))
    distinct, numbers = _distinct(np.concatenate([everything[None], left.reshape(-1, width)]))
    return CellRoom(
        corners=_corners(cell_width, cell_height, height),
        empty=empty,
        left=distinct,
        lines=_by_difference(numbers[1:].reshape(window)),
        edits=_edits_by_flags([word.edit for word in words]),
    )


def _allowed_places(width: int, cell_height: int, height: int, *, searches: bool) -> BoolArray:
    """(9, width, height, parts, cells) whether an item of a kind may go to that pixel of a part."""
    allowed = allowed_corners(width, cell_height, searches=searches)
    shape = KIND_COUNT, BOX_SIDE // width, width, BOX_SIDE // cell_height, cell_height // height, height
    by_pixel = allowed.reshape(shape).transpose(0, 2, 5, 4, 1, 3)
    return by_pixel.reshape(*by_pixel.shape[:4], -1)


def _corners(width: int, cell_height: int, height: int) -> Int64Array:
    """`CellRoom.corners` of parts that are `height` pixels high."""
    xs, ys = np.arange(0, BOX_SIDE, width), np.arange(0, BOX_SIDE, cell_height)
    cells = (xs[:, None] * PLACE_PITCH + ys).ravel()
    return np.arange(0, cell_height, height)[:, None] + cells + SAME_PLACE


def _adding(allowed: BoolArray) -> Iterator[_Word]:
    """The words of all kinds, from `_allowed_places`.

    How a part lies to an item goes, in x and y, from -LARGEST_SIDE less the part's last pixel to LARGEST_SIDE.
    """
    _, width, height, *_ = allowed.shape
    margins = [(0, 0), (0, 0), (width - 1, width - 1), (height - 1, height - 1)]
    clear = np.pad(clear_templates(), margins, constant_values=True)
    for kind, places in enumerate(allowed):
        pixels = np.argwhere(places.any(axis=(2, 3))).tolist()
        columns, rows = clear.shape[2] - width + 1, clear.shape[3] - height + 1
        for first in range(0, len(pixels), WORD_BITS):
            some = pixels[first : first + WORD_BITS]
            left = _packed([clear[:, kind, x : x + columns, y : y + rows] for x, y in some])
            yield _Word(1 << kind, left, _packed([places[x, y] for x, y in some]))


def _removing(width: int, height: int, cells: tuple[int, ...]) -> _Word:
    """The word of REMOVABLE, of (parts, cells) `cells`, over the same window as those of `_adding`."""
    uncovered = np.array(cell_areas(width, height)) == 0
    beyond = LARGEST_SIDE, 1  # offsets that `cell_areas` leaves out on either side, where nothing is covered
    left = np.pad(uncovered, [(0, 0), beyond, beyond], constant_values=True)
    return _Word(REMOVABLE, _packed([left]), np.ones(cells, np.uint64))


def _packed(flags: Sequence[BoolArray]) -> Words:
    """Words whose bits are the flags, the first the lowest."""
    words = np.zeros(flags[0].shape, np.uint64)
    for bit, flag in enumerate(flags):
        words |= flag.astype(np.uint64) << np.uint64(bit)
    return words


def _distinct(lines: Words) -> tuple[Words, Int64Array]:
    """Each different line once, in the order in which they are met first, and the number of each of `lines`."""
    numbers: dict[bytes, int] = {}
    found = np.array([numbers.setdefault(line.tobytes(), len(numbers)) for line in lines])
    return np.frombuffer(b"".join(numbers), lines.dtype).reshape(-1, lines.shape[1]), found


def _by_difference(numbers: Int64Array) -> NDArray[np.unsignedinteger]:
    """`CellRoom.lines` from line numbers (9, x, y) by kind and how a part lies to an item; 0 where that is farther."""
    _, columns, rows = numbers.shape
    table = np.zeros((KIND_COUNT + 1, 2 * FARTHEST + 1, PLACE_PITCH), np.min_scalar_type(numbers.max()))
    left, top = FARTHEST + LARGEST_SIDE + 1 - columns, FARTHEST + LARGEST_SIDE + 1 - rows
    table[:KIND_COUNT, left : left + columns, top : top + rows] = numbers
    return table.ravel()


def _edits_by_flags(edits: list[int]) -> NDArray[np.uint16]:
    """`CellRoom.edits`, from the edit that each word asks for."""
    table = np.zeros((-(-len(edits) // FLAGS), 1 << FLAGS), np.uint16)
    for index, edit in enumerate(edits):
        group, flag = divmod(index, FLAGS)
        is_set = np.arange(1 << FLAGS) >> flag & 1
        table[group] |= np.where(is_set == (edit != REMOVABLE), edit, 0).astype(np.uint16)
    return table
