"""Distinct boxes by index, with what the network reads of their items as arrays, so that each is described once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances.legality import box_legality
from lilgym_mp.scene import BOX_SIDE, FOOTPRINT_COUNT, Box, Item, Scene

CELL = 20  # pixels: side of a cell of the released grid
CELLS = BOX_SIDE // CELL  # a side of a box, in cells
GAP_BOUNDS = np.array([1, 5, 9, 20, 40, 60])  # pixels to a wall: bounds of the bins
GAP_BINS = len(GAP_BOUNDS) + 1
DISTANCE_BOUNDS = np.array([2, 5, 10, 20])  # pixels between two items: bounds of the bins
RELATIONS = 3 * 3 * (len(DISTANCE_BOUNDS) + 1)  # direction across, direction down, distance
REACH = 40  # pixels: beyond it, how far a cell is from an item makes no difference
OFFSETS = 2 * REACH + 1
FIXED_FEATURES = 3 + 3 + 4 * GAP_BINS + 2 * CELLS  # shape, size, gaps to the walls, place: all but the colour


class BoxFeatureTable:
    """A growing table of distinct boxes; N of them so far, with room for K items each."""

    def __init__(self, item_room: int = 4) -> None:
        self._indices: dict[tuple[Item, ...], int] = {}
        self.boxes: list[Box] = []
        self.item_room = item_room
        self.counts = np.zeros(0, np.int64)  # (N,)
        self.features = np.zeros((0, item_room, FIXED_FEATURES), np.uint8)  # (N, K, F) ones where a feature is there
        self.colours = np.zeros((0, item_room), np.int64)  # (N, K)
        self.relations = np.zeros((0, item_room, item_room), np.uint8)  # (N, K, K) of each item to each
        self.offsets = np.zeros((0, item_room, 2, CELLS), np.int16)  # (N, K, 2, 5) as `cell_offsets`
        self.legal = np.zeros(
            (0, CELLS * CELLS, FOOTPRINT_COUNT + 1), np.bool_
        )  # (N, 25, 9 + 1) ADD of each footprint, REMOVE
        self._legality = box_legality(CELL, CELL, searches=True)

    def __len__(self) -> int:
        return len(self.boxes)

    def index(self, box: Box) -> int:
        """The box's index; a new one for a box not seen before."""
        found = self._indices.get(box.items)
        if found is None:
            found = self._indices[box.items] = len(self.boxes)
            self.boxes.append(box)
        return found

    def indices(self, scenes: Sequence[Scene]) -> NDArray[np.int64]:
        """(B, 3) the boxes' indices."""
        return np.array([[self.index(box) for box in scene.boxes] for scene in scenes], np.int64).reshape(-1, 3)

    def describe(self) -> None:
        """Fills the arrays for boxes that came since; to be called before the arrays are read."""
        first, total = len(self.counts), len(self.boxes)
        if first == total:
            return
        new = self.boxes[first:]
        self._widen(max(len(box.items) for box in new))
        items = np.full((len(new), self.item_room, len(Item._fields)), -1, np.int64)
        for row, box in zip(items, new, strict=True):
            if box.items:
                row[: len(box.items)] = box.items
        counts = (items[:, :, 2] >= 0).sum(1)
        legal = np.stack([self._legal(box) for box in new])
        self.counts = np.concatenate([self.counts, counts])
        self.features = np.concatenate([self.features, item_features(items)])
        self.colours = np.concatenate([self.colours, items[:, :, 3].clip(0)])
        self.relations = np.concatenate([self.relations, item_relations(items)])
        self.offsets = np.concatenate([self.offsets, cell_offsets(items)])
        self.legal = np.concatenate([self.legal, legal])

    def _legal(self, box: Box) -> NDArray[np.bool_]:
        adds = self._legality.addable(box.items).reshape(CELLS * CELLS, FOOTPRINT_COUNT)
        return np.concatenate([adds, self._legality.removable(box.items).reshape(-1, 1)], axis=1)

    def _widen(self, most_items: int) -> None:
        """Makes room for boxes of so many items."""
        extra = most_items - self.item_room
        if extra <= 0:
            return
        self.item_room = most_items
        self.features = np.pad(self.features, ((0, 0), (0, extra), (0, 0)))
        self.colours = np.pad(self.colours, ((0, 0), (0, extra)))
        self.relations = np.pad(self.relations, ((0, 0), (0, extra), (0, extra)))
        self.offsets = np.pad(self.offsets, ((0, 0), (0, extra), (0, 0), (0, 0)))


def item_features(items: NDArray[np.int64]) -> NDArray[np.uint8]:
    """(N, K, F) what is known of each item alone but its colour, from (N, K, 5) items with -1 for none."""
    x, y, shape, _, size = (items[..., field] for field in range(5))
    side = 10 * (size + 1)
    gaps = (x, BOX_SIDE - x - side, y, BOX_SIDE - y - side)
    parts = [
        _one_hot(shape, 3),
        _one_hot(size, 3),
        *(_one_hot(np.digitize(gap, GAP_BOUNDS), GAP_BINS) for gap in gaps),
        _one_hot((x.clip(0) // CELL).clip(0, CELLS - 1), CELLS),
        _one_hot((y.clip(0) // CELL).clip(0, CELLS - 1), CELLS),
    ]
    return np.concatenate(parts, axis=-1) * (shape >= 0)[..., None].astype(np.uint8)


def item_relations(items: NDArray[np.int64]) -> NDArray[np.uint8]:
    """(N, K, K) where the second item lies seen from the first: across, down, and how far."""
    x, y, side = items[..., 0], items[..., 1], 10 * (items[..., 4] + 1)
    across, gap_x = _direction(x, side)
    down, gap_y = _direction(y, side)
    distance = np.digitize(np.maximum(gap_x, gap_y), DISTANCE_BOUNDS)
    relations = (across * 3 + down) * (len(DISTANCE_BOUNDS) + 1) + distance
    return relations.astype(np.uint8)


def _direction(start: NDArray[np.int64], side: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(N, K, K) 0 before, 1 overlapping, 2 behind along one axis; and the gap in pixels, negative when overlapping."""
    end = start + side
    before = start[:, :, None] - end[:, None, :]  # the second ends before the first begins
    behind = start[:, None, :] - end[:, :, None]
    gap = np.maximum(before, behind)
    return np.where(before >= 0, 0, np.where(behind >= 0, 2, 1)), gap


def cell_offsets(items: NDArray[np.int64]) -> NDArray[np.int16]:
    """(N, K, 2, 5) footprint and distance to each column of cells, then row, as one index; 0 where there is no item."""
    footprint = items[..., 2] * 3 + items[..., 4]
    corners = np.arange(CELLS) * CELL
    offsets = (items[..., :2, None] - corners).clip(-REACH, REACH) + REACH
    indices = 1 + footprint[..., None, None] * OFFSETS + offsets
    return np.where((footprint >= 0)[..., None, None], indices, 0).astype(np.int16)


def _one_hot(values: NDArray[np.int64], count: int) -> NDArray[np.uint8]:
    return (values[..., None] == np.arange(count)).astype(np.uint8)
