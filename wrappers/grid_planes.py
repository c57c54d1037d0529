"""The scene as feature planes over a grid."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from lilgym_mp.appearances import RELEASED_GRID
from lilgym_mp.arrays import Int64Array
from lilgym_mp.observation import EMPTY
from lilgym_mp.scene import (
    BOX_PITCH,
    IMAGE_HEIGHT,
    IMAGE_WIDTH,
    SIZE_PIXELS,
    Colour,
    Shape,
    Size,
)
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import PLANES, Batch, EnvDescription, EnvState, SceneFormat

OCCUPANCY = len(Shape) + len(Colour) + len(Size)  # index of the last plane
PLANE_COUNT = OCCUPANCY + 1

_FIRST_PLANES = np.array([0, len(Shape), len(Shape) + len(Colour)])  # first plane of shape, colour and size
_SIDES = np.array(SIZE_PIXELS)
_CORNER_SIGNS = (1, -1, -1, 1)


class Planes(SceneFormat):
    """Item counts by shape, colour and size, and an occupancy plane."""

    def __init__(self, description: EnvDescription, *, keep_image: bool) -> None:
        super().__init__(description, keep_image=keep_image)
        self.columns, self.rows = description.dynamics.appearance.grid or RELEASED_GRID
        self._cell = np.array([IMAGE_WIDTH // self.columns, IMAGE_HEIGHT // self.rows])  # width and height in pixels

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        high = np.full((PLANE_COUNT, self.rows, self.columns), self.env_description.item_capacity, np.uint8)
        high[OCCUPANCY] = 1
        return {PLANES: spaces.Box(np.zeros_like(high), high, dtype=np.uint8)}

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        items = state.items
        batch, box, slot = np.nonzero(items[..., -1] != EMPTY)
        here = items[batch, box, slot].astype(np.int64)  # (items, 5)
        sides = _SIDES[here[:, 4]]
        corners = here[:, :2] + np.stack([box * BOX_PITCH, np.zeros_like(box)], axis=1)  # (items, 2) on the image
        planes = self._count_planes(len(items), batch, here[:, 2:], self._cells(corners + sides[:, None] // 2))
        first, last = self._cells(corners), self._cells(corners + sides[:, None] - 1)
        planes[:, OCCUPANCY] = self._occupancy(len(items), batch, first, last)
        return {PLANES: planes}

    def _cells(self, pixels: Int64Array) -> Int64Array:
        """(items, 2) column and row of each pixel, clipped to the grid."""
        return np.clip(pixels // self._cell, 0, [self.columns - 1, self.rows - 1])

    def _count_planes(
        self, size: int, batch: Int64Array, item_types: Int64Array, cells: Int64Array
    ) -> NDArray[np.uint8]:
        """(size, planes, rows, columns) numbers of items of each shape, colour and size centred in each cell."""
        shape = (size, PLANE_COUNT, self.rows, self.columns)
        column, row = cells[:, :1], cells[:, 1:]
        indices = (
            (batch[:, None] * PLANE_COUNT + _FIRST_PLANES + item_types) * self.rows + row
        ) * self.columns + column
        return np.bincount(indices.ravel(), minlength=math.prod(shape)).astype(np.uint8).reshape(shape)

    def _occupancy(self, size: int, batch: Int64Array, first: Int64Array, last: Int64Array) -> NDArray[np.bool_]:
        """(size, rows, columns) the cells that overlap an item's bounding square."""
        # Summed-area trick: +1 and -1 at each rectangle's corners; cumulative sums along both axes fill it.
        shape = (size, self.rows + 1, self.columns + 1)
        rows = np.stack([first[:, 1], first[:, 1], last[:, 1] + 1, last[:, 1] + 1])
        columns = np.stack([first[:, 0], last[:, 0] + 1, first[:, 0], last[:, 0] + 1])
        indices = (batch * shape[1] + rows) * shape[2] + columns
        signs = np.repeat(_CORNER_SIGNS, len(batch))
        corners = np.bincount(indices.ravel(), signs, math.prod(shape)).reshape(shape)
        return corners.cumsum(1).cumsum(2)[:, :-1, :-1] > 0.5


class GridPlanes(EnvWrapper[Planes]):
    """Replaces "image" by "planes": uint8 (10, rows, columns) over Scatter's grid, 5 x 19 for Tower.

    Planes 0 .. 2 count the circles, squares and triangles centred in each cell, 3 .. 5 the yellow, black and blue
    items, 6 .. 8 the small, medium and large ones. Plane 9 is 1 where an item's bounding square overlaps the cell.
    `keep_image` keeps "image" as well.
    """

    transformation_class = Planes

    def __init__(self, env: gym.Env[Any, Any], *, keep_image: bool = False) -> None:
        super().__init__(env, keep_image=keep_image)
