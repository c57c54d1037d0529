"""Channels-first images, for PyTorch's convolutions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import IMAGE, Batch, EnvDescription, EnvState, Format


class Channels(Format):
    """Moves the image's last axis to the front."""

    def __init__(self, description: EnvDescription) -> None:
        super().__init__(description)
        self._shape: tuple[int, ...] = description.part(IMAGE).shape or ()

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        return {IMAGE: spaces.Box(0, 255, (self._shape[-1], *self._shape[:-1]), np.uint8)}

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        return {IMAGE: np.moveaxis(observations[IMAGE], -1, 1)}


class ChannelsFirst(EnvWrapper[Channels]):
    """Turns "image" from (height, width, 3) into (3, height, width), a view of the same pixels."""

    transformation_class = Channels
