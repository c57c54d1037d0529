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
from lilgym_mp.envs.fast.box_functions import MAX_BOX_ITEMS
from lilgym_mp.envs.fast.instructions import Operation
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, Size
from lilgym_mp.scene.appearances.scatter.actions import ITEM_TYPE_COUNT
from lilgym_mp.scene.arrays import BoolArray, Int16Array, Int64Array, UInt8Array

NO_ITEM = -1
BEYOND = 64  # pixels that an item may lie outside its box, to the left or above
BITS = 62  # bits of an int64 used for a mask
UNKNOWN = -(2**40)  # sentinel instead of a truth value: the program itself must be called
SIZE_COUNT = len(Size)
LONG_WAIT = 2.0  # seconds of compiling before a line is printed

# Kernels allocate nothing, so they do not need numba's runtime. Without it they do not count references to arrays,
# which took most of their time. A version of numba without the option works, slower.
_OPTIONS: dict[str, Any] = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


def kernel(function: Callable[..., Any]) -> Any:
    """Decorator for functions called from Python: compiled on first use and cached on disk if numba can write there."""
    try:
        return njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # no writable cache directory
        return njit(**_OPTIONS)(function)


# Decorator for functions called by kernels. Inlined, because a call passes the hundreds of values that describe arrays.
inlined: Any = njit(forceinline=True, **_OPTIONS)


def compiling(compiled: Any) -> AbstractContextManager[None]:
    """Context for the first call of a kernel: prints a line on stderr if compiling takes long."""
    note = f"loading {compiled.__name__} for batches of environments, or compiling it, once after installation"
    return nullcontext() if compiled.signatures else note_after(note, LONG_WAIT)


@inlined
def encode_item(x: int, y: int, item_type: int) -> int:
    """An item as one int: x, y and item type in a byte each; x and y are at least -BEYOND."""
    return ((x + BEYOND) << 16) | ((y + BEYOND) << 8) | item_type


@inlined
def decode_item(item: int) -> tuple[int, int, int]:
    """x, y and item type of an item."""
    return (item >> 16) - BEYOND, ((item >> 8) & 255) - BEYOND, item & 255


class DrawingTables(NamedTuple):
    """Lookup tables for drawing items at one image size, by item type and parity of x and y.

    `runs` are pixels that an item covers completely, which no other item can touch. `edges` are pixels that it covers
    in part and may share with others; they are drawn from weighted counts, as in `scene.render.drawing.Palette`.
    """

    runs: Int64Array  # (27, 2, 2, rows, 2) first column of the run in each row, and the column after the last
    run_counts: Int64Array  # (27, 2, 2) number of rows
    edges: Int64Array  # (27, 2, 2, edges, 3) row, column and weighted count
    edge_counts: Int64Array  # (27, 2, 2) number of edges
    lines: UInt8Array  # (28, 3 * columns) colours of a run, by item type; last: of an empty box
    colours: UInt8Array  # (counts, 3) `scene.render.drawing.Palette.colours`
    background: UInt8Array  # (height * width * 3,) the image of empty boxes
    width: int  # width of the image
    shrink: int


class Scenes(NamedTuple):
    """The current scenes of N environments, and their images."""

    items: Int64Array  # (3 N, capacity) each row: items, then NO_ITEM
    counts: Int64Array  # (3 N,) number of items
    versions: Int64Array  # (3 N,) increases with every change of the box: by 1 if an item is added, else by 2 or more
    weighted: UInt8Array  # (3 N, side, side) weighted counts of coloured pixels, as in `scene.render.drawing.Palette`
    images: UInt8Array  # (N, height * width * 3)
    is_unfit: BoolArray  # (N,) environments with items outside their box or overlapping: not drawn here


class StartScenes(NamedTuple):
    """Start scenes, with one row per box: 3 * task index + box index."""

    items: Int64Array  # (3 tasks, capacity)
    counts: Int64Array  # (3 tasks,)
    is_unfit: BoolArray  # (tasks,) as in `Scenes`


@kernel
def start_episodes(
    drawing: DrawingTables, scenes: Scenes, starts: StartScenes, env_ids: Int64Array, tasks: Int64Array
) -> None:
    """Sets the scenes of environments (k,) to the start scenes of tasks (k,) and draws them."""
    for k in range(len(env_ids)):
        env_id = env_ids[k]
        scenes.is_unfit[env_id] = starts.is_unfit[tasks[k]]
        for index in range(drawing.background.shape[0]):
            scenes.images[env_id, index] = drawing.background[index]
        for box in range(BOX_COUNT):
            row = env_id * BOX_COUNT + box
            start = tasks[k] * BOX_COUNT + box
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


@inlined
def draw_item(drawing: DrawingTables, scenes: Scenes, row: int, item: int, sign: int) -> None:
    """Draws an item (sign 1) or erases it (sign -1), unless the scene is unfit. Items must not share native pixels."""
    if scenes.is_unfit[row // BOX_COUNT]:
        return
    x, y, item_type = decode_item(item)
    odd_x = x & 1
    odd_y = y & 1
    shrink = drawing.shrink
    left = (x - odd_x) // shrink
    top = (y - odd_y) // shrink
    env_id = row // BOX_COUNT
    first = 3 * (top * drawing.width + row % BOX_COUNT * (BOX_PITCH // shrink) + left)
    line = item_type if sign > 0 else ITEM_TYPE_COUNT
    for i in range(drawing.run_counts[item_type, odd_x, odd_y]):
        start = drawing.runs[item_type, odd_x, odd_y, i, 0]
        stop = drawing.runs[item_type, odd_x, odd_y, i, 1]
        byte = np.uint64(first + 3 * (i * drawing.width + start))
        for k in range(np.uint64(3 * (stop - start))):
            scenes.images[env_id, byte + k] = drawing.lines[line, k]
    for edge in range(drawing.edge_counts[item_type, odd_x, odd_y]):
        i = drawing.edges[item_type, odd_x, odd_y, edge, 0]
        j = drawing.edges[item_type, odd_x, odd_y, edge, 1]
        count = scenes.weighted[row, top + i, left + j] + sign * drawing.edges[item_type, odd_x, odd_y, edge, 2]
        scenes.weighted[row, top + i, left + j] = count
        byte = np.uint64(first + 3 * (i * drawing.width + j))
        for k in range(np.uint64(3)):
            scenes.images[env_id, byte + k] = drawing.colours[count, k]


@inlined
def append_item(drawing: DrawingTables, scenes: Scenes, row: int, item: int) -> None:
    """Appends an item to a box."""
    slot = scenes.counts[row]
    scenes.items[row, slot] = item
    scenes.counts[row] = slot + 1
    scenes.versions[row] += 1
    draw_item(drawing, scenes, row, item, 1)


@inlined
def delete_item(drawing: DrawingTables, scenes: Scenes, row: int, slot: int) -> None:
    """Deletes an item of a box."""
    item = scenes.items[row, slot]
    last = scenes.counts[row] - 1
    for later in range(slot, last):
        scenes.items[row, later] = scenes.items[row, later + 1]
    scenes.items[row, last] = NO_ITEM
    scenes.counts[row] = last
    scenes.versions[row] += 2
    draw_item(drawing, scenes, row, item, -1)


@kernel
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
    """`scene.appearances.tower.geometry.TowerTables` for `edit_tower_scenes`."""

    boxes: Int64Array  # (13,) by action: box
    edits: Int64Array  # (13,) by action: column of `after`
    after: Int64Array  # (121, 4) by stack and edit: the next stack, or -1 if invalid
    tops: Int64Array  # (121,) by stack: the top item
    heights: Int64Array  # (121,)
    reasons: Int64Array  # (4,) by edit: the reason if it is invalid


@kernel
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
        row = env_ids[k] * BOX_COUNT + tables.boxes[actions[k]]
        edit = tables.edits[actions[k]]
        before = stacks[row]
        after = tables.after[stacks[row], edit]
        if after < 0:
            reasons[k] = tables.reasons[edit]
        elif applies[k]:
            stacks[row] = after
            if tables.heights[after] > tables.heights[before]:
                append_item(drawing, scenes, row, tables.tops[after])
            else:
                delete_item(drawing, scenes, row, scenes.counts[row] - 1)


class Programs(NamedTuple):
    """Programs compiled to `envs.fast.instructions`, and the tables that the instructions read."""

    rows: Int64Array  # (instructions, 3) operation, a, b; of all programs
    ends: Int64Array  # (programs + 1,) bounds of each program's instructions
    places: Int64Array  # (3, 100, 100) by size, x and y of an item: bitmask of the tests that it passes
    tables: Int64Array  # (tables, 121) value by stack, or UNKNOWN


@kernel
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

    UNKNOWN also for a negative index and for unfit scenes. Returns the number of UNKNOWN.
    `stacks`: (3 N,) stack indices of Tower; `values` (MAX_INSTRUCTIONS,): scratch buffer.
    """
    unknown = 0
    for k in range(len(env_ids)):
        first_row = env_ids[k] * BOX_COUNT
        truths[k] = UNKNOWN
        unknown += 1
        if chosen[k] < 0 or scenes.is_unfit[env_ids[k]]:
            continue
        most = 0
        for box in range(BOX_COUNT):
            most = max(most, scenes.counts[first_row + box])
        if most > MAX_BOX_ITEMS:
            continue
        first = programs.ends[chosen[k]]
        last = programs.ends[chosen[k] + 1]
        is_known = True
        for index in range(last - first):
            row = first + index
            operation = programs.rows[row, 0]
            a = programs.rows[row, 1]
            b = programs.rows[row, 2]
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
                value = 0
                left = values[a]
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
