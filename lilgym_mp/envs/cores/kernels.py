"""Kernels compiled by numba: loops over the environments of a batch.

All rules come from tables derived from those of the scalar rules. Arrays have one row per box, 3 * env_id + box index,
with its items in the order they were added, encoded by `encode_item`. Inner loops count with `np.uint64`: with signed
indices the compiler adds code for negative ones and does not vectorise.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any, NamedTuple

import numpy as np
from numba import njit  # pyright: ignore[reportMissingImports, reportUnknownVariableType]
from numba.core.options import DefaultOptions  # pyright: ignore[reportMissingImports, reportUnknownVariableType]

from lilgym_mp.corpus.notes import note_after
from lilgym_mp.envs.buffers import NO_REASON
from lilgym_mp.envs.cores.tables import MOVE_BASE, GridTables
from lilgym_mp.envs.fast.box_functions import MAX_BOX_ITEMS
from lilgym_mp.envs.fast.instructions import Operation
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, Size
from lilgym_mp.scene.appearances import numbering
from lilgym_mp.scene.appearances.cell_places import ADDS, REMOVABLE, WORD_BITS, CellPlaces
from lilgym_mp.scene.appearances.numbering import ITEM_TYPE_COUNT, ITEM_TYPE_FOOTPRINTS, REMOVES
from lilgym_mp.scene.appearances.placement import (
    FIRST_TOO_FAR,
    LARGEST_MOVE,
    OFFSET_LIMIT,
    OVERLAPPING,
    TIED,
)
from lilgym_mp.scene.arrays import BoolArray, Int16Array, Int64Array, UInt8Array

NO_ITEM = -1
FALLBACK = -2  # sentinel instead of a reason: the scalar rules must make this edit (see `ScatterCore`)
TIE = -3  # sentinel instead of a reason: ambiguous snap, resolved by `tied_move`
ITEM_TYPE_FOOTPRINT = np.array(ITEM_TYPE_FOOTPRINTS)
NO_MOVE = LARGEST_MOVE * MOVE_BASE + LARGEST_MOVE
BITS = 62  # bits of an int64 used for a mask
UNKNOWN = -(2**40)  # sentinel instead of a truth value: the program itself must be called
SIZE_COUNT = len(Size)
LONG_WAIT = 2.0  # seconds of compiling before a line is printed

# Kernels allocate nothing, so they do not need numba's runtime. Without it they do not count references to arrays,
# which took most of their time. A version of numba without the option works, slower.
_OPTIONS: dict[str, Any] = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


def _kernel(function: Callable[..., Any]) -> Any:
    """Decorator for functions called from Python: compiled on first use and cached on disk if numba can write there."""
    try:
        return njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # no writable cache directory
        return njit(**_OPTIONS)(function)


# Decorator for functions called by kernels. Inlined, because a call passes the hundreds of values that describe arrays.
_inlined: Any = njit(forceinline=True, **_OPTIONS)


def compiling(kernel: Any) -> AbstractContextManager[None]:
    """Context for the first call of a kernel: prints a line on stderr if compiling takes long."""
    note = f"compiling {kernel.__name__} for batches of environments, once after installation"
    return nullcontext() if kernel.signatures else note_after(note, LONG_WAIT)


cell_and_item_type = _inlined(numbering.cell_and_item_type)
add_index = _inlined(numbering.add_index)
remove_index = _inlined(numbering.remove_index)


@_inlined
def encode_item(x: int, y: int, item_type: int) -> int:
    """An item as one int: x, y and item type in a byte each."""
    return (x << 16) | (y << 8) | item_type


@_inlined
def decode_item(item: int) -> tuple[int, int, int]:
    """x, y and item type of an item."""
    return item >> 16, (item >> 8) & 255, item & 255


class DrawingTables(NamedTuple):
    """Lookup tables for drawing items at one image size, by item type and parity of x and y.

    `runs` are pixels that an item covers completely, which no other item can touch. `edges` are pixels that it covers
    in part and may share with others; they are drawn from weighted counts, as in `render.Palette`.
    """

    runs: Int64Array  # (27, 2, 2, rows, 2) first column of the run in each row, and the column after the last
    run_counts: Int64Array  # (27, 2, 2) number of rows
    edges: Int64Array  # (27, 2, 2, edges, 3) row, column and weighted count
    edge_counts: Int64Array  # (27, 2, 2) number of edges
    lines: UInt8Array  # (28, 3 * columns) colours of a run, by item type; last: of an empty box
    colours: UInt8Array  # (counts, 3) `render.Palette.colours`
    background: UInt8Array  # (height * width * 3,) the image of empty boxes
    width: int  # width of the image
    shrink: int


class Scenes(NamedTuple):
    """The current scenes of N environments, and their images."""

    items: Int64Array  # (3 N, capacity) each row: items, then NO_ITEM
    counts: Int64Array  # (3 N,) number of items
    versions: Int64Array  # (3 N,) increases with every change of the box: by 1 if an item is added, else by 2 or more
    weighted: UInt8Array  # (3 N, side, side) weighted counts of coloured pixels, as in `render.Palette`
    images: UInt8Array  # (N, height * width * 3)
    uses_fallback: BoolArray  # (N,) environments whose scenes these arrays cannot represent


class StartScenes(NamedTuple):
    """Start scenes, with one row per box: 3 * task index + box index."""

    items: Int64Array  # (3 tasks, capacity)
    counts: Int64Array  # (3 tasks,)


@_kernel
def start_episodes(
    drawing: DrawingTables, scenes: Scenes, starts: StartScenes, env_ids: Int64Array, tasks: Int64Array
) -> None:
    """Sets the scenes of environments (k,) to the start scenes of tasks (k,) and draws them."""
    for k in range(len(env_ids)):
        env_id = env_ids[k]
        for index in range(drawing.background.shape[0]):
            scenes.images[env_id, index] = drawing.background[index]
        for box in range(BOX_COUNT):
            row, start = env_id * BOX_COUNT + box, tasks[k] * BOX_COUNT + box
            for slot in range(scenes.counts[row]):
                scenes.items[row, slot] = NO_ITEM
            scenes.counts[row] = 0
            scenes.versions[row] += 1
            for y in range(scenes.weighted.shape[1]):
                for x in range(scenes.weighted.shape[2]):
                    scenes.weighted[row, y, x] = 0
            for slot in range(starts.counts[start]):
                append_item(drawing, scenes, row, starts.items[start, slot])
            scenes.versions[row] += 1


@_inlined
def draw_item(drawing: DrawingTables, scenes: Scenes, row: int, item: int, sign: int) -> None:
    """Draws an item (sign 1) or erases it (sign -1). Items must not share native pixels."""
    x, y, item_type = decode_item(item)
    odd_x, odd_y, shrink = x & 1, y & 1, drawing.shrink
    left, top, env_id = (x - odd_x) // shrink, (y - odd_y) // shrink, row // BOX_COUNT
    first = 3 * (top * drawing.width + row % BOX_COUNT * (BOX_PITCH // shrink) + left)
    line = item_type if sign > 0 else ITEM_TYPE_COUNT
    for i in range(drawing.run_counts[item_type, odd_x, odd_y]):
        start, stop = drawing.runs[item_type, odd_x, odd_y, i, 0], drawing.runs[item_type, odd_x, odd_y, i, 1]
        byte = np.uint64(first + 3 * (i * drawing.width + start))
        for k in range(np.uint64(3 * (stop - start))):
            scenes.images[env_id, byte + k] = drawing.lines[line, k]
    for edge in range(drawing.edge_counts[item_type, odd_x, odd_y]):
        i, j = drawing.edges[item_type, odd_x, odd_y, edge, 0], drawing.edges[item_type, odd_x, odd_y, edge, 1]
        count = scenes.weighted[row, top + i, left + j] + sign * drawing.edges[item_type, odd_x, odd_y, edge, 2]
        scenes.weighted[row, top + i, left + j] = count
        byte = np.uint64(first + 3 * (i * drawing.width + j))
        for k in range(np.uint64(3)):
            scenes.images[env_id, byte + k] = drawing.colours[count, k]


@_inlined
def append_item(drawing: DrawingTables, scenes: Scenes, row: int, item: int) -> None:
    """Appends an item to a box."""
    slot = scenes.counts[row]
    scenes.items[row, slot] = item
    scenes.counts[row] = slot + 1
    scenes.versions[row] += 1
    draw_item(drawing, scenes, row, item, 1)


@_inlined
def delete_item(drawing: DrawingTables, scenes: Scenes, row: int, slot: int) -> None:
    """Deletes an item of a box."""
    item, last = scenes.items[row, slot], scenes.counts[row] - 1
    for later in range(slot, last):
        scenes.items[row, later] = scenes.items[row, later + 1]
    scenes.items[row, last] = NO_ITEM
    scenes.counts[row] = last
    scenes.versions[row] += 2
    draw_item(drawing, scenes, row, item, -1)


@_kernel
def write_items(scenes: Scenes, item_types: Int16Array, empty: int, seen: Int64Array, out: Int16Array) -> None:
    """Writes `observation.item_array` into `out` (3 N, capacity, 5) for boxes whose version differs from `seen` (3 N,).

    item_types: (27, 3) shape, colour and size by item type.
    """
    for row in range(len(seen)):
        if seen[row] != scenes.versions[row]:
            seen[row] = scenes.versions[row]
            for slot in range(out.shape[1]):
                item = scenes.items[row, slot]
                x, y, item_type = decode_item(item)
                out[row, slot, 0] = empty if item == NO_ITEM else x
                out[row, slot, 1] = empty if item == NO_ITEM else y
                for field in range(item_types.shape[1]):
                    out[row, slot, 2 + field] = empty if item == NO_ITEM else item_types[item_type, field]


class TowerEdits(NamedTuple):
    """`appearances.tower.TowerTables` for `edit_tower_scenes`."""

    boxes: Int64Array  # (13,) by action: box
    edits: Int64Array  # (13,) by action: column of `after`
    after: Int64Array  # (121, 4) by stack and edit: the next stack, or -1 if invalid
    tops: Int64Array  # (121,) by stack: the top item
    heights: Int64Array  # (121,)
    reasons: Int64Array  # (4,) by edit: the reason if it is invalid


@_kernel
def edit_tower_scenes(
    tables: TowerEdits,
    drawing: DrawingTables,
    scenes: Scenes,
    stacks: Int64Array,
    env_ids: Int64Array,
    actions: Int64Array,
    applies: BoolArray,
    reasons: Int64Array,
) -> None:
    """`Core._edit` for Tower: takes actions (k,) in environments (k,) and writes `reasons` (k,). `stacks`: (3 N,)."""
    for k in range(len(env_ids)):
        reasons[k] = NO_REASON
        if actions[k] == 0:
            continue
        row, edit = env_ids[k] * BOX_COUNT + tables.boxes[actions[k]], tables.edits[actions[k]]
        before, after = stacks[row], tables.after[stacks[row], edit]
        if after < 0:
            reasons[k] = tables.reasons[edit]
        elif applies[k]:
            stacks[row] = after
            if tables.heights[after] > tables.heights[before]:
                append_item(drawing, scenes, row, tables.tops[after])
            else:
                delete_item(drawing, scenes, row, scenes.counts[row] - 1)


@_kernel
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
    """`Core._edit` for Scatter: takes actions (k,) in environments (k,) and writes `reasons` (k,), FALLBACK or TIE.

    FALLBACK marks edits of scenes that the arrays cannot represent. For a TIE, `ties` (k, 3) holds x and y of the new
    item and the slot of the item it snaps to. `scratch`: as for `_write_free`. Returns the number of FALLBACK and TIE.
    """
    unresolved = 0
    for k in range(len(env_ids)):
        reasons[k] = NO_REASON
        if actions[k] == 0:
            continue
        if scenes.uses_fallback[env_ids[k]]:
            reasons[k] = FALLBACK
        else:
            cell, item_type = cell_and_item_type(actions[k], tables.cell_count)
            row = env_ids[k] * BOX_COUNT + tables.boxes[cell]
            if item_type == REMOVES:
                reasons[k] = _remove(tables, drawing, scenes, row, cell, applies[k])
            else:
                reason, x, y, slot = _add(tables, places, drawing, scenes, row, cell, item_type, applies[k], scratch)
                reasons[k], ties[k, 0], ties[k, 1], ties[k, 2] = reason, x, y, slot
        unresolved += reasons[k] == FALLBACK or reasons[k] == TIE
    return unresolved


@_inlined
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
    footprint, x, y = ITEM_TYPE_FOOTPRINT[item_type], tables.xs[cell], tables.ys[cell]
    reason = tables.add_reasons[footprint, cell]
    if reason != NO_REASON:
        return reason, x, y, 0
    clearance, slot = _closest(tables, scenes, row, footprint, x, y)
    if clearance == OVERLAPPING:
        dx, dy = -1, -1
        if tables.searches:
            in_box = cell - tables.first_cells[row % BOX_COUNT]
            dx, dy = _search(tables, places, scenes, row, footprint, in_box, scratch)
        if dx < 0:
            return tables.overlap, x, y, 0
        x, y = x + dx, y + dy
        clearance, slot = _closest(tables, scenes, row, footprint, x, y)
    if clearance >= FIRST_TOO_FAR or not tables.snaps:
        return place_item(tables, drawing, scenes, row, item_type, x, y, NO_MOVE, applies), x, y, slot
    other_x, other_y, other_type = decode_item(scenes.items[row, slot])
    other_footprint = ITEM_TYPE_FOOTPRINT[other_type]
    move = tables.moves[footprint, other_footprint, x - other_x + OFFSET_LIMIT, y - other_y + OFFSET_LIMIT]
    if move == TIED:
        return TIE, x, y, slot
    return place_item(tables, drawing, scenes, row, item_type, x, y, int(move), applies), x, y, slot


@_inlined
def _closest(tables: GridTables, scenes: Scenes, row: int, footprint: int, x: int, y: int) -> tuple[int, int]:
    """`PlacementTables.closest` for a new item: the smallest clearance code and the first slot that has it."""
    smallest, closest = FIRST_TOO_FAR, 0
    for slot in range(scenes.counts[row]):
        other_x, other_y, item_type = decode_item(scenes.items[row, slot])
        dx, dy = x - other_x + OFFSET_LIMIT, y - other_y + OFFSET_LIMIT
        if 0 <= dx <= 2 * OFFSET_LIMIT and 0 <= dy <= 2 * OFFSET_LIMIT:
            code = int(tables.clearance[footprint, ITEM_TYPE_FOOTPRINT[item_type], dx, dy])
            if code < smallest:
                smallest, closest = code, slot
    return smallest, closest


@_inlined
def _search(
    tables: GridTables, places: CellPlaces, scenes: Scenes, row: int, footprint: int, cell: int, scratch: Any
) -> tuple[int, int]:
    """`cell_places.searched` in a cell: x and y in the cell of the first free position, or -1. `scratch`: as for
    `_write_free`."""
    found_x, found_y = -1, -1
    for part in range(places.empty.shape[1]):
        _write_free(tables, places, scenes, row, cell, part, scratch)
        for place in range(places.first_places[footprint], places.first_places[footprint + 1]):
            if (scratch[place // WORD_BITS] >> np.uint64(place % WORD_BITS)) & np.uint64(1):
                x, y = places.corners[place, 0], places.corners[place, 1]
                if found_x < 0 or x < found_x:
                    found_x, found_y = x, y + part * places.part_height
                break
    return found_x, found_y


@_kernel
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
) -> int:
    """Applies a snap move if the rules allow it; adds the item if `applies`. Returns NO_REASON or FALLBACK."""
    if move != NO_MOVE:
        new_x, new_y = x + move // MOVE_BASE - LARGEST_MOVE, y + move % MOVE_BASE - LARGEST_MOVE
        footprint = ITEM_TYPE_FOOTPRINT[item_type]
        inside = min(new_x, new_y) >= 0 and max(new_x, new_y) <= tables.last_corners[footprint]
        if inside and _closest(tables, scenes, row, footprint, new_x, new_y)[0] != OVERLAPPING:
            x, y = new_x, new_y
        elif tables.keeps_unfit_snaps:
            return FALLBACK
    if applies:
        append_item(drawing, scenes, row, encode_item(x, y, item_type))
    return NO_REASON


@_inlined
def _remove(tables: GridTables, drawing: DrawingTables, scenes: Scenes, row: int, cell: int, applies: bool) -> int:
    """Removes the item that covers most of the cell, the first in case of ties. Returns the reason."""
    if tables.remove_reasons[cell] != NO_REASON:
        return tables.remove_reasons[cell]
    largest, removed = 0, 0
    for slot in range(scenes.counts[row]):
        x, y, item_type = decode_item(scenes.items[row, slot])
        dx, dy = tables.xs[cell] - x + tables.cell_width - 1, tables.ys[cell] - y + tables.cell_height - 1
        if 0 <= dx < tables.areas.shape[1] and 0 <= dy < tables.areas.shape[2]:
            area = int(tables.areas[ITEM_TYPE_FOOTPRINT[item_type], dx, dy])
            if area > largest:
                largest, removed = area, slot
    if largest == 0:
        return tables.nothing_to_remove
    if applies:
        delete_item(drawing, scenes, row, removed)
    return NO_REASON


@_kernel
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


@_inlined
def _kept_index(tables: GridTables, places: CellPlaces, item: int, cell: int, part: int) -> int:
    """The line of `CellPlaces.kept` for the bits that an item keeps in a part of a cell; 0 if it is far from it."""
    x, y, item_type = decode_item(item)
    dx = tables.xs[cell] - x + places.offset[0]
    dy = tables.ys[cell] + part * places.part_height - y + places.offset[1]
    if 0 <= dx < places.kept_index.shape[1] and 0 <= dy < places.kept_index.shape[2]:
        return int(places.kept_index[ITEM_TYPE_FOOTPRINT[item_type], dx, dy])
    return 0


@_inlined
def _reaches(tables: GridTables, places: CellPlaces, item: int, cell: int) -> bool:
    """Whether an item can affect the legal edits of a cell."""
    reaches = False
    for part in range(places.empty.shape[1]):
        reaches |= _kept_index(tables, places, item, cell, part) != 0
    return reaches


@_inlined
def _legal_edits(tables: GridTables, places: CellPlaces, scenes: Scenes, row: int, cell: int, scratch: Any) -> int:
    """Bitmask of the footprints that can be added to a cell, and REMOVABLE. `scratch`: as for `_write_free`."""
    legal = 0
    for part in range(places.empty.shape[1]):
        _write_free(tables, places, scenes, row, cell, part, scratch)
        for group in range(len(places.words)):
            edit, bits = int(places.edits[group, 0, 0]), scratch[places.words[group]] & places.groups[group, 0, 0]
            if (bits != 0) == (edit != REMOVABLE):
                legal |= edit
    return legal


@_inlined
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


class Programs(NamedTuple):
    """Programs compiled to `programs.instructions`, and the tables that the instructions read."""

    rows: Int64Array  # (instructions, 3) operation, a, b; of all programs
    ends: Int64Array  # (programs + 1,) bounds of each program's instructions
    places: Int64Array  # (3, 100, 100) by size, x and y of an item: bitmask of the tests that it passes
    tables: Int64Array  # (tables, 121) value by stack, or UNKNOWN


@_kernel
def evaluate_programs(
    programs: Programs,
    scenes: Scenes,
    stacks: Int64Array,
    env_ids: Int64Array,
    chosen: Int64Array,
    values: Int64Array,
    truths: Int64Array,
) -> int:
    """Evaluates programs `chosen` (k,), by index, in environments (k,); writes 0, 1 or UNKNOWN into `truths` (k,).

    UNKNOWN also for a negative index and for scenes that the arrays cannot represent. Returns the number of UNKNOWN.
    `stacks`: (3 N,) stack indices of Tower; `values` (MAX_INSTRUCTIONS,): scratch buffer.
    """
    unknown = 0
    for k in range(len(env_ids)):
        first_row = env_ids[k] * BOX_COUNT
        truths[k] = UNKNOWN
        unknown += 1
        if chosen[k] < 0 or scenes.uses_fallback[env_ids[k]]:
            continue
        most = 0
        for box in range(BOX_COUNT):
            most = max(most, scenes.counts[first_row + box])
        if most > MAX_BOX_ITEMS:
            continue
        first, last = programs.ends[chosen[k]], programs.ends[chosen[k] + 1]
        is_known = True
        for index in range(last - first):
            row = first + index
            operation, a, b = programs.rows[row, 0], programs.rows[row, 1], programs.rows[row, 2]
            if operation == Operation.CONSTANT:
                value = a
            elif operation == Operation.LENGTH:
                value = scenes.counts[first_row + b]
            elif operation == Operation.ITEM_TYPE_TEST:
                value = 0
                for slot in range(scenes.counts[first_row + b]):
                    value |= ((a >> (scenes.items[first_row + b, slot] & 255)) & 1) << slot
            elif operation == Operation.POSITION_TEST:
                value = 0
                for slot in range(scenes.counts[first_row + b]):
                    x, y, item_type = decode_item(scenes.items[first_row + b, slot])
                    value |= ((programs.places[item_type % SIZE_COUNT, x, y] >> a) & 1) << slot
            elif operation == Operation.BOX_TABLE:
                value = programs.tables[a, stacks[first_row + b]]
                is_known &= value != UNKNOWN
            elif operation == Operation.ONLY_BIT:
                value = 0
                is_known &= values[a] != 0 and values[a] & (values[a] - 1) == 0
                while value < BITS and not (values[a] >> value) & 1:
                    value += 1
            elif operation == Operation.BIT_COUNT:
                value, left = 0, values[a]
                while left > 0:
                    left &= left - 1
                    value += 1
            elif operation == Operation.BIT_AND:
                value = values[a] & values[b]
            elif operation == Operation.BIT_OR:
                value = values[a] | values[b]
            elif operation == Operation.SHIFT_LEFT:
                value = values[a] << values[b]
            elif operation == Operation.SHIFT_RIGHT:
                value = values[a] >> values[b]
            elif operation == Operation.ADD:
                value = values[a] + values[b]
            elif operation == Operation.SUBTRACT:
                value = values[a] - values[b]
            elif operation == Operation.REMAINDER:
                value = values[a] % values[b]
            elif operation == Operation.EQUAL:
                value = int(values[a] == values[b])
            elif operation == Operation.UNEQUAL:
                value = int(values[a] != values[b])
            elif operation == Operation.LESS:
                value = int(values[a] < values[b])
            else:
                value = int(values[a] <= values[b])
            values[index] = value
        if is_known:
            truths[k] = int(values[last - first - 1] != 0)
            unknown -= 1
    return unknown
