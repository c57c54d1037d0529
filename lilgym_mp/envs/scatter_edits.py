"""Edits of many Scatter scenes at once, by array operations over the tables that the appearance itself reads.

What array operations do not settle (a search in the cell, a tie between nearest points) is left to the appearance's own
functions, one at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances import InvalidReason, PlacementRules, Scatter
from lilgym_mp.appearances.placement import FIRST_TOO_FAR, placement_tables, searched
from lilgym_mp.appearances.scatter import LOOKS
from lilgym_mp.envs.block import NO_REASON, REASON_NUMBERS, BoolArray, Int64Array
from lilgym_mp.envs.scatter_painter import TAKEN, Change, ScatterPainter
from lilgym_mp.envs.scatter_tables import (
    EMPTY_SLOT,
    KINDS,
    NO_KIND,
    PLACE_PITCH,
    SAME_PLACE,
    TIED,
    area_ranks,
    geometry,
    in_box,
    origins,
    packed,
)
from lilgym_mp.render import UInt8Array
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, Item, Scene

KEPT_ITEMS = 16_384
NO_ITEM = -1
LOOSE = -2  # instead of a reason: valid, but the item comes to rest over another or out of the box
ON_SEPARATOR, OUT_OF_BOX, OVERLAP, NOTHING_TO_REMOVE = (
    REASON_NUMBERS[reason]
    for reason in (
        InvalidReason.SEPARATOR,
        InvalidReason.OUT_OF_BOX,
        InvalidReason.OVERLAP,
        InvalidReason.NOTHING_TO_REMOVE,
    )
)


class Boxes(NamedTuple):
    """The boxes of N environments, by row, which is 3 * environment + box.

    A box is a row of slots (`scatter_tables.Geometry`), items from the left in their order, the last always empty.
    """

    slots: Int64Array  # (3 N, slots)
    items: Int64Array  # (3 N, slots) place * 27 + look of what the slots hold, or NO_ITEM
    counts: Int64Array  # (3 N,) how many items there are
    kept: Int64Array  # (3 N,) how many of them, from the left, are still those of the `Scene` made last

    @classmethod
    def empty(cls, rows: int, slots: int) -> Boxes:
        return cls(
            slots=np.full((rows, slots), EMPTY_SLOT),
            items=np.full((rows, slots), NO_ITEM),
            counts=np.zeros(rows, np.int64),
            kept=np.zeros(rows, np.int64),
        )

    def by_environment(self) -> Boxes:
        """The same memory as (N, 3, ...)."""
        slots, items, counts, kept = self
        shape = -1, BOX_COUNT
        return Boxes(
            slots.reshape(*shape, slots.shape[1]),
            items.reshape(*shape, slots.shape[1]),
            counts.reshape(shape),
            kept.reshape(shape),
        )


class Edits(Protocol):
    """Who changes boxes and keeps the images equal to `draw` of them, as long as no items draw a pixel in common."""

    def begin(self, numbers: Int64Array, starts: Boxes, tasks: Int64Array, scenes: Sequence[Scene]) -> None:
        """Makes the boxes of environments (k,) those of tasks (k,) in `starts`, which are `scenes` that add up."""
        ...

    def edit(self, numbers: Int64Array, actions: Int64Array, applies: BoolArray, loose: BoolArray) -> Int64Array:
        """(k,) why actions of environments (k,) are invalid, NO_REASON also for STOP, or LOOSE.

        Those that are valid and apply are done, but for those that are LOOSE, as all are in environments that are
        `loose` (N,) already.
        """
        ...


EditsMaker = Callable[[Scatter, PlacementRules, Boxes, UInt8Array, str], Edits]  # images (N, ...), and their size


class Cells(NamedTuple):
    """The cells of the grid, by number."""

    count: int
    boxes: Int64Array  # (cells,); some box or other for a separator's
    places: Int64Array  # (cells,) of the top-left pixel in the box
    add_reasons: Int64Array  # (9 * cells,) by kind: why nothing can be added, whatever is there, or NO_REASON
    remove_reasons: Int64Array  # (cells,) likewise

    @classmethod
    def of(cls, appearance: Scatter) -> Cells:
        columns, rows = appearance.grid
        width, height = appearance.cell
        boxes, xs = (numbers.repeat(rows) for numbers in np.divmod(np.arange(columns) * width, BOX_PITCH))
        on_separator = xs >= BOX_SIDE
        places = np.where(on_separator, 0, xs * PLACE_PITCH + np.tile(np.arange(rows) * height, columns))
        fits = in_box(np.arange(NO_KIND)[:, None], places)
        add_reasons = np.where(on_separator, ON_SEPARATOR, np.where(fits, NO_REASON, OUT_OF_BOX))
        remove_reasons = np.where(on_separator, ON_SEPARATOR, NO_REASON)
        return cls(len(boxes), boxes, places, add_reasons.ravel(), remove_reasons)


class _Adds(NamedTuple):
    """ADDs, one an environment. All arrays (k,)."""

    rows: Int64Array  # 3 * environment + box
    looks: Int64Array  # in LOOKS
    kinds: Int64Array
    places: Int64Array  # of the cells' top-left pixels


class ArrayEdits:
    """`Edits` by NumPy."""

    def __init__(
        self, appearance: Scatter, rules: PlacementRules, boxes: Boxes, images: UInt8Array, image_size: str
    ) -> None:
        self._rules = rules
        self._boxes = boxes
        self._by_environment = boxes.by_environment()
        self._flat_slots, self._flat_items = boxes.slots.reshape(-1), boxes.items.reshape(-1)
        self._painter = ScatterPainter(images, image_size)
        self._cell = appearance.cell
        self._cells = Cells.of(appearance)
        self._first_remove = 1 + self._cells.count * len(LOOKS)
        self._searches = appearance.searches(rules)
        self._snaps = not appearance.is_native
        self._area_ranks = area_ranks(*appearance.cell)

    def begin(self, numbers: Int64Array, starts: Boxes, tasks: Int64Array, scenes: Sequence[Scene]) -> None:
        for begun, boxes in zip(starts.by_environment(), self._by_environment, strict=True):
            boxes[numbers] = begun.take(tasks, 0)
        self._painter.show(numbers, scenes)

    def edit(self, numbers: Int64Array, actions: Int64Array, applies: BoolArray, loose: BoolArray) -> Int64Array:
        stops = actions == 0
        reasons = np.full(len(numbers), LOOSE)
        reasons[stops] = NO_REASON
        follows = ~(stops | loose[numbers])
        removes = actions >= self._first_remove
        changes: list[Change] = []
        for chosen, take in ((follows & ~removes, self._add), (follows & removes, self._remove)):
            edits = chosen.nonzero()[0]
            if len(edits):
                reasons[edits], change = take(numbers[edits], actions[edits], applies[edits])
                changes.append(change)
        if changes:
            self._painter.change(changes)
        return reasons

    def _add(self, numbers: Int64Array, actions: Int64Array, applies: BoolArray) -> tuple[Int64Array, Change]:
        """(k,) why ADDs are invalid. Those that are valid and apply are done, but for the change in the picture."""
        cells, looks = np.divmod(actions - 1, len(LOOKS))
        kinds = KINDS.take(looks)
        rows = numbers * BOX_COUNT + self._cells.boxes.take(cells)
        adds = _Adds(rows, looks, kinds, self._cells.places.take(cells))
        reasons = self._cells.add_reasons.take(kinds * self._cells.count + cells)
        self._land(adds, reasons)
        done = (applies & (reasons == NO_REASON)).nonzero()[0]
        rows, looks, kinds, places = (array[done] for array in adds)
        free = rows * self._boxes.slots.shape[1] + self._boxes.counts[rows]
        self._flat_slots[free] = packed(kinds, places)
        self._flat_items[free] = places * len(LOOKS) + looks
        self._boxes.counts[rows] += 1
        return reasons, Change(rows, places, looks)

    def _land(self, adds: _Adds, reasons: Int64Array) -> None:
        """Writes into `adds.places` where items come to rest, and into `reasons` (k,) why they cannot, or LOOSE.

        `reasons` come as those why nothing can be added to the cells, whatever is there.
        """
        rows, _, kinds, places = adds
        clearance = geometry().clearance
        slots = self._boxes.slots.take(rows, 0)[:, : int(self._boxes.counts.take(rows).max()) + 1]
        pairs = origins(kinds, places)[:, None] - slots  # (k, slots) where the tables tell of the new item and each
        codes = clearance.take(pairs)
        blocked = (~_apart(codes) & (reasons == NO_REASON)).nonzero()[0]
        if len(blocked):
            reasons[blocked] = OVERLAP
            if self._searches:
                placed = self._search(adds, blocked)
                reasons[placed] = NO_REASON
                pairs[placed] = origins(kinds[placed], places[placed])[:, None] - slots[placed]
                codes[placed] = clearance.take(pairs[placed])
        near = ((codes.min(1) < FIRST_TOO_FAR) & (reasons == NO_REASON)).nonzero()[0]
        if self._snaps and len(near):
            some = _Adds(*(array[near] for array in adds))
            fits = self._snap(some, pairs[near], codes[near].argmin(1))
            places[near] = some.places
            reasons[near[~fits]] = LOOSE

    def _search(self, adds: _Adds, blocked: Int64Array) -> Int64Array:
        """Looks for a place elsewhere in the cell for the ADDs `blocked`, and writes it. Those that have found one."""
        found: list[int] = []
        rows = adds.rows[blocked]
        parts = adds.kinds[blocked], adds.places[blocked], self._boxes.counts[rows], self._boxes.items[rows]
        kinds, corners, counts, there = (part.tolist() for part in parts)
        for add, kind, corner, count, others in zip(blocked.tolist(), kinds, corners, counts, there, strict=True):
            x, y = divmod(corner, PLACE_PITCH)
            place = searched(kind, x, y, self._cell, map(item_of, others[:count]))
            if place is not None:
                adds.places[add] = place[0] * PLACE_PITCH + place[1]
                found.append(add)
        return np.array(found, np.int64)

    def _snap(self, adds: _Adds, pairs: Int64Array, closest: Int64Array) -> BoolArray:
        """Writes into `adds.places` where items that snap to those in the slots `closest` (k,) come to rest.

        (k,) whether they overlap nothing and lie in the box there. `pairs` as in `_land`.
        """
        rows, _, kinds, places = adds
        moves = geometry().moves.take(pairs[np.arange(len(closest)), closest]).astype(np.int64)
        for tied in (moves == TIED).nonzero()[0].tolist():
            other, row = int(self._boxes.items[rows[tied], closest[tied]]), int(rows[tied])
            moves[tied] = tied_move(int(kinds[tied]), int(places[tied]), other, row % BOX_COUNT, self._rules)
        codes = geometry().clearance.take(pairs + moves[:, None], mode="clip")  # beyond the tables: out of the box
        fits = in_box(kinds, places + moves) & _apart(codes)
        if self._rules.keeps_unfit_snaps:
            places += moves
            return fits
        places += np.where(fits, moves, 0)
        return np.ones(len(fits), np.bool_)

    def _remove(self, numbers: Int64Array, actions: Int64Array, applies: BoolArray) -> tuple[Int64Array, Change]:
        """(k,) why REMOVEs are invalid. Those that are valid and apply are done, but for the change in the picture."""
        cells = actions - self._first_remove
        rows = numbers * BOX_COUNT + self._cells.boxes.take(cells)
        slots = self._boxes.slots.take(rows, 0)
        areas = self._area_ranks.take((SAME_PLACE + self._cells.places.take(cells))[:, None] - slots)
        largest = areas.argmax(1)
        reasons = self._cells.remove_reasons.take(cells)
        reasons[(areas[np.arange(len(largest)), largest] == 0) & (reasons == NO_REASON)] = NOTHING_TO_REMOVE
        done = (applies & (reasons == NO_REASON)).nonzero()[0]
        return reasons, self._take(rows[done], largest[done])

    def _take(self, rows: Int64Array, taken: Int64Array) -> Change:
        """Takes items out of slots `taken` (k,), and moves later ones up."""
        places, looks = np.divmod(self._boxes.items[rows, taken], len(LOOKS))
        sources = np.arange(self._boxes.slots.shape[1] - 1)
        sources = sources + (sources >= taken[:, None])  # (k, slots): where what comes to be in each is now
        self._boxes.slots[rows, :-1] = self._boxes.slots[rows[:, None], sources]
        self._boxes.items[rows, :-1] = self._boxes.items[rows[:, None], sources]
        self._boxes.counts[rows] -= 1
        self._boxes.kept[rows] = np.minimum(self._boxes.kept[rows], taken)
        return Change(rows, places, looks + TAKEN)


def _apart(codes: NDArray[np.uint8]) -> BoolArray:
    """(k,) whether new items overlap nothing, by their clearance codes (k, slots)."""
    return np.asarray(codes.all(1))  # OVERLAPPING is 0


def tied_move(kind: int, place: int, other: int, box: int, rules: PlacementRules) -> int:
    """By how much the place changes of a new item that snaps to the item with the number `other`, where points tie."""
    frame_x = box * BOX_PITCH if rules.rounds_in_image else 0
    move_x, move_y = placement_tables().move(kind, *divmod(place, PLACE_PITCH), item_of(other), frame_x)
    return move_x * PLACE_PITCH + move_y


class _Items(dict[int, Item]):
    """Items by number."""

    def __missing__(self, number: int) -> Item:
        if len(self) >= KEPT_ITEMS:
            self.clear()
        place, look = divmod(number, len(LOOKS))
        item = self[number] = Item(*divmod(place, PLACE_PITCH), *LOOKS[look])
        return item


item_of = _Items().__getitem__
