"""Lookup tables of Scatter's edits for compiled code, derived from the tables of the scalar rules."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.envs.buffers import NO_REASON, REASON_INDICES
from lilgym_mp.scene import BOX_PITCH, BOX_SIDE, Item
from lilgym_mp.scene.appearances import InvalidReason, PlacementRules, Scatter, placement
from lilgym_mp.scene.appearances.base import LAST_CORNER
from lilgym_mp.scene.arrays import Int64Array, UInt8Array

MOVE_BASE = 2 * placement.LARGEST_MOVE  # a snap move (x, y) is (x + LARGEST_MOVE) * MOVE_BASE + y + LARGEST_MOVE


class GridTables(NamedTuple):
    """Tables for one grid and one rule set."""

    clearance: UInt8Array  # `placement.CodeArrays`
    moves: UInt8Array
    areas: NDArray[np.uint16]  # by footprint and offset, as `cell_areas`: rank of the covered area, 0 for none
    last_corners: Int64Array  # (9,) `LAST_CORNER`
    cell_count: int  # cells of the grid
    cell_width: int
    cell_height: int
    first_cells: Int64Array  # (3,) index of the first cell of each box
    boxes: Int64Array  # (cells,) box of each cell; arbitrary on separators
    xs: Int64Array  # (cells,) top-left pixel in the box
    ys: Int64Array  # (cells,)
    add_reasons: Int64Array  # (9, cells) by footprint: why an ADD is invalid in any scene, or NO_REASON
    remove_reasons: Int64Array  # (cells,) likewise for a REMOVE
    searches: bool
    snaps: bool
    keeps_unfit_snaps: bool
    overlap: int  # index of InvalidReason.OVERLAP
    nothing_to_remove: int


def grid_tables(appearance: Scatter, rules: PlacementRules) -> GridTables:
    columns, rows = appearance.grid
    width, height = appearance.cell
    boxes, xs = (values.repeat(rows) for values in np.divmod(np.arange(columns) * width, BOX_PITCH))
    ys = np.tile(np.arange(rows) * height, columns)
    on_separator = xs >= BOX_SIDE
    last = np.array(LAST_CORNER)
    fits = np.maximum(xs, ys) <= last[:, None]
    separator, out_of_box = REASON_INDICES[InvalidReason.SEPARATOR], REASON_INDICES[InvalidReason.OUT_OF_BOX]
    clearance, moves = placement.code_arrays()
    return GridTables(
        clearance=clearance,
        moves=moves,
        areas=_area_ranks(width, height),
        last_corners=last,
        cell_count=appearance.cell_count,
        cell_width=width,
        cell_height=height,
        first_cells=np.array([cells.start for cells in appearance.box_cells]),
        boxes=boxes,
        xs=xs,
        ys=ys,
        add_reasons=np.where(on_separator, separator, np.where(fits, NO_REASON, out_of_box)),
        remove_reasons=np.where(on_separator, separator, NO_REASON),
        searches=appearance.searches(rules),
        snaps=not appearance.is_native,
        keeps_unfit_snaps=rules.keeps_unfit_snaps,
        overlap=REASON_INDICES[InvalidReason.OVERLAP],
        nothing_to_remove=REASON_INDICES[InvalidReason.NOTHING_TO_REMOVE],
    )


def _area_ranks(cell_width: int, cell_height: int) -> NDArray[np.uint16]:
    areas = np.array(placement.cell_areas(cell_width, cell_height))
    _, ranks = np.unique(areas, return_inverse=True)
    return ranks.reshape(areas.shape).astype(np.uint16)


def tied_move(footprint: int, x: int, y: int, other: Item, box: int, rules: PlacementRules) -> int:
    """The snap move, encoded as in `GridTables.moves`, if several pairs of points are nearest to each other."""
    frame_x = box * BOX_PITCH if rules.rounds_in_image else 0
    move_x, move_y = placement.placement_tables().move(footprint, x, y, other, frame_x)
    return (move_x + placement.LARGEST_MOVE) * MOVE_BASE + move_y + placement.LARGEST_MOVE
