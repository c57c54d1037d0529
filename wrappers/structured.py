"""The scene as an array of items."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.arrays import Int16Array
from lilgym_mp.observation import EMPTY
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, Colour, Shape, Size
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import ITEMS, Batch, EnvDescription, EnvState, SceneFormat

PRESENT = "present"  # observation key
MARGIN = 10  # pixels; the release's snapping may move an item slightly out of its box


class Items(SceneFormat):
    """The item array and a mask of its filled slots."""

    def __init__(self, description: EnvDescription, *, keep_image: bool, slots: int | None) -> None:
        """Raises ValueError for fewer slots than a box can have items."""
        super().__init__(description, keep_image=keep_image)
        needed = description.item_capacity
        if slots is not None and slots < needed:
            raise ValueError(f"slots must be at least {needed}, the most items a box can have here, not {slots}")
        self._shape = (BOX_COUNT, slots or needed)

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        low = self._fields([-MARGIN, -MARGIN, EMPTY, EMPTY, EMPTY])
        high = self._fields([BOX_SIDE + MARGIN, BOX_SIDE + MARGIN, max(Shape), max(Colour), max(Size)])
        return {ITEMS: spaces.Box(low, high, dtype=np.int16), PRESENT: spaces.Box(0, 1, self._shape, np.int8)}

    def _fields(self, values: list[int]) -> Int16Array:
        """(3, capacity, 5) the five values in every slot."""
        return np.broadcast_to(np.array(values, np.int16), (*self._shape, len(values)))

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        items = state.items
        if missing := self._shape[1] - items.shape[2]:
            items = np.pad(items, ((0, 0), (0, 0), (0, missing), (0, 0)), constant_values=EMPTY)
        return {ITEMS: items, PRESENT: (items[..., -1] != EMPTY).astype(np.int8)}


class StructuredObservation(EnvWrapper[Items]):
    """Replaces "image" by an item array.

    "item_array": int16 (3, C, 5), by box, left to right, each item's x, y (pixels from the box's top-left corner),
    shape, colour and size, in the order added, -1 in empty slots. C, the most items a box can have, depends on the
    split and the horizon; `slots` sets a larger one. "present": int8 (3, C), 1 for filled slots. `keep_image` keeps
    "image" as well.
    """

    transformation_class = Items

    def __init__(self, env: gym.Env[Any, Any], *, keep_image: bool = False, slots: int | None = None) -> None:
        super().__init__(env, keep_image=keep_image, slots=slots)
