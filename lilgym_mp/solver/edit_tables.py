"""All edits of a Scatter box at once, as arrays: where each addition comes to rest and which item each removal takes.

Uses the same lookup tables as `appearances`, indexed for all cells and footprints together.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lilgym_mp.appearances import PlacementRules, Scatter
from lilgym_mp.appearances.legality import box_legality
from lilgym_mp.appearances.numbering import ITEM_TYPE_FOOTPRINTS, ITEM_TYPES, add_index, remove_index
from lilgym_mp.appearances.placement import (
    FIRST_TOO_FAR,
    LARGEST_MOVE,
    OFFSET_COUNT,
    OFFSET_LIMIT,
    OVERLAPPING,
    TIED,
    cell_areas,
    code_arrays,
    placement_tables,
)
from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.scene import BOX_PITCH, BOX_SIDE, FOOTPRINT_COUNT, FOOTPRINT_SIDES, Item
from lilgym_mp.solver.canonical_items import COLOUR_COUNT, OVERHANG, TYPES_PER_SIZE, ZONE_COUNT, ZONE_PAIR_COUNT, zones

CACHE_SIZE = 8_192  # boxes


class AdditionTable(NamedTuple):
    """The result of every addition to one box. Cells are in the order of action indices: by column, then row."""

    valid: BoolArray  # (cells, 9) by footprint
    x: Int64Array  # (cells, 9) where the item comes to rest; undefined where invalid
    y: Int64Array  # (cells, 9)
    canonical: Int64Array  # (cells * 27,) the item's `canonical_index`, -1 where invalid; in the order of ADD actions

    def item(self, addition: int) -> Item:
        """The item that a valid addition adds; `addition` is its index in `canonical`."""
        cell, item_type = divmod(addition, len(ITEM_TYPES))
        shape, colour, size = ITEM_TYPES[item_type]
        footprint = ITEM_TYPE_FOOTPRINTS[item_type]
        return Item(int(self.x[cell, footprint]), int(self.y[cell, footprint]), shape, colour, size)


@lru_cache(maxsize=CACHE_SIZE)
def addition_table(scatter: Scatter, rules: PlacementRules, frame_x: int, items: tuple[Item, ...]) -> AdditionTable:
    """The additions to a box with these items. `frame_x`: see `frame_x_of`."""
    width, height = scatter.cell
    found_x, found_y, valid = box_legality(width, height, searches=scatter.searches(rules)).first_places(items)
    if items and not scatter.is_native:
        x, y = _snapped(found_x, found_y, valid, items, rules, frame_x)
    else:
        x, y = found_x, found_y
    return AdditionTable(valid, x, y, _canonical_indices(x, y, valid))


@lru_cache(maxsize=CACHE_SIZE)
def addable_item_types(scatter: Scatter, rules: PlacementRules, items: tuple[Item, ...]) -> BoolArray:
    """(cells, 27) whether an item of each type can be added to each cell of a box with these items."""
    legality = box_legality(*scatter.cell, searches=scatter.searches(rules))
    return legality.addable(items)[..., _ADD_FOOTPRINTS].reshape(-1, len(ITEM_TYPES))


def addition_actions(scatter: Scatter, index: int, additions: ArrayLike) -> list[int]:
    """The action indices of additions to box `index`, from their indices in its `AdditionTable`."""
    return (np.asarray(additions) + add_index(scatter.box_cells[index].start, 0)).tolist()


def removal_actions(scatter: Scatter, index: int, items: tuple[Item, ...], position: int) -> list[int]:
    """The action indices that remove the item at that position from box `index` with these items."""
    cells = (removal_table(scatter.cell, items) == position).nonzero()[0]
    return (cells + remove_index(scatter.box_cells[index].start, scatter.cell_count)).tolist()


def frame_x_of(rules: PlacementRules, index: int) -> int:
    """The x of box `index` in the frame in which the rules round coordinates: the image's, or the box's own."""
    return index * BOX_PITCH if rules.rounds_in_image else 0


_FOOTPRINTS = np.arange(FOOTPRINT_COUNT)
_ADD_FOOTPRINTS = np.array(ITEM_TYPE_FOOTPRINTS)


def _clearances(x: Int64Array, y: Int64Array, items: tuple[Item, ...]) -> Int64Array:
    """(items, cells, footprints) the clearance codes between each item and one of each footprint at (x, y)."""
    placed = np.array([(item[0], item[1], item[2] * 3 + item[4]) for item in items])
    dx = x - placed[:, 0, None, None] + OFFSET_LIMIT
    dy = y - placed[:, 1, None, None] + OFFSET_LIMIT
    near = (dx >= 0) & (dx < OFFSET_COUNT) & (dy >= 0) & (dy < OFFSET_COUNT)
    last = OFFSET_COUNT - 1
    codes = code_arrays().clearance[_FOOTPRINTS, placed[:, 2, None, None], dx.clip(0, last), dy.clip(0, last)]
    return np.where(near, codes, FIRST_TOO_FAR)


def _snapped(
    x: Int64Array, y: Int64Array, valid: BoolArray, items: tuple[Item, ...], rules: PlacementRules, frame_x: int
) -> tuple[Int64Array, Int64Array]:
    """Where additions at (x, y) come to rest after snapping to their nearest neighbour."""
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
    """The snap move of each new item towards `items[others[i]]`."""
    placed = np.array([(item[0], item[1], item[2] * 3 + item[4]) for item in items])[others]
    entry = (footprints, placed[:, 2], x - placed[:, 0] + OFFSET_LIMIT, y - placed[:, 1] + OFFSET_LIMIT)
    codes = code_arrays().moves[entry].astype(np.int64)
    move_x, move_y = (codes >> 4) - LARGEST_MOVE, (codes & 15) - LARGEST_MOVE
    # Ties, and neighbours beyond the frame's left or top, depend on absolute coordinates.
    special = (codes == TIED) | (placed[:, 0] + frame_x < 0) | (placed[:, 1] < 0)
    move = placement_tables().move
    for index in special.nonzero()[0].tolist():
        other = items[int(others[index])]
        move_x[index], move_y[index] = move(int(footprints[index]), int(x[index]), int(y[index]), other, frame_x)
    return move_x, move_y


@cache
def _zones() -> Int64Array:
    return np.array(zones())


def _canonical_indices(x: Int64Array, y: Int64Array, valid: BoolArray) -> Int64Array:
    """`canonical_index` of every addition's item, -1 where invalid."""
    shapes, colours, sizes = np.array(ITEM_TYPES).T
    by_pixel = _zones()
    footprints = _ADD_FOOTPRINTS
    zone_pairs = (
        by_pixel[sizes, x[:, footprints] + OVERHANG] * ZONE_COUNT + by_pixel[sizes, y[:, footprints] + OVERHANG]
    )
    indices = (sizes * ZONE_PAIR_COUNT + zone_pairs) * TYPES_PER_SIZE + shapes * COLOUR_COUNT + colours
    return np.where(valid[:, footprints], indices, -1).ravel()


@cache
def _areas(width: int, height: int) -> Int64Array:
    return np.array(cell_areas(width, height))


@lru_cache(maxsize=CACHE_SIZE)
def removal_table(cell: tuple[int, int], items: tuple[Item, ...]) -> Int64Array:
    """(cells,) the position of the item that a removal from each cell takes, -1 if there is none.

    It is the item that covers the largest area of the cell, the first of equals.
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
