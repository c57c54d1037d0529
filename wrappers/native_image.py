"""Images at native size."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from lilgym_mp.observation import image_space
from lilgym_mp.render import draw
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import IMAGE, Batch, EnvDescription, EnvState, SceneFormat

SIZE = "native"


class NativeDrawing(SceneFormat):
    """Draws the scene."""

    def __init__(self, description: EnvDescription) -> None:
        super().__init__(description, keep_image=False)

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        return {IMAGE: image_space(SIZE)}

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        return {IMAGE: np.stack([draw(each.scene, SIZE) for each in state.states()])}


class NativeImage(EnvWrapper[NativeDrawing]):
    """Replaces "image" by one of native size, uint8 (100, 380, 3).

    It redraws the whole scene each time. An environment made with image_size="native" is faster: it redraws only what
    has changed.
    """

    transformation_class = NativeDrawing
