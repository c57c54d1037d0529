"""What numba compiles: batches of scenes stepped one environment after another, without Python in between.

All rules come in tables that are made of the scalar ones. A box is a row, 3 * environment + box index; its items are
numbers in the order in which they came, see `item_number`. Inner loops count by `np.uint64`: for signed indices the
compiler would add code that handles negative ones, and such loops are not vectorised.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from threading import Timer
from typing import Any, NamedTuple

import numpy as np
from numba import njit  # pyright: ignore[reportMissingImports, reportUnknownVariableType]
from numba.core.options import DefaultOptions  # pyright: ignore[reportMissingImports, reportUnknownVariableType]

from lilgym_mp.appearances import numbering
from lilgym_mp.appearances.numbering import ITEM_TYPE_COUNT, ITEM_TYPE_FOOTPRINTS, REMOVES
from lilgym_mp.appearances.placement import FIRST_TOO_FAR, LARGEST_MOVE, LARGEST_SIDE, OFFSET_LIMIT, OVERLAPPING
from lilgym_mp.arrays import BoolArray, Int16Array, Int64Array, UInt8Array
from lilgym_mp.envs.buffers import NO_REASON
from lilgym_mp.envs.cores.cell_places import REMOVABLE, CellPlaces
from lilgym_mp.envs.cores.tables import MOVE_BASE, TIED, GridTables
from lilgym_mp.programs.box_functions import MAX_BOX_ITEMS
from lilgym_mp.programs.instructions import Operation
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, Size

NO_ITEM = -1
OUTSIDE = -2  # sentinel instead of a reason: the scalar rules must make this edit, see `ScatterCore`
TIE = -3  # sentinel instead of a reason: several pairs of points are nearest, to be resolved by `tied_move`
ITEM_TYPE_FOOTPRINT = np.array(ITEM_TYPE_FOOTPRINTS)
NO_MOVE = LARGEST_MOVE * MOVE_BASE + LARGEST_MOVE
BITS = 62  # of a number that are used for rows
UNKNOWN = -(2**40)  # instead of a truth: only the program itself can tell
(
    _CONSTANT,
    _LENGTH,
    _ITEM_TYPE_TEST,
    _POSITION_TEST,
    _BOX_TABLE,
    _ONLY_BIT,
    _BIT_COUNT,
    _NOT,
    _INVERT,
    _NEGATIVE,
    _AND_THEN,
    _OR_ELSE,
    _BIT_AND,
    _BIT_OR,
    _SHIFT_LEFT,
    _SHIFT_RIGHT,
    _ADD,
    _SUBTRACT,
    _REMAINDER,
    _EQUAL,
    _UNEQUAL,
    _LESS,
    _LESS_OR_EQUAL,
) = map(int, Operation)
SIZE_COUNT = len(Size)
LONG_WAIT = 2.0  # seconds of compiling after which a message says so


_LOG = logging.getLogger("lilgym_mp")
# Kernels allocate nothing: without numba's runtime they count no references to the arrays that they are passed, which
# took most of their time. A numba without the option counts.
_OPTIONS: dict[str, Any] = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


def _kernel(function: Callable[..., Any]) -> Any:
    """To be called from Python: compiled on first use and, where numba can write files, once after installation."""
    try:
        return njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # no directory to keep compiled code in
        return njit(**_OPTIONS)(function)


# Part of kernels. Called instead of inlined, they would be passed hundreds of numbers, which describe all the arrays.
_inlined: Any = njit(forceinline=True, **_OPTIONS)


@cache
def _say_so() -> None:
    _LOG.warning("compiling for batches of environments; the first use after installation takes some seconds")


@contextmanager
def compiling(kernel: Any) -> Iterator[None]:
    """For the first call of a kernel: if compiling it takes long, a message says so."""
    if kernel.signatures:
        yield
        return
    notice = Timer(LONG_WAIT, _say_so)
    notice.daemon = True
    notice.start()
    try:
        yield
    finally:
        notice.cancel()
        notice.join()


cell_and_item_type = _inlined(numbering.cell_and_item_type)
add_index = _inlined(numbering.add_index)
remove_index = _inlined(numbering.remove_index)


@_inlined
def item_number(x: int, y: int, item_type: int) -> int:
    """An item as one number: x, y and item type in a byte each."""
    return (x << 16) | (y << 8) | item_type


@_inlined
def item_fields(item: int) -> tuple[int, int, int]:
    """x, y and item type of an item."""
    return item >> 16, (item >> 8) & 255, item & 255


class Painting(NamedTuple):
    """How items are drawn at one image size, by item type and whether x and y are odd.

    Pixels that an item covers wholly are its alone: `runs`. Those at its edges may be shared with others, so that
    weighted counts of them are kept, as in `render.Palette`: `edges`.
    """

    runs: Int64Array  # (27, 2, 2, rows, 2) by row of the stamp: the first column of the run and the one after the last
    run_counts: Int64Array  # (27, 2, 2) rows
    edges: Int64Array  # (27, 2, 2, edges, 3) row, column and weighted count
    edge_counts: Int64Array  # (27, 2, 2) how many there are
    lines: UInt8Array  # (28, 3 * columns) by item type, then without an item: pixels of a run
    colours: UInt8Array  # (counts, 3) `render.Palette.colours`
    background: UInt8Array  # (height * width * 3,) the image of empty boxes
    width: int  # of the image
    shrink: int


class Scenes(NamedTuple):
    """The current scenes of N environments, and their images."""

    items: Int64Array  # (3 N, capacity) by row: items, then NO_ITEM
    counts: Int64Array  # (3 N,) number of items
    versions: Int64Array  # (3 N,) grows with every change of the box: by 1 when an item is added, else by 2
    weighted: UInt8Array  # (3 N, side, side) weighted counts of coloured pixels, as in `render.Palette`
    images: UInt8Array  # (N, height * width * 3)
    outside: BoolArray  # (N,) environments whose scenes these arrays do not hold


class Starts(NamedTuple):
    """Start scenes by 3 * task + box index."""

    items: Int64Array  # (3 tasks, capacity)
    counts: Int64Array  # (3 tasks,)


@_kernel
def begin(painting: Painting, scenes: Scenes, starts: Starts, env_ids: Int64Array, tasks: Int64Array) -> None:
    """Makes scenes of environments (k,) the start scenes of tasks (k,), and draws them."""
    for k in range(len(env_ids)):
        env_id = env_ids[k]
        for index in range(painting.background.shape[0]):
            scenes.images[env_id, index] = painting.background[index]
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
                append_item(painting, scenes, row, starts.items[start, slot])
            scenes.versions[row] += 1


@_inlined
def paint(painting: Painting, scenes: Scenes, row: int, item: int, sign: int) -> None:
    """Draws an item (sign 1) or takes it out of the picture (sign -1). Items must not share native pixels."""
    x, y, item_type = item_fields(item)
    odd_x, odd_y, shrink = x & 1, y & 1, painting.shrink
    left, top, env_id = (x - odd_x) // shrink, (y - odd_y) // shrink, row // BOX_COUNT
    first = 3 * (top * painting.width + row % BOX_COUNT * (BOX_PITCH // shrink) + left)
    line = item_type if sign > 0 else ITEM_TYPE_COUNT
    for i in range(painting.run_counts[item_type, odd_x, odd_y]):
        start, stop = painting.runs[item_type, odd_x, odd_y, i, 0], painting.runs[item_type, odd_x, odd_y, i, 1]
        byte = np.uint64(first + 3 * (i * painting.width + start))
        for k in range(np.uint64(3 * (stop - start))):
            scenes.images[env_id, byte + k] = painting.lines[line, k]
    for edge in range(painting.edge_counts[item_type, odd_x, odd_y]):
        i, j = painting.edges[item_type, odd_x, odd_y, edge, 0], painting.edges[item_type, odd_x, odd_y, edge, 1]
        count = scenes.weighted[row, top + i, left + j] + sign * painting.edges[item_type, odd_x, odd_y, edge, 2]
        scenes.weighted[row, top + i, left + j] = count
        byte = np.uint64(first + 3 * (i * painting.width + j))
        for k in range(np.uint64(3)):
            scenes.images[env_id, byte + k] = painting.colours[count, k]


@_inlined
def append_item(painting: Painting, scenes: Scenes, row: int, item: int) -> None:
    """Adds an item to a box, as the last one."""
    slot = scenes.counts[row]
    scenes.items[row, slot] = item
    scenes.counts[row] = slot + 1
    scenes.versions[row] += 1
    paint(painting, scenes, row, item, 1)


@_inlined
def delete_item(painting: Painting, scenes: Scenes, row: int, slot: int) -> None:
    """Takes an item out of a box."""
    item, last = scenes.items[row, slot], scenes.counts[row] - 1
    for later in range(slot, last):
        scenes.items[row, later] = scenes.items[row, later + 1]
    scenes.items[row, last] = NO_ITEM
    scenes.counts[row] = last
    scenes.versions[row] += 2
    paint(painting, scenes, row, item, -1)


@_kernel
def write_items(scenes: Scenes, item_types: Int16Array, empty: int, seen: Int64Array, written: Int16Array) -> None:
    """`observation.item_array` of boxes that changed since they were `seen` (3 N,), into `written` (3 N, capacity, 5).

    item_types: (27, 3) shape, colour and size by item type.
    """
    for row in range(len(seen)):
        if seen[row] != scenes.versions[row]:
            seen[row] = scenes.versions[row]
            for slot in range(written.shape[1]):
                item = scenes.items[row, slot]
                x, y, item_type = item_fields(item)
                written[row, slot, 0] = empty if item == NO_ITEM else x
                written[row, slot, 1] = empty if item == NO_ITEM else y
                for field in range(item_types.shape[1]):
                    written[row, slot, 2 + field] = empty if item == NO_ITEM else item_types[item_type, field]


class TowerEdits(NamedTuple):
    """`appearances.tower.TowerTables` for `edit_towers`."""

    boxes: Int64Array  # (13,) by action: the box that it edits
    edits: Int64Array  # (13,) by action: column of `after`
    after: Int64Array  # (121, 4) by stack and edit: the stack after it, or -1
    tops: Int64Array  # (121,) by stack: its last item
    heights: Int64Array  # (121,)
    reasons: Int64Array  # (4,) by edit: why it is invalid where it is


@_kernel
def edit_towers(
    tables: TowerEdits,
    painting: Painting,
    scenes: Scenes,
    stacks: Int64Array,
    env_ids: Int64Array,
    actions: Int64Array,
    applies: BoolArray,
    reasons: Int64Array,
) -> None:
    """Takes actions (k,) in environments (k,), and writes `Core._edit` into `reasons` (k,). `stacks`: (3 N,) by row."""
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
                append_item(painting, scenes, row, tables.tops[after])
            else:
                delete_item(painting, scenes, row, scenes.counts[row] - 1)


@_kernel
def edit_scatters(
    tables: GridTables,
    painting: Painting,
    scenes: Scenes,
    env_ids: Int64Array,
    actions: Int64Array,
    applies: BoolArray,
    reasons: Int64Array,
    ties: Int64Array,
) -> int:
    """Takes actions (k,) in environments (k,), and writes `Core._edit`, OUTSIDE or TIE into `reasons` (k,).

    OUTSIDE is every edit of scenes that the arrays do not hold. For a TIE, `ties` (k, 3) has x and y of the new item
    and the slot of the item that it snaps to. Gives how many of OUTSIDE and TIE there are.
    """
    unresolved = 0
    for k in range(len(env_ids)):
        reasons[k] = NO_REASON
        if actions[k] == 0:
            continue
        if scenes.outside[env_ids[k]]:
            reasons[k] = OUTSIDE
        else:
            cell, item_type = cell_and_item_type(actions[k], tables.cell_count)
            row = env_ids[k] * BOX_COUNT + tables.boxes[cell]
            if item_type == REMOVES:
                reasons[k] = _remove(tables, painting, scenes, row, cell, applies[k])
            else:
                reason, x, y, slot = _add(tables, painting, scenes, row, cell, item_type, applies[k])
                reasons[k], ties[k, 0], ties[k, 1], ties[k, 2] = reason, x, y, slot
        unresolved += reasons[k] == OUTSIDE or reasons[k] == TIE
    return unresolved


@_inlined
def _add(
    tables: GridTables, painting: Painting, scenes: Scenes, row: int, cell: int, item_type: int, applies: bool
) -> tuple[int, int, int, int]:
    """The reason of an ADD, where it lies before it snaps, and the slot of the closest item."""
    footprint, x, y = ITEM_TYPE_FOOTPRINT[item_type], tables.xs[cell], tables.ys[cell]
    reason = tables.add_reasons[footprint, cell]
    if reason != NO_REASON:
        return reason, x, y, 0
    clearance, slot = _closest(tables, scenes, row, footprint, x, y)
    if clearance == OVERLAPPING:
        x, y = _search(tables, scenes, row, footprint, x, y)
        if x < 0:
            return tables.overlap, x, y, 0
        clearance, slot = _closest(tables, scenes, row, footprint, x, y)
    if clearance >= FIRST_TOO_FAR or not tables.snaps:
        return place(tables, painting, scenes, row, item_type, x, y, NO_MOVE, applies), x, y, slot
    other_x, other_y, other_look = item_fields(scenes.items[row, slot])
    other_footprint = ITEM_TYPE_FOOTPRINT[other_look]
    move = tables.moves[footprint, other_footprint, x - other_x + OFFSET_LIMIT, y - other_y + OFFSET_LIMIT]
    if move == TIED:
        return TIE, x, y, slot
    return place(tables, painting, scenes, row, item_type, x, y, int(move), applies), x, y, slot


@_inlined
def _closest(tables: GridTables, scenes: Scenes, row: int, footprint: int, x: int, y: int) -> tuple[int, int]:
    """`PlacementTables.closest` of a new item: the smallest clearance code, and the first slot that has it."""
    smallest, closest = FIRST_TOO_FAR, 0
    for slot in range(scenes.counts[row]):
        other_x, other_y, item_type = item_fields(scenes.items[row, slot])
        dx, dy = x - other_x + OFFSET_LIMIT, y - other_y + OFFSET_LIMIT
        if 0 <= dx <= 2 * OFFSET_LIMIT and 0 <= dy <= 2 * OFFSET_LIMIT:
            code = int(tables.clearance[footprint, ITEM_TYPE_FOOTPRINT[item_type], dx, dy])
            if code < smallest:
                smallest, closest = code, slot
    return smallest, closest


@_inlined
def _free_rows(tables: GridTables, scenes: Scenes, row: int, footprint: int, x: int, y: int, rows: int) -> int:
    """Those of `rows`, bits from y on, where a new item with its left side at x is in the box and overlaps nothing."""
    last = tables.last_corners[footprint]
    if x > last or y > last:
        return 0
    if last - y < BITS:
        rows &= (1 << (last - y + 1)) - 1
    for slot in range(scenes.counts[row]):
        other_x, other_y, item_type = item_fields(scenes.items[row, slot])
        dx, dy = x - other_x + LARGEST_SIDE, y - other_y + LARGEST_SIDE
        if 0 <= dx <= 2 * LARGEST_SIDE:
            overlap = tables.overlaps[ITEM_TYPE_FOOTPRINT[item_type], footprint, dx]
            if 0 <= dy <= 2 * LARGEST_SIDE:
                rows &= ~(overlap >> dy)
            elif -BITS < dy < 0:
                rows &= ~(overlap << -dy)
    return rows


@_inlined
def _search(tables: GridTables, scenes: Scenes, row: int, footprint: int, cell_x: int, cell_y: int) -> tuple[int, int]:
    """`placement.searched` in a cell: x and y of the first place that is free, or -1."""
    for column in range(tables.searched.shape[1]):
        for part in range(tables.searched.shape[2]):
            x, y = cell_x + column, cell_y + part * tables.part_height
            free = _free_rows(tables, scenes, row, footprint, x, y, tables.searched[footprint, column, part])
            if free:
                while not free & 1:
                    free >>= 1
                    y += 1
                return x, y
    return -1, -1


@_kernel
def place(
    tables: GridTables,
    painting: Painting,
    scenes: Scenes,
    row: int,
    item_type: int,
    x: int,
    y: int,
    move: int,
    applies: bool,
) -> int:
    """Moves a new item if the rules allow, and adds it where the edit applies: NO_REASON or OUTSIDE."""
    if move != NO_MOVE:
        new_x, new_y = x + move // MOVE_BASE - LARGEST_MOVE, y + move % MOVE_BASE - LARGEST_MOVE
        inside = new_x >= 0 and new_y >= 0
        if inside and _free_rows(tables, scenes, row, ITEM_TYPE_FOOTPRINT[item_type], new_x, new_y, 1):
            x, y = new_x, new_y
        elif tables.keeps_unfit_snaps:
            return OUTSIDE
    if applies:
        append_item(painting, scenes, row, item_number(x, y, item_type))
    return NO_REASON


@_inlined
def _area_in_cell(tables: GridTables, item: int, cell_x: int, cell_y: int) -> int:
    """How much of a cell an item covers, as a rank among all such areas; 0 for nothing."""
    x, y, item_type = item_fields(item)
    dx, dy = cell_x - x + tables.cell_width - 1, cell_y - y + tables.cell_height - 1
    if 0 <= dx < tables.areas.shape[1] and 0 <= dy < tables.areas.shape[2]:
        return int(tables.areas[ITEM_TYPE_FOOTPRINT[item_type], dx, dy])
    return 0


@_inlined
def _remove(tables: GridTables, painting: Painting, scenes: Scenes, row: int, cell: int, applies: bool) -> int:
    """Takes away the item that covers most of the cell, the first one if several do. Gives the reason."""
    if tables.remove_reasons[cell] != NO_REASON:
        return tables.remove_reasons[cell]
    largest, taken = 0, 0
    for slot in range(scenes.counts[row]):
        area = _area_in_cell(tables, scenes.items[row, slot], tables.xs[cell], tables.ys[cell])
        if area > largest:
            largest, taken = area, slot
    if largest == 0:
        return tables.nothing_to_remove
    if applies:
        delete_item(painting, scenes, row, taken)
    return NO_REASON


@_kernel
def write_masks(
    tables: GridTables, places: CellPlaces, scenes: Scenes, seen: Int64Array, words: Any, masks: BoolArray
) -> None:
    """`Scatter.legal_mask` of boxes that changed since they were `seen` (3 N,), into `masks` (N, actions).

    An added item changes only the cells that it reaches, any other change those of the whole box. `words` (words,)
    uint64: room to work in.
    """
    for row in range(len(seen)):
        if seen[row] == scenes.versions[row]:
            continue
        grown = seen[row] + 1 == scenes.versions[row]
        seen[row] = scenes.versions[row]
        newest = scenes.items[row, max(0, scenes.counts[row] - 1)]
        for cell in range(places.empty.shape[1]):
            if grown and not _reaches(tables, places, newest, cell):
                continue
            legal = _legal_edits(tables, places, scenes, row, cell, words)
            in_grid = tables.first_cells[row % BOX_COUNT] + cell
            first = np.uint64(add_index(in_grid, 0))
            for item_type in range(np.uint64(ITEM_TYPE_COUNT)):
                masks[row // BOX_COUNT, first + item_type] = places.adds[legal, item_type]
            masks[row // BOX_COUNT, remove_index(in_grid, tables.cell_count)] = (legal & REMOVABLE) != 0


@_inlined
def _line(tables: GridTables, places: CellPlaces, item: int, cell: int, part: int) -> int:
    """The line of `CellPlaces.left` for an item and a part of a cell of its box."""
    x, y, item_type = item_fields(item)
    dx = tables.xs[cell] - x + places.offset[0]
    dy = tables.ys[cell] + part * places.part_height - y + places.offset[1]
    if 0 <= dx < places.lines.shape[1] and 0 <= dy < places.lines.shape[2]:
        return int(places.lines[ITEM_TYPE_FOOTPRINT[item_type], dx, dy])
    return 0


@_inlined
def _reaches(tables: GridTables, places: CellPlaces, item: int, cell: int) -> bool:
    """Whether an item may change what can be added to a cell or removed from it."""
    reaches = False
    for part in range(places.empty.shape[0]):
        reaches |= _line(tables, places, item, cell, part) != 0
    return reaches


@_inlined
def _legal_edits(tables: GridTables, places: CellPlaces, scenes: Scenes, row: int, cell: int, words: Any) -> int:
    """A bit for each footprint that can be added to a cell, and REMOVABLE; `words` (words,) uint64: room to work in."""
    width = np.uint64(places.empty.shape[2])
    legal = 0
    for part in range(places.empty.shape[0]):
        for word in range(width):
            words[word] = places.empty[part, cell, word]
        for slot in range(scenes.counts[row]):
            line = _line(tables, places, scenes.items[row, slot], cell, part)
            if line != 0:
                for word in range(width):
                    words[word] &= places.left[line, word]
        for word in range(width):
            if (words[word] != 0) == (places.edits[word] != REMOVABLE):
                legal |= places.edits[word]
    return legal


class Programs(NamedTuple):
    """Truths of programs as `programs.instructions`, and what they ask of boxes."""

    rows: Int64Array  # (instructions, 3) operation, a, b; program after program
    ends: Int64Array  # (programs + 1,) where each program's instructions end, 0 first
    places: Int64Array  # (3, 100, 100) by size, x and y of an item: a bit for each test that it passes
    tables: Int64Array  # (tables, 121) what boxes have by stack, or UNKNOWN


@_kernel
def write_truths(
    programs: Programs,
    scenes: Scenes,
    stacks: Int64Array,
    env_ids: Int64Array,
    chosen: Int64Array,
    values: Int64Array,
    truths: Int64Array,
) -> int:
    """Writes into `truths` (k,) whether the chosen programs (k,) are true in environments (k,): 0, 1 or UNKNOWN.

    UNKNOWN too where `chosen` is negative or the arrays do not hold the scene. Gives the number of UNKNOWN.
    `stacks`: (3 N,) by row, of towers; `values` (MAX_INSTRUCTIONS,): room to work in.
    """
    unknown = 0
    for k in range(len(env_ids)):
        first_row = env_ids[k] * BOX_COUNT
        truths[k] = UNKNOWN
        unknown += 1
        if chosen[k] < 0 or scenes.outside[env_ids[k]]:
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
            if operation == _CONSTANT:
                value = a
            elif operation == _LENGTH:
                value = scenes.counts[first_row + b]
            elif operation == _ITEM_TYPE_TEST:
                value = 0
                for slot in range(scenes.counts[first_row + b]):
                    value |= ((a >> (scenes.items[first_row + b, slot] & 255)) & 1) << slot
            elif operation == _POSITION_TEST:
                value = 0
                for slot in range(scenes.counts[first_row + b]):
                    x, y, item_type = item_fields(scenes.items[first_row + b, slot])
                    value |= ((programs.places[item_type % SIZE_COUNT, x, y] >> a) & 1) << slot
            elif operation == _BOX_TABLE:
                value = programs.tables[a, stacks[first_row + b]]
                is_known &= value != UNKNOWN
            elif operation == _ONLY_BIT:
                value = 0
                is_known &= values[a] != 0 and values[a] & (values[a] - 1) == 0
                while value < BITS and not (values[a] >> value) & 1:
                    value += 1
            elif operation == _BIT_COUNT:
                value, left = 0, values[a]
                while left > 0:
                    left &= left - 1
                    value += 1
            elif operation == _NOT:
                value = int(values[a] == 0)
            elif operation == _INVERT:
                value = ~values[a]
            elif operation == _NEGATIVE:
                value = -values[a]
            elif operation == _AND_THEN:
                value = values[b] if values[a] != 0 else values[a]
            elif operation == _OR_ELSE:
                value = values[a] if values[a] != 0 else values[b]
            elif operation == _BIT_AND:
                value = values[a] & values[b]
            elif operation == _BIT_OR:
                value = values[a] | values[b]
            elif operation == _SHIFT_LEFT:
                value = values[a] << values[b]
            elif operation == _SHIFT_RIGHT:
                value = values[a] >> values[b]
            elif operation == _ADD:
                value = values[a] + values[b]
            elif operation == _SUBTRACT:
                value = values[a] - values[b]
            elif operation == _REMAINDER:
                value = values[a] % values[b]
            elif operation == _EQUAL:
                value = int(values[a] == values[b])
            elif operation == _UNEQUAL:
                value = int(values[a] != values[b])
            elif operation == _LESS:
                value = int(values[a] < values[b])
            else:
                value = int(values[a] <= values[b])
            values[index] = value
        if is_known:
            truths[k] = int(values[last - first - 1] != 0)
            unknown -= 1
    return unknown
