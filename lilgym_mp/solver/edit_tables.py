"""All edits of a Scatter box as arrays: where each addition comes to rest and which item each removal takes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lilgym_mp.scene import BOX_SIDE, FOOTPRINT_COUNT, Item
from lilgym_mp.scene.appearances import PlacementRules, Scatter
from lilgym_mp.scene.appearances.scatter.actions import ITEM_TYPE_FOOTPRINTS, ITEM_TYPES, add_index, remove_index
from lilgym_mp.scene.arrays import Int64Array
from lilgym_mp.solver.canonical_items import COLOUR_COUNT, OVERHANG, TYPES_PER_SIZE, ZONE_COUNT, ZONE_PAIR_COUNT, zones

CACHE_SIZE = 8_192  # boxes
NOWHERE = (0, 0, 0)


class AdditionTable(NamedTuple):
    """The result of every addition to one box. Cells are in the order of action indices: by column, then row."""

    places: Int64Array  # (cells, 9, 2) by footprint: x and y where the item comes to rest; undefined where invalid
    canonical: Int64Array  # (cells * 27,) the item's `canonical_index`, -1 where invalid; in the order of ADD actions


def _corners(scatter: Scatter) -> Iterator[tuple[int, int]]:
    """The top-left pixels of the cells of a box."""
    width, height = scatter.cell
    return itertools.product(range(0, BOX_SIDE, width), range(0, BOX_SIDE, height))


@lru_cache(maxsize=CACHE_SIZE)
def addition_table(scatter: Scatter, rules: PlacementRules, index: int, items: tuple[Item, ...]) -> AdditionTable:
    """The additions to box `index` with these items."""
    found = [
        scatter.place(footprint, *corner, index, items, rules)
        for corner in _corners(scatter)
        for footprint in range(FOOTPRINT_COUNT)
    ]
    rows = np.array([(*place, 1) if isinstance(place, tuple) else NOWHERE for place in found])
    by_cell = rows.reshape(-1, FOOTPRINT_COUNT, 3)
    x, y, valid = np.moveaxis(by_cell[:, ITEM_TYPE_FOOTPRINTS], 2, 0)
    shapes, colours, sizes = np.array(ITEM_TYPES).T
    zone_pairs = _zones()[sizes, x + OVERHANG] * ZONE_COUNT + _zones()[sizes, y + OVERHANG]
    canonical = (sizes * ZONE_PAIR_COUNT + zone_pairs) * TYPES_PER_SIZE + shapes * COLOUR_COUNT + colours
    return AdditionTable(by_cell[..., :2], np.where(valid, canonical, -1).ravel())


@lru_cache(maxsize=CACHE_SIZE)
def removal_table(scatter: Scatter, items: tuple[Item, ...]) -> Int64Array:
    """(cells,) the position of the item that a removal from each cell of a box takes, -1 if there is none."""
    return np.array([scatter.covering(items, *corner) for corner in _corners(scatter)])


def addition_actions(scatter: Scatter, index: int, additions: ArrayLike) -> list[int]:
    """The action indices of additions to box `index`, from their indices in its `AdditionTable`."""
    return (np.asarray(additions) + add_index(scatter.box_cells[index].start, 0)).tolist()


def removal_actions(scatter: Scatter, index: int, items: tuple[Item, ...], position: int) -> list[int]:
    """The action indices that remove the item at that position from box `index` with these items."""
    cells = (removal_table(scatter, items) == position).nonzero()[0]
    return (cells + remove_index(scatter.box_cells[index].start, scatter.cell_count)).tolist()


@cache
def _zones() -> Int64Array:
    return np.array(zones())
