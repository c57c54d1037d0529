"""Distinct boxes by index, and arrays of their items and features."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.envs.observation import item_arrays
from lilgym_mp.scene import BOX_SIDE, SIZE_PIXELS, Box, Item, Scene
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.scene.appearances.base import optional
from lilgym_mp.scene.arrays import Int64Array, UInt8Array, one_hot

GAP_BOUNDS = np.array([1, 5, 9, 20, 40, 60])  # bin edges of the gap to a wall, in pixels
GAP_BINS = len(GAP_BOUNDS) + 1
ITEM_SIDES = np.array([*SIZE_PIXELS, 0])  # in pixels, by size; 0 for the -1 of an empty slot


class BoxIndex:
    """A growing list of distinct boxes; of an appearance with few, it begins with `every_box` of them.

    `distances`: (B, B) edits from each of these to each, None without.
    """

    def __init__(self, appearance: str | None = None) -> None:
        self._indices: dict[tuple[Item, ...], int] = {}
        self.boxes: list[Box] = []
        known = None if appearance is None else optional(make_appearance(appearance), "every_box")
        self.distances: Int64Array | None = None
        if known is not None:
            self.distances = known.distances
            for box in known.boxes:  # so that `distances` has their indices
                self.index(box)

    def __len__(self) -> int:
        return len(self.boxes)

    def index(self, box: Box) -> int:
        """The box's index; a new box is appended."""
        found = self._indices.get(box.items)
        if found is None:
            found = self._indices[box.items] = len(self.boxes)
            self.boxes.append(box)
        return found

    def of(self, scene: Scene) -> tuple[int, int, int]:
        """The indices of the scene's boxes."""
        left, middle, right = scene.boxes
        return self.index(left), self.index(middle), self.index(right)

    def scene(self, boxes: Sequence[int]) -> Scene:
        """The scene of three boxes by index."""
        return Scene.of_boxes(self.boxes[index] for index in boxes)


class FeatureTable(BoxIndex, ABC):
    """A growing table of distinct boxes with arrays of their features, computed once per box; K items fit in a box."""

    def __init__(self, item_capacity: int, appearance: str | None = None) -> None:
        super().__init__(appearance)
        self.item_capacity = item_capacity
        self._updated = 0  # boxes with features

    @abstractmethod
    def columns(self, boxes: Sequence[Box], items: Int64Array) -> Mapping[str, NDArray[Any]]:
        """The rows of the arrays, which are attributes, by name, of boxes that hold these items (n, K, 5)."""

    def update_features(self) -> None:
        """Computes the features of boxes added since the last call; call it before reading the arrays."""
        new = self.boxes[self._updated :]
        if not new:
            return
        most = max(len(box.items) for box in new)
        if most > self.item_capacity:  # all again, in larger arrays
            self.item_capacity = most
            self._updated = 0
            new = self.boxes
        for name, rows in self.columns(new, item_arrays(new, self.item_capacity).astype(np.int64)).items():
            setattr(self, name, np.concatenate([getattr(self, name), rows]) if self._updated else rows)
        self._updated = len(self.boxes)


def gap_features(items: Int64Array) -> UInt8Array:
    """(..., 4 * GAP_BINS) one-hot bins of the gaps between items (..., 5) and the four walls, left and right first."""
    sides = ITEM_SIDES[items[..., 4]]
    gaps = (gap for start in (items[..., 0], items[..., 1]) for gap in (start, BOX_SIDE - start - sides))
    return np.concatenate([one_hot(np.digitize(gap, GAP_BOUNDS), GAP_BINS) for gap in gaps], axis=-1)
