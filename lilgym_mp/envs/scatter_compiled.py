"""Edits and masks of many Scatter scenes, compiled by numba: one environment after another, without Python between.

The tables are those of the array operations; only the extra "numba" makes this module importable.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit  # pyright: ignore[reportMissingImports, reportUnknownVariableType]
from numpy.typing import NDArray

from lilgym_mp.appearances import PlacementRules, Scatter
from lilgym_mp.appearances.placement import FIRST_TOO_FAR, OVERLAPPING, search_offsets
from lilgym_mp.appearances.scatter import LOOK_KINDS, LOOKS
from lilgym_mp.envs.block import NO_REASON, BoolArray, Int64Array
from lilgym_mp.envs.scatter_edits import LOOSE, NO_ITEM, NOTHING_TO_REMOVE, OVERLAP, Boxes, Cells, tied_move
from lilgym_mp.envs.scatter_masks import ScatterMasks
from lilgym_mp.envs.scatter_room import FLAGS, REMOVABLE, CellRoom
from lilgym_mp.envs.scatter_tables import (
    EMPTY_SLOT,
    KINDS,
    NEW_KIND_SIZE,
    PAIR_SIZE,
    PLACE_PITCH,
    REACH,
    REACH_START,
    SAME_PLACE,
    TIED,
    area_ranks,
    geometry,
)
from lilgym_mp.render import UInt8Array, draw, palette, shrink_of, stamp
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, Scene

LOOK_COUNT = len(LOOKS)
TIE = -3  # instead of a reason: nearest points tie, and `tied_move` has the word


class _Tables(NamedTuple):
    """What never changes, of a grid, a rule set and an image size."""

    clearance: NDArray[np.uint8]  # these three as in `scatter_tables.Geometry`
    moves: NDArray[np.int16]
    within: BoolArray
    areas: NDArray[np.uint16]  # `scatter_tables.area_ranks`
    cells: Cells
    kinds: Int64Array  # (28,) by look
    searched: BoolArray  # (9, cell width, cell height) `placement.search_offsets`, or nothing where none is searched
    stamps: UInt8Array  # (27, 2, 2, side, side) by look, odd x and odd y: counts, as in `render.Stamp`
    stamp_sides: Int64Array  # (27, 2) by look and odd coordinate: rows or columns of the stamp
    colours: UInt8Array  # (counts, 3) `render.Palette.colours`
    background: UInt8Array  # (height * width * 3,) the image of empty boxes
    shrink: int
    snaps: bool
    keeps_unfit_snaps: bool


class _Canvases(NamedTuple):
    """What changes: the boxes of `scatter_edits.Boxes` and their pictures."""

    boxes: Boxes
    counts: UInt8Array  # (3 N, side, side) weighted counts of coloured pixels in each block of a box
    images: UInt8Array  # (N, height, width, 3)


class CompiledEdits:
    """`scatter_edits.Edits` by numba."""

    def __init__(
        self, appearance: Scatter, rules: PlacementRules, boxes: Boxes, images: UInt8Array, image_size: str
    ) -> None:
        self._rules = rules
        self._tables = _tables(appearance, rules, image_size)
        side = BOX_SIDE // shrink_of(image_size)
        self._canvases = _Canvases(boxes, np.zeros((len(boxes.counts), side, side), np.uint8), images)
        images[:] = draw(Scene.empty(), image_size)

    def begin(self, numbers: Int64Array, starts: Boxes, tasks: Int64Array, scenes: Sequence[Scene]) -> None:
        _begin(self._tables, self._canvases, numbers, starts, tasks)

    def edit(self, numbers: Int64Array, actions: Int64Array, applies: BoolArray, loose: BoolArray) -> Int64Array:
        tables, canvases = self._tables, self._canvases
        reasons, places, closest = np.empty((3, len(numbers)), np.int64)
        _edit(tables, canvases, numbers, actions, applies, loose, reasons, places, closest)
        for tied in (reasons == TIE).nonzero()[0].tolist():
            cell, look = divmod(int(actions[tied]) - 1, LOOK_COUNT)
            row = int(numbers[tied]) * BOX_COUNT + int(tables.cells.boxes[cell])
            other = int(canvases.boxes.items[row, closest[tied]])
            move = tied_move(int(KINDS[look]), int(places[tied]), other, row % BOX_COUNT, self._rules)
            reasons[tied] = _settle(tables, canvases, row, look, places[tied], move, applies[tied])
        return reasons


class CompiledMasks(ScatterMasks):
    """`ScatterMasks` by numba."""

    def __init__(self, appearance: Scatter, rules: PlacementRules, masks: BoolArray) -> None:
        super().__init__(appearance, rules, masks)
        self._masks = masks

    def _renew(self, boxes: Int64Array, grown: BoolArray, slots: Int64Array, counts: Int64Array) -> None:
        _renew_masks(self._room, self._first_cells, LOOK_KINDS, boxes, grown, slots, counts, self._masks)


def _tables(appearance: Scatter, rules: PlacementRules, image_size: str) -> _Tables:
    shrink = shrink_of(image_size)
    stamps = [
        [[stamp(int(kind), look[1], x, y, shrink).counts for y in (0, 1)] for x in (0, 1)]
        for look, kind in zip(LOOKS, KINDS, strict=False)
    ]
    largest = max(counts.shape[0] for by_x in stamps for by_y in by_x for counts in by_y)
    table = np.zeros((LOOK_COUNT, 2, 2, largest, largest), np.uint8)
    for look, by_x in enumerate(stamps):
        for x, by_y in enumerate(by_x):
            for y, counts in enumerate(by_y):
                table[look, x, y, : counts.shape[0], : counts.shape[1]] = counts
    return _Tables(
        *geometry(),
        areas=area_ranks(*appearance.cell),
        cells=Cells.of(appearance),
        kinds=KINDS,
        searched=search_offsets(*appearance.cell) if appearance.searches(rules) else np.zeros((0, 0, 0), np.bool_),
        stamps=table,
        stamp_sides=np.array([[by_x[0][odd].shape[0] for odd in (0, 1)] for by_x in stamps]),
        colours=palette(shrink).colours,
        background=draw(Scene.empty(), image_size).ravel(),
        shrink=shrink,
        snaps=not appearance.is_native,
        keeps_unfit_snaps=rules.keeps_unfit_snaps,
    )


_compiled: Any = njit(cache=True)


@_compiled
def _begin(tables: _Tables, canvases: _Canvases, numbers: Int64Array, starts: Boxes, tasks: Int64Array) -> None:
    """`Edits.begin`."""
    boxes = canvases.boxes
    for k in range(len(numbers)):
        number, task = numbers[k], tasks[k]
        pixels = canvases.images[number].reshape(-1)
        for index in range(
            len(pixels)
        ):  # a single run of memory, while a slice of the image is copied along three axes
            pixels[index] = tables.background[index]
        for index in range(BOX_COUNT):
            row, start = number * BOX_COUNT + index, task * BOX_COUNT + index
            boxes.slots[row] = starts.slots[start]
            boxes.items[row] = starts.items[start]
            boxes.counts[row] = starts.counts[start]
            boxes.kept[row] = starts.counts[start]
            canvases.counts[row] = 0
            for slot in range(boxes.counts[row]):
                place, look = divmod(boxes.items[row, slot], LOOK_COUNT)
                _paint(tables, canvases, row, place, look, 1)


@_compiled
def _paint(tables: _Tables, canvases: _Canvases, row: int, place: int, look: int, sign: int) -> None:
    """An item comes (sign 1) or goes (sign -1)."""
    x, y = place // PLACE_PITCH, place % PLACE_PITCH
    odd_x, odd_y, shrink = x % 2, y % 2, tables.shrink
    left, top = (x - odd_x) // shrink, (y - odd_y) // shrink
    image, image_left = canvases.images[row // BOX_COUNT], row % BOX_COUNT * (BOX_PITCH // shrink) + left
    own, counts = tables.stamps[look, odd_x, odd_y], canvases.counts[row]
    for i in range(tables.stamp_sides[look, odd_y]):
        for j in range(tables.stamp_sides[look, odd_x]):
            if own[i, j]:
                count = counts[top + i, left + j] + sign * own[i, j]
                counts[top + i, left + j] = count
                for channel in range(3):
                    image[top + i, image_left + j, channel] = tables.colours[count, channel]


@_compiled
def _edit(
    tables: _Tables,
    canvases: _Canvases,
    numbers: Int64Array,
    actions: Int64Array,
    applies: BoolArray,
    loose: BoolArray,
    reasons: Int64Array,
    places: Int64Array,
    closest: Int64Array,
) -> None:
    """`Edits.edit` into `reasons` (k,); where it is TIE, into `places` and `closest` what `tied_move` asks for."""
    cells = tables.cells
    first_remove = 1 + cells.count * LOOK_COUNT
    for k in range(len(numbers)):
        if actions[k] == 0:
            reasons[k] = NO_REASON
            continue
        if loose[numbers[k]]:
            reasons[k] = LOOSE
            continue
        if actions[k] >= first_remove:
            cell = actions[k] - first_remove
            row = numbers[k] * BOX_COUNT + cells.boxes[cell]
            reasons[k] = cells.remove_reasons[cell]
            if reasons[k] == NO_REASON:
                reasons[k] = _remove(tables, canvases, row, cells.places[cell], applies[k])
            continue
        cell, look = divmod(actions[k] - 1, LOOK_COUNT)
        row, kind = numbers[k] * BOX_COUNT + cells.boxes[cell], tables.kinds[look]
        reasons[k] = cells.add_reasons[kind * cells.count + cell]
        if reasons[k] != NO_REASON:
            continue
        place = cells.places[cell]
        clearance, slot = _closest(tables, canvases.boxes, row, kind, place)
        if clearance == OVERLAPPING:
            place = _search(tables, canvases.boxes, row, kind, place)
            if place < 0:
                reasons[k] = OVERLAP
                continue
            clearance, slot = _closest(tables, canvases.boxes, row, kind, place)
        move = 0
        if clearance < FIRST_TOO_FAR and tables.snaps:
            move = tables.moves[kind * NEW_KIND_SIZE + SAME_PLACE + place - canvases.boxes.slots[row, slot]]
        if move == TIED:
            reasons[k], places[k], closest[k] = TIE, place, slot
        else:
            reasons[k] = _settle(tables, canvases, row, look, place, move, applies[k])


@_compiled
def _closest(tables: _Tables, boxes: Boxes, row: int, kind: int, place: int) -> tuple[int, int]:
    """`PlacementTables.closest` of a new item: the smallest clearance code, and the first slot that has it."""
    origin = kind * NEW_KIND_SIZE + SAME_PLACE + place
    smallest, closest = FIRST_TOO_FAR, 0
    for slot in range(boxes.counts[row]):
        code = int(tables.clearance[origin - boxes.slots[row, slot]])
        if code < smallest:
            smallest, closest = code, slot
    return smallest, closest


@_compiled
def _search(tables: _Tables, boxes: Boxes, row: int, kind: int, corner: int) -> int:
    """`placement.searched` in the cell at `corner`: the first place that is free, or -1."""
    if not len(tables.searched):
        return -1
    searched = tables.searched[kind]
    for x in range(searched.shape[0]):
        for y in range(searched.shape[1]):
            place = corner + x * PLACE_PITCH + y
            if searched[x, y] and tables.within[kind * REACH + REACH_START + place]:
                origin, free = kind * NEW_KIND_SIZE + SAME_PLACE + place, True
                for slot in range(boxes.counts[row]):
                    if tables.clearance[origin - boxes.slots[row, slot]] == OVERLAPPING:
                        free = False
                        break
                if free:
                    return place
    return -1


@_compiled
def _settle(tables: _Tables, canvases: _Canvases, row: int, look: int, place: int, move: int, applies: bool) -> int:
    """Snaps a new item by `move` where the rules have it, and puts it there: NO_REASON, or LOOSE."""
    boxes, kind = canvases.boxes, tables.kinds[look]
    if move != 0:
        fits = tables.within[kind * REACH + REACH_START + place + move]
        if fits:
            origin = kind * NEW_KIND_SIZE + SAME_PLACE + place + move
            for slot in range(boxes.counts[row]):
                if tables.clearance[origin - boxes.slots[row, slot]] == OVERLAPPING:
                    fits = False
                    break
        if fits:
            place += move
        elif tables.keeps_unfit_snaps:
            return LOOSE
    if applies:
        slot = boxes.counts[row]
        boxes.slots[row, slot] = place - kind * PAIR_SIZE
        boxes.items[row, slot] = place * LOOK_COUNT + look
        boxes.counts[row] += 1
        _paint(tables, canvases, row, place, look, 1)
    return NO_REASON


@_compiled
def _remove(tables: _Tables, canvases: _Canvases, row: int, cell: int, applies: bool) -> int:
    """Takes away the item that covers most of the cell at the place `cell`: NO_REASON, or NOTHING_TO_REMOVE."""
    boxes = canvases.boxes
    largest, taken = 0, 0
    for slot in range(boxes.counts[row]):
        area = tables.areas[SAME_PLACE + cell - boxes.slots[row, slot]]
        if area > largest:
            largest, taken = area, slot
    if largest == 0:
        return NOTHING_TO_REMOVE
    if applies:
        place, look = divmod(boxes.items[row, taken], LOOK_COUNT)
        last = boxes.counts[row] - 1
        for slot in range(taken, last):
            boxes.slots[row, slot] = boxes.slots[row, slot + 1]
            boxes.items[row, slot] = boxes.items[row, slot + 1]
        boxes.slots[row, last] = EMPTY_SLOT
        boxes.items[row, last] = NO_ITEM
        boxes.counts[row] = last
        boxes.kept[row] = min(boxes.kept[row], taken)
        _paint(tables, canvases, row, place, look, -1)
    return NO_REASON


@_compiled
def _renew_masks(
    room: CellRoom,
    first_cells: Int64Array,
    look_kinds: Int64Array,
    boxes: Int64Array,
    grown: BoolArray,
    slots: Int64Array,
    counts: Int64Array,
    masks: BoolArray,
) -> None:
    """`ScatterMasks._renew`; `first_cells` (3,) of the grid's cells in each box, `look_kinds` (27,)."""
    parts, cells, width = room.empty.shape
    words = np.empty(width, np.uint64)
    first_remove = 1 + (masks.shape[1] - 1) // (LOOK_COUNT + 1) * LOOK_COUNT  # 27 ADDs and a REMOVE for each cell
    for k in range(len(boxes)):
        environment, first = boxes[k] // BOX_COUNT, first_cells[boxes[k] % BOX_COUNT]
        for cell in range(cells):
            if grown[k] and not _reaches(room, slots[k, counts[k] - 1], cell):
                continue
            edits = 0
            for part in range(parts):
                words[:] = room.empty[part, cell]
                for slot in range(counts[k]):
                    line = room.lines[room.corners[part, cell] - slots[k, slot]]
                    if line != 0:
                        for word in range(width):
                            words[word] &= room.left[line, word]
                for group in range(width // FLAGS):
                    flags = 0
                    for flag in range(FLAGS):
                        if words[group * FLAGS + flag] != 0:
                            flags |= 1 << flag
                    edits |= room.edits[group, flags]
            number = first + cell
            for look in range(LOOK_COUNT):
                masks[environment, 1 + number * LOOK_COUNT + look] = (edits >> look_kinds[look]) & 1
            masks[environment, first_remove + number] = (edits & REMOVABLE) != 0


@_compiled
def _reaches(room: CellRoom, slot: int, cell: int) -> bool:
    """Whether an item in a slot may take something away from a cell."""
    reaches = False
    for part in range(len(room.corners)):
        reaches |= room.lines[room.corners[part, cell] - slot] != 0
    return reaches
