"""Kernels of Scatter: edits and masks, by lookup tables that are derived from those of the scalar rules."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from lilgym_mp.envs.buffers import NO_REASON, REASON_INDICES
from lilgym_mp.envs.cores.kernels import (
    DrawingTables,
    Scenes,
    append_item,
    decode_item,
    delete_item,
    encode_item,
    inlined,
    kernel,
)
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, Item
from lilgym_mp.scene.appearances import InvalidReason, PlacementRules, Scatter
from lilgym_mp.scene.appearances.base import LAST_CORNER
from lilgym_mp.scene.appearances.scatter import actions, geometry
from lilgym_mp.scene.appearances.scatter.actions import ITEM_TYPE_COUNT, ITEM_TYPE_FOOTPRINTS, REMOVES
from lilgym_mp.scene.appearances.scatter.cell_places import ADDS, REMOVABLE, WORD_BITS, CellPlaces
from lilgym_mp.scene.appearances.scatter.geometry import FIRST_TOO_FAR, LARGEST_MOVE, OFFSET_LIMIT, OVERLAPPING, TIED
from lilgym_mp.scene.arrays import BoolArray, Int64Array, UInt8Array, UInt16Array

TIE = -2  # sentinel instead of a reason: ambiguous snap, resolved by `tied_move`
ITEM_TYPE_FOOTPRINT = np.array(ITEM_TYPE_FOOTPRINTS)
MOVE_BASE = 2 * LARGEST_MOVE  # a snap move (x, y) is (x + LARGEST_MOVE) * MOVE_BASE + y + LARGEST_MOVE
NO_MOVE = LARGEST_MOVE * MOVE_BASE + LARGEST_MOVE

cell_and_item_type = inlined(actions.cell_and_item_type)
add_index = inlined(actions.add_index)
remove_index = inlined(actions.remove_index)


class GridTables(NamedTuple):
    """Tables for one grid and one rule set."""

    clearance: UInt8Array  # `geometry.PlacementTables`
    moves: UInt8Array
    areas: UInt16Array  # by footprint and offset, as `cell_areas`: rank of the covered area, 0 for none
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
    """Tables of a grid's cells that the kernels read."""
    columns, rows = appearance.grid
    width, height = appearance.cell
    boxes, xs = (values.repeat(rows) for values in np.divmod(np.arange(columns) * width, BOX_PITCH))
    ys = np.tile(np.arange(rows) * height, columns)
    on_separator = xs >= BOX_SIDE
    last = np.array(LAST_CORNER)
    fits = np.maximum(xs, ys) <= last[:, None]
    separator = REASON_INDICES[InvalidReason.SEPARATOR]
    out_of_box = REASON_INDICES[InvalidReason.OUT_OF_BOX]
    tables = geometry.placement_tables()
    return GridTables(
        clearance=tables.clearance,
        moves=tables.moves,
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


def _area_ranks(cell_width: int, cell_height: int) -> UInt16Array:
    areas = geometry.cell_areas(cell_width, cell_height)
    _, ranks = np.unique(areas, return_inverse=True)
    return ranks.reshape(areas.shape).astype(np.uint16)


def tied_move(footprint: int, x: int, y: int, other: Item, box: int, rules: PlacementRules) -> int:
    """The snap move, encoded as in `GridTables.moves`, if several pairs of points are nearest to each other."""
    frame_x = box * BOX_PITCH if rules.rounds_in_image else 0
    move_x, move_y = geometry.placement_tables().move(footprint, x, y, other, frame_x)
    return (move_x + LARGEST_MOVE) * MOVE_BASE + move_y + LARGEST_MOVE


@kernel
def edit_scatter_scenes(
    tables: GridTables,
    places: CellPlaces,
    drawing: DrawingTables,
    scenes: Scenes,
    env_ids: Int64Array,
    actions: Int64Array,
    applies: BoolArray,
    reasons: Int64Array,
    ties: Int64Array,
    scratch: Any,
) -> int:
    """`Core._edit` for Scatter: takes actions (k,) in environments (k,) and writes `reasons` (k,) or TIE.

    For a TIE, `ties` (k, 3) holds x and y of the new item and the slot of the item it snaps to. `scratch`: as for
    `_write_free`. Returns the number of TIE.
    """
    tied = 0
    for k in range(len(env_ids)):
        reasons[k] = NO_REASON
        if actions[k] == 0:
            continue
        cell, item_type = cell_and_item_type(actions[k], tables.cell_count)
        row = env_ids[k] * BOX_COUNT + tables.boxes[cell]
        if item_type == REMOVES:
            reasons[k] = _remove(tables, drawing, scenes, row, cell, applies[k])
        else:
            reason, x, y, slot = _add(tables, places, drawing, scenes, row, cell, item_type, applies[k], scratch)
            reasons[k] = reason
            ties[k, 0] = x
            ties[k, 1] = y
            ties[k, 2] = slot
        tied += reasons[k] == TIE
    return tied


@inlined
def _add(
    tables: GridTables,
    places: CellPlaces,
    drawing: DrawingTables,
    scenes: Scenes,
    row: int,
    cell: int,
    item_type: int,
    applies: bool,
    scratch: Any,
) -> tuple[int, int, int, int]:
    """Makes an ADD. Returns its reason, its position before snapping, and the slot of the closest item."""
    footprint = ITEM_TYPE_FOOTPRINT[item_type]
    x = tables.xs[cell]
    y = tables.ys[cell]
    reason = tables.add_reasons[footprint, cell]
    if reason != NO_REASON:
        return reason, x, y, 0
    clearance, slot = _closest(tables, scenes, row, footprint, x, y)
    if clearance == OVERLAPPING:
        dx = -1
        dy = -1
        if tables.searches:
            in_box = cell - tables.first_cells[row % BOX_COUNT]
            dx, dy = _search(tables, places, scenes, row, footprint, in_box, scratch)
        if dx < 0:
            return tables.overlap, x, y, 0
        x += dx
        y += dy
        clearance, slot = _closest(tables, scenes, row, footprint, x, y)
    if clearance >= FIRST_TOO_FAR or not tables.snaps:
        place_item(tables, drawing, scenes, row, item_type, x, y, NO_MOVE, applies)
        return NO_REASON, x, y, slot
    other_x, other_y, other_type = decode_item(scenes.items[row, slot])
    other_footprint = ITEM_TYPE_FOOTPRINT[other_type]
    move = tables.moves[footprint, other_footprint, x - other_x + OFFSET_LIMIT, y - other_y + OFFSET_LIMIT]
    if move == TIED or other_x < 0 or other_y < 0:
        return TIE, x, y, slot
    place_item(tables, drawing, scenes, row, item_type, x, y, int(move), applies)
    return NO_REASON, x, y, slot


@inlined
def _closest(tables: GridTables, scenes: Scenes, row: int, footprint: int, x: int, y: int) -> tuple[int, int]:
    """`PlacementTables.closest` for a new item: the smallest clearance code and the first slot that has it."""
    smallest = FIRST_TOO_FAR
    closest = 0
    for slot in range(scenes.counts[row]):
        other_x, other_y, item_type = decode_item(scenes.items[row, slot])
        dx = x - other_x + OFFSET_LIMIT
        dy = y - other_y + OFFSET_LIMIT
        if 0 <= dx <= 2 * OFFSET_LIMIT and 0 <= dy <= 2 * OFFSET_LIMIT:
            code = int(tables.clearance[footprint, ITEM_TYPE_FOOTPRINT[item_type], dx, dy])
            if code < smallest:
                smallest = code
                closest = slot
    return smallest, closest


@inlined
def _search(
    tables: GridTables, places: CellPlaces, scenes: Scenes, row: int, footprint: int, cell: int, scratch: Any
) -> tuple[int, int]:
    """`cell_places.searched` in a cell: x and y in the cell of the first free position, or -1. `scratch`: as for
    `_write_free`."""
    found_x = -1
    found_y = -1
    for part in range(places.empty.shape[1]):
        _write_free(tables, places, scenes, row, cell, part, scratch)
        for place in range(places.first_places[footprint], places.first_places[footprint + 1]):
            if (scratch[place // WORD_BITS] >> np.uint64(place % WORD_BITS)) & np.uint64(1):
                x = places.corners[place, 0]
                y = places.corners[place, 1]
                if found_x < 0 or x < found_x:
                    found_x = x
                    found_y = y + part * places.part_height
                break
    return found_x, found_y


@kernel
def place_item(
    tables: GridTables,
    drawing: DrawingTables,
    scenes: Scenes,
    row: int,
    item_type: int,
    x: int,
    y: int,
    move: int,
    applies: bool,
) -> None:
    """Applies a snap move if the rules allow it; adds the item if `applies`."""
    if move != NO_MOVE:
        new_x = x + move // MOVE_BASE - LARGEST_MOVE
        new_y = y + move % MOVE_BASE - LARGEST_MOVE
        footprint = ITEM_TYPE_FOOTPRINT[item_type]
        inside = min(new_x, new_y) >= 0 and max(new_x, new_y) <= tables.last_corners[footprint]
        fits = inside and _closest(tables, scenes, row, footprint, new_x, new_y)[0] != OVERLAPPING
        if fits or tables.keeps_unfit_snaps:
            x = new_x
            y = new_y
            scenes.is_unfit[row // BOX_COUNT] |= applies and not fits
    if applies:
        append_item(drawing, scenes, row, encode_item(x, y, item_type))


@inlined
def _remove(tables: GridTables, drawing: DrawingTables, scenes: Scenes, row: int, cell: int, applies: bool) -> int:
    """Removes the item that covers most of the cell, the first in case of ties. Returns the reason."""
    if tables.remove_reasons[cell] != NO_REASON:
        return tables.remove_reasons[cell]
    largest = 0
    removed = 0
    for slot in range(scenes.counts[row]):
        x, y, item_type = decode_item(scenes.items[row, slot])
        dx = tables.xs[cell] - x + tables.cell_width - 1
        dy = tables.ys[cell] - y + tables.cell_height - 1
        if 0 <= dx < tables.areas.shape[1] and 0 <= dy < tables.areas.shape[2]:
            area = int(tables.areas[ITEM_TYPE_FOOTPRINT[item_type], dx, dy])
            if area > largest:
                largest = area
                removed = slot
    if largest == 0:
        return tables.nothing_to_remove
    if applies:
        delete_item(drawing, scenes, row, removed)
    return NO_REASON


@kernel
def write_masks(
    tables: GridTables, places: CellPlaces, scenes: Scenes, seen: Int64Array, scratch: Any, masks: BoolArray
) -> None:
    """Writes `Scatter.legal_mask` into `masks` (N, actions) for boxes whose version differs from `seen` (3 N,).

    After one added item only the cells near it are updated, after any other change all cells of the box. `scratch`: as
    for `_write_free`.
    """
    for row in range(len(seen)):
        if seen[row] == scenes.versions[row]:
            continue
        grown = seen[row] + 1 == scenes.versions[row]
        seen[row] = scenes.versions[row]
        newest = scenes.items[row, max(0, scenes.counts[row] - 1)]
        for cell in range(places.empty.shape[0]):
            if grown and not _reaches(tables, places, newest, cell):
                continue
            legal = _legal_edits(tables, places, scenes, row, cell, scratch)
            in_grid = tables.first_cells[row % BOX_COUNT] + cell
            first = np.uint64(add_index(in_grid, 0))
            for item_type in range(np.uint64(ITEM_TYPE_COUNT)):
                masks[row // BOX_COUNT, first + item_type] = ADDS[legal, item_type]
            masks[row // BOX_COUNT, remove_index(in_grid, tables.cell_count)] = (legal & REMOVABLE) != 0


@inlined
def _kept_index(tables: GridTables, places: CellPlaces, item: int, cell: int, part: int) -> int:
    """The line of `CellPlaces.kept` for the bits that an item keeps in a part of a cell; 0 if it is far from it."""
    x, y, item_type = decode_item(item)
    dx = tables.xs[cell] - x + places.offset[0]
    dy = tables.ys[cell] + part * places.part_height - y + places.offset[1]
    if 0 <= dx < places.kept_index.shape[1] and 0 <= dy < places.kept_index.shape[2]:
        return int(places.kept_index[ITEM_TYPE_FOOTPRINT[item_type], dx, dy])
    return 0


@inlined
def _reaches(tables: GridTables, places: CellPlaces, item: int, cell: int) -> bool:
    """Whether an item can affect the legal edits of a cell."""
    reaches = False
    for part in range(places.empty.shape[1]):
        reaches |= _kept_index(tables, places, item, cell, part) != 0
    return reaches


@inlined
def _legal_edits(tables: GridTables, places: CellPlaces, scenes: Scenes, row: int, cell: int, scratch: Any) -> int:
    """Bitmask of the footprints that can be added to a cell, and REMOVABLE. `scratch`: as for `_write_free`."""
    legal = 0
    for part in range(places.empty.shape[1]):
        _write_free(tables, places, scenes, row, cell, part, scratch)
        for group in range(len(places.words)):
            edit = int(places.edits[group, 0, 0])
            bits = scratch[places.words[group]] & places.groups[group, 0, 0]
            if (bits != 0) == (edit != REMOVABLE):
                legal |= edit
    return legal


@inlined
def _write_free(
    tables: GridTables, places: CellPlaces, scenes: Scenes, row: int, cell: int, part: int, free: Any
) -> None:
    """Writes the bits of `CellPlaces` that items leave set in a part of a cell into `free` (words,) uint64."""
    width = np.uint64(places.empty.shape[2])
    for word in range(width):
        free[word] = places.empty[cell, part, word]
    for slot in range(scenes.counts[row]):
        line = _kept_index(tables, places, scenes.items[row, slot], cell, part)
        if line != 0:
            for word in range(width):
                free[word] &= places.kept[line, word]
