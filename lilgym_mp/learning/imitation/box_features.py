"""Distinct boxes by index with precomputed input features, so that features are computed once per box."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.learning.common.boxes import GAP_BINS, ITEM_SIDES, FeatureTable, gap_features
from lilgym_mp.scene import BOX_SIDE, FOOTPRINT_COUNT, Box, Scene
from lilgym_mp.scene.appearances.scatter.cell_places import legal_edits
from lilgym_mp.scene.arrays import BoolArray, Int16Array, Int64Array, UInt8Array, one_hot

CELL = 20  # pixels: side of a cell of the released grid
CELLS = BOX_SIDE // CELL  # a side of a box, in cells
DISTANCE_BOUNDS = np.array([2, 5, 10, 20])  # bin edges of the distance between two items, in pixels
RELATIONS = 3 * 3 * (len(DISTANCE_BOUNDS) + 1)  # horizontal direction, vertical direction, distance bin
MAX_OFFSET = 40  # pixels from an item to a cell; larger offsets are clipped
OFFSETS = 2 * MAX_OFFSET + 1
FIXED_FEATURES = 3 + 3 + 4 * GAP_BINS + 2 * CELLS  # shape, size, wall gaps, cell; not the colour


class BoxFeatureTable(FeatureTable):
    """A growing table of N distinct boxes, with capacity for K items each."""

    counts: Int64Array  # (N,)
    features: UInt8Array  # (N, K, F) binary
    colours: Int64Array  # (N, K)
    relations: UInt8Array  # (N, K, K) of the second item to the first
    offsets: Int16Array  # (N, K, 2, 5) see `cell_offsets`
    legal: BoolArray  # (N, 25, 9 + 1) whether the ADD of each footprint, and REMOVE, is legal in each cell

    def __init__(self, appearance: str | None = None) -> None:
        super().__init__(8, appearance)

    def indices(self, scenes: Sequence[Scene]) -> Int64Array:
        """(B, 3) box indices."""
        return np.array([self.of(scene) for scene in scenes], np.int64).reshape(-1, 3)

    def columns(self, boxes: Sequence[Box], items: Int64Array) -> dict[str, NDArray[Any]]:
        legal = np.array([legal_edits(box.items, (CELL, CELL), searches=True) for box in boxes])
        return {
            "counts": (items[:, :, 2] >= 0).sum(1),
            "features": item_features(items),
            "colours": items[:, :, 3].clip(0),
            "relations": item_relations(items),
            "offsets": cell_offsets(items),
            "legal": (legal[..., None] >> np.arange(FOOTPRINT_COUNT + 1) & 1).astype(bool),
        }


def item_features(items: Int64Array) -> UInt8Array:
    """(N, K, F) features of each item except its colour, from (N, K, 5) items padded with -1."""
    x, y, shape, _, size = (items[..., field] for field in range(5))
    parts = [
        one_hot(shape, 3),
        one_hot(size, 3),
        gap_features(items),
        one_hot((x.clip(0) // CELL).clip(0, CELLS - 1), CELLS),
        one_hot((y.clip(0) // CELL).clip(0, CELLS - 1), CELLS),
    ]
    return np.concatenate(parts, axis=-1) * (shape >= 0)[..., None].astype(np.uint8)


def item_relations(items: Int64Array) -> UInt8Array:
    """(N, K, K) the second item's relation to the first: horizontal and vertical direction, and distance bin."""
    x = items[..., 0]
    y = items[..., 1]
    side = ITEM_SIDES[items[..., 4]]
    horizontal, gap_x = _direction(x, side)
    vertical, gap_y = _direction(y, side)
    distance = np.digitize(np.maximum(gap_x, gap_y), DISTANCE_BOUNDS)
    relations = (horizontal * 3 + vertical) * (len(DISTANCE_BOUNDS) + 1) + distance
    return relations.astype(np.uint8)


def _direction(start: Int64Array, side: Int64Array) -> tuple[Int64Array, Int64Array]:
    """(N, K, K) 0 before, 1 overlapping, 2 after along one axis; and the gap in pixels, negative if overlapping."""
    end = start + side
    before = start[:, :, None] - end[:, None, :]  # second item ends before the first starts
    after = start[:, None, :] - end[:, :, None]
    gap = np.maximum(before, after)
    return np.where(before >= 0, 0, np.where(after >= 0, 2, 1)), gap


def cell_offsets(items: Int64Array) -> Int16Array:
    """(N, K, 2, 5) embedding index of footprint and offset to each cell column, then each row; 0 without an item."""
    footprint = items[..., 2] * 3 + items[..., 4]
    corners = np.arange(CELLS) * CELL
    offsets = (items[..., :2, None] - corners).clip(-MAX_OFFSET, MAX_OFFSET) + MAX_OFFSET
    indices = 1 + footprint[..., None, None] * OFFSETS + offsets
    return np.where((footprint >= 0)[..., None, None], indices, 0).astype(np.int16)
