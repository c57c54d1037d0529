"""Every edit of a box of scattered items at once: where each addition comes to rest, and what each removal takes away.

The same tables that `appearances` places single items by, indexed for all cells and kinds together.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from lilgym_mp.appearances import PlacementRules, Scatter
from lilgym_mp.appearances.legality import box_legality
from lilgym_mp.appearances.numbering import ITEM_TYPE_FOOTPRINTS, ITEM_TYPES, add_index, remove_index
from lilgym_mp.appearances.placement import (
    FIRST_TOO_FAR,
    LARGEST_MOVE,
    OFFSET_COUNT,
    OFFSET_LIMIT,
    OVERLAPPING,
    cell_areas,
    placement_tables,
)
from lilgym_mp.arrays import BoolArray, Int64Array, UInt8Array
from lilgym_mp.scene import BOX_PITCH, BOX_SIDE, FOOTPRINT_COUNT, FOOTPRINT_SIDES, Colour, Item, Shape
from lilgym_mp.solver.item_samples import BEYOND, PLACE_COUNT, places

KEPT_BOXES = 8_192  # whose edits are kept


class Additions(NamedTuple):
    """What each addition to one box does. Cells are numbered as actions number them: columns first, then rows."""

    valid: BoolArray  # (cells, 9) by kind: whether an item of it can be added
    x: Int64Array  # (cells, 9) where it comes to rest; anything where it cannot be added
    y: Int64Array  # (cells, 9)
    samples: Int64Array  # (cells * 27,) in the order of ADD's numbers: the item's sample, -1 where invalid

    def item(self, number: int) -> Item:
        """The item that the valid addition with that number, counted in this box, brings."""
        cell, item_type = divmod(number, len(ITEM_TYPES))
        shape, colour, size = ITEM_TYPES[item_type]
        footprint = ITEM_TYPE_FOOTPRINTS[item_type]
        return Item(int(self.x[cell, footprint]), int(self.y[cell, footprint]), shape, colour, size)


@lru_cache(maxsize=KEPT_BOXES)
def additions(scatter: Scatter, rules: PlacementRules, frame_x: int, items: tuple[Item, ...]) -> Additions:
    """The additions to a box with these items; `frame_x` is its left border in the coordinates that are rounded."""
    width, height = scatter.cell
    found_x, found_y, valid = box_legality(width, height, searches=scatter.searches(rules)).first_places(items)
    if items and not scatter.is_native:
        x, y = _snapped(found_x, found_y, valid, items, rules, frame_x)
    else:
        x, y = found_x, found_y
    return Additions(valid, x, y, _samples(x, y, valid))


@lru_cache(maxsize=KEPT_BOXES)
def addable_item_types(scatter: Scatter, rules: PlacementRules, items: tuple[Item, ...]) -> BoolArray:
    """(cells, 27) whether an item of each look can be added to each cell of a box with these items."""
    legality = box_legality(*scatter.cell, searches=scatter.searches(rules))
    return legality.addable(items)[..., _ADD_FOOTPRINTS].reshape(-1, len(ITEM_TYPES))


def addition_numbers(scatter: Scatter, index: int, additions: Int64Array) -> Int64Array:
    """The actions' numbers, from those of additions counted in box `index`."""
    return additions + add_index(scatter.box_cells[index].start, 0)


def removal_numbers(scatter: Scatter, index: int, cells: Int64Array) -> Int64Array:
    """The actions' numbers, from the cells of removals counted in box `index`."""
    return cells + remove_index(scatter.box_cells[index].start, scatter.cell_count)


def frame_of(rules: PlacementRules, index: int) -> int:
    """The left border of box `index` in the coordinates that the rules round."""
    return index * BOX_PITCH if rules.rounds_in_image else 0


class _Tables(NamedTuple):
    clearance: UInt8Array  # (9, 9, 69, 69), and beyond these offsets nothing is near
    moves: UInt8Array  # likewise
    tied: BoolArray  # likewise: whether nearest points are settled in place


@cache
def _tables() -> _Tables:
    tables = placement_tables()
    form = (FOOTPRINT_COUNT, FOOTPRINT_COUNT, OFFSET_COUNT, OFFSET_COUNT)
    clearance = np.frombuffer(b"".join(map(b"".join, tables.clearance)), np.uint8).reshape(form)
    moves = np.frombuffer(b"".join(map(b"".join, tables.moves)), np.uint8).reshape(form)
    tied = np.zeros(clearance.size, np.bool_)
    tied[list(tables.ties)] = True
    return _Tables(clearance, moves, tied.reshape(form))


_FOOTPRINTS = np.arange(FOOTPRINT_COUNT)
_ADD_FOOTPRINTS = np.array(ITEM_TYPE_FOOTPRINTS)


def _clearances(x: Int64Array, y: Int64Array, items: tuple[Item, ...]) -> Int64Array:
    """(items, cells, kinds) the clearance codes of an item of each kind at (x, y) to each item."""
    placed = np.array([(item[0], item[1], item[2] * 3 + item[4]) for item in items])
    dx = x - placed[:, 0, None, None] + OFFSET_LIMIT
    dy = y - placed[:, 1, None, None] + OFFSET_LIMIT
    near = (dx >= 0) & (dx < OFFSET_COUNT) & (dy >= 0) & (dy < OFFSET_COUNT)
    last = OFFSET_COUNT - 1
    codes = _tables().clearance[_FOOTPRINTS, placed[:, 2, None, None], dx.clip(0, last), dy.clip(0, last)]
    return np.where(near, codes, FIRST_TOO_FAR)


def _snapped(
    x: Int64Array, y: Int64Array, valid: BoolArray, items: tuple[Item, ...], rules: PlacementRules, frame_x: int
) -> tuple[Int64Array, Int64Array]:
    """Where items that found their places at (x, y) come to rest."""
    codes = _clearances(x, y, items)
    closest = codes.argmin(axis=0)
    cells, footprints = (valid & (codes.min(axis=0) < FIRST_TOO_FAR)).nonzero()
    if not len(cells):
        return x, y
    old_x, old_y, others = x[cells, footprints], y[cells, footprints], closest[cells, footprints]
    move_x, move_y = _moves(footprints, old_x, old_y, others, items, frame_x)
    new_x, new_y = x.copy(), y.copy()
    new_x[cells, footprints] += move_x
    new_y[cells, footprints] += move_y
    if not rules.keeps_unfit_snaps:
        last = BOX_SIDE - np.array(FOOTPRINT_SIDES)
        fits = (new_x >= 0) & (new_x <= last) & (new_y >= 0) & (new_y <= last)
        fits &= (_clearances(new_x, new_y, items) != OVERLAPPING).all(axis=0)
        new_x, new_y = np.where(fits, new_x, x), np.where(fits, new_y, y)
    return new_x, new_y


def _moves(
    footprints: Int64Array, x: Int64Array, y: Int64Array, others: Int64Array, items: tuple[Item, ...], frame_x: int
) -> tuple[Int64Array, Int64Array]:
    """By how much each new item moves to the one of `items` that `others` says."""
    placed = np.array([(item[0], item[1], item[2] * 3 + item[4]) for item in items])[others]
    place = (footprints, placed[:, 2], x - placed[:, 0] + OFFSET_LIMIT, y - placed[:, 1] + OFFSET_LIMIT)
    codes = _tables().moves[place].astype(np.int64)
    move_x, move_y = (codes >> 4) - LARGEST_MOVE, (codes & 15) - LARGEST_MOVE
    apart = _tables().tied[place] | (placed[:, 0] + frame_x < 0) | (placed[:, 1] < 0)
    move = placement_tables().move
    for index in apart.nonzero()[0].tolist():
        other = items[int(others[index])]
        move_x[index], move_y[index] = move(int(footprints[index]), int(x[index]), int(y[index]), other, frame_x)
    return move_x, move_y


@cache
def _places() -> Int64Array:
    return np.array(places())


def _samples(x: Int64Array, y: Int64Array, valid: BoolArray) -> Int64Array:
    """`item_samples.sample_number` for every addition, -1 where invalid."""
    shapes, colours, sizes = np.array(ITEM_TYPES).T
    by_pixel = _places()
    item_types = sizes * PLACE_COUNT**2
    footprints = _ADD_FOOTPRINTS
    place = by_pixel[sizes, x[:, footprints] + BEYOND] * PLACE_COUNT + by_pixel[sizes, y[:, footprints] + BEYOND]
    numbers = (item_types + place) * (len(Shape) * len(Colour)) + shapes * len(Colour) + colours
    return np.where(valid[:, footprints], numbers, -1).ravel()


@cache
def _areas(width: int, height: int) -> Int64Array:
    return np.array(cell_areas(width, height))


@lru_cache(maxsize=KEPT_BOXES)
def removed(cell: tuple[int, int], items: tuple[Item, ...]) -> Int64Array:
    """(cells,) position of the item that a removal there takes away, -1 where there is none.

    It is the one that covers most of the cell, the first of equals.
    """
    width, height = cell
    columns, rows = BOX_SIDE // width, BOX_SIDE // height
    if not items:
        return np.full(columns * rows, -1)
    table = _areas(width, height)
    placed = np.array([(item[0], item[1], item[2] * 3 + item[4]) for item in items])
    dx = np.arange(columns) * width - placed[:, 0, None] + width - 1
    dy = np.arange(rows) * height - placed[:, 1, None] + height - 1
    inside_x, inside_y = (dx >= 0) & (dx < table.shape[1]), (dy >= 0) & (dy < table.shape[2])
    columns_of, rows_of = dx.clip(0, table.shape[1] - 1), dy.clip(0, table.shape[2] - 1)
    areas = table[placed[:, 2, None, None], columns_of[:, :, None], rows_of[:, None, :]]
    areas *= inside_x[:, :, None] & inside_y[:, None, :]
    areas = areas.reshape(len(items), -1)
    return np.where(areas.max(axis=0) > 0, areas.argmax(axis=0), -1)
