"""Images at native size."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.observation import image_space
from lilgym_mp.render import draw
from lilgym_mp.wrappers.env_state import IMAGE, EnvDescription, EnvState, scene_of
from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.scene_format import SceneFormat
from lilgym_mp.wrappers.transformation import Batch

SIZE = "native"


class NativeDrawing(SceneFormat):
    """Draws the scene."""

    def __init__(self, description: EnvDescription) -> None:
        super().__init__(description, keep_image=False)

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        return {IMAGE: image_space(SIZE)}

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        return {IMAGE: np.stack([draw(scene_of(items), SIZE) for items in state.items])}


class NativeImage(EnvWrapper[NativeDrawing]):
    """Replaces "image" by one of native size, uint8 (100, 380, 3).

    It redraws the whole scene each time. An environment made with image_size="native" is faster: it redraws only what
    has changed.
    """

    transformation_class = NativeDrawing

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)


native_image_v0 = factory(NativeImage)
