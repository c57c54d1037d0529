"""Masks of many Scatter scenes at once, kept up to date cell by cell."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lilgym_mp.appearances import PlacementRules, Scatter
from lilgym_mp.appearances.placement import LARGEST_SIDE
from lilgym_mp.appearances.scatter import LOOK_KINDS, LOOKS
from lilgym_mp.envs.block import BoolArray, Int64Array
from lilgym_mp.envs.scatter_room import REMOVABLE, cell_room
from lilgym_mp.envs.scatter_tables import EMPTY_SLOT, PLACE_PITCH, packed
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, Item

MOST_CELLS = 16_384  # looked at together: what is known of them on the way takes some megabytes
NOT_SHOWN = EMPTY_SLOT - 1  # in place of a slot
_EDITS = np.arange(2 * REMOVABLE)
_ADDS = (_EDITS[:, None] >> LOOK_KINDS & 1).astype(np.bool_).view(f"V{len(LOOKS)}")[:, 0]  # by a cell's legal edits
_REMOVES = (_EDITS & REMOVABLE) != 0  # likewise

Items = tuple[Item, ...]


class ScatterMasks:
    """Keeps masks equal to `Scatter.legal_mask`. An added item changes the cells that it reaches, and no others.

    Boxes have the numbers 3 * environment + box.
    """

    def __init__(self, appearance: Scatter, rules: PlacementRules, masks: BoolArray) -> None:
        """`masks` (N, actions) are written in `refresh` only; until then they may be anything."""
        self._room = cell_room(*appearance.cell, searches=appearance.searches(rules))
        self._boxes_at_once = -(-MOST_CELLS // self._room.cell_count)
        columns, rows = appearance.grid
        first_remove = 1 + columns * rows * len(LOOKS)
        masks[:] = False
        masks[:, 0] = True
        self._adds = masks[:, 1:first_remove].view(_ADDS.dtype)  # (N, cells of the grid)
        self._removes = masks[:, first_remove:]  # likewise
        self._first_cells = np.array([removes.start - first_remove for _, removes in appearance.box_numbers])
        # What the masks are of, as `refresh` was told; of no box at first.
        self._slots = np.empty((0, 0), np.int64)
        self._counts = np.zeros(BOX_COUNT * len(masks), np.int64)
        self._loose: Mapping[int, Items] = {}

    def refresh(self, slots: Int64Array, counts: Int64Array, loose: Mapping[int, Items]) -> None:
        """Makes the masks those of the boxes.

        slots: (3 N, slots) the items by `scatter_tables.packed`, from the left in their order; EMPTY_SLOT beyond
        `counts` (3 N,). Only read.
        loose: by box, the items of those that `slots` and `counts` do not tell of.
        """
        if self._slots.shape != slots.shape:
            self._counts[:] = slots.shape[1]
            self._slots = np.full(slots.shape, NOT_SHOWN)
        if loose:
            slots, counts = self._with_loose(slots, counts, loose)
        differing = (slots != self._slots).ravel().nonzero()[0]
        changes = np.bincount(differing // slots.shape[1], minlength=len(slots))
        boxes = changes.nonzero()[0]
        # Where one slot differs and there is one item more, the last item is new and the others are as they were.
        grown = (changes[boxes] == 1) & (counts[boxes] == self._counts[boxes] + 1)
        for first in range(0, len(boxes), self._boxes_at_once):
            some = slice(first, first + self._boxes_at_once)
            self._renew(boxes[some], grown[some], slots.take(boxes[some], axis=0), counts[boxes[some]])
        # In an order in which an interrupt does no harm.
        self._counts[boxes] = counts[boxes]
        self._slots[boxes] = slots.take(boxes, axis=0)
        self._loose = dict(loose)

    def _with_loose(
        self, slots: Int64Array, counts: Int64Array, loose: Mapping[int, Items]
    ) -> tuple[Int64Array, Int64Array]:
        """Slots and counts that tell of all boxes' items, but for those that do not reach into their box."""
        slots, counts = slots.copy(), counts.copy()
        known = [box for box, items in loose.items() if items is self._loose.get(box)]
        slots[known], counts[known] = self._slots[known], self._counts[known]
        for box in loose.keys() - set(known):
            there = _slots_of(loose[box])
            counts[box] = len(there)
            slots[box] = EMPTY_SLOT
            slots[box, : len(there)] = there
        return slots, counts

    def _renew(self, boxes: Int64Array, grown: BoolArray, slots: Int64Array, counts: Int64Array) -> None:
        """Writes the masks of `boxes` (k,), which have `slots` (k, slots); `grown` (k,): only the last item is new."""
        order = (-counts).argsort()
        boxes, slots, counts = boxes[order], slots.take(order, axis=0), counts[order]
        changed = np.ones((len(boxes), self._room.cell_count), np.bool_)
        growing = grown[order].nonzero()[0]
        changed[growing] = self._room.reached(slots[growing, counts[growing] - 1])
        places, cells = np.divmod(changed.ravel().nonzero()[0], self._room.cell_count)
        edits = self._room.legal_edits(slots, counts, places, cells)
        environments, numbers = np.divmod(boxes, BOX_COUNT)
        written = environments[places], self._first_cells[numbers][places] + cells
        self._adds[written] = _ADDS.take(edits)
        self._removes[written] = _REMOVES.take(edits)


def _slots_of(items: Items) -> Int64Array:
    """(k,) what slots would hold of those that reach into the box, wherever they lie."""
    reaching = [item for item in items if min(item.x, item.y) > -LARGEST_SIDE and max(item.x, item.y) < BOX_SIDE]
    kinds = np.array([item.kind for item in reaching], np.int64)
    return packed(kinds, np.array([item.x * PLACE_PITCH + item.y for item in reaching], np.int64))
