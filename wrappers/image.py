"""The image alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

from gymnasium import spaces

from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import IMAGE, Batch, EnvDescription, EnvState, Transformation


class Image(Transformation):
    """Drops everything but the image."""

    changes_observations = True

    def __init__(self, description: EnvDescription) -> None:
        super().__init__(description)
        self._space = cast("spaces.Box", description.part(IMAGE))

    def observation_space(self) -> spaces.Box:
        return self._space

    def observations(self, observations: Mapping[str, Batch], state: EnvState) -> Batch:
        return observations[IMAGE]


class ImageObservation(EnvWrapper[Image]):
    """Replaces the observation by "image" alone, for policies that take one image, such as SB3's "CnnPolicy".

    The statement and the target are left out, so that the agent does not see its task: a baseline at best.
    """

    transformation_class = Image
