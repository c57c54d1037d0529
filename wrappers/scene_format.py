"""The base class of alternative encodings of the scene."""

from __future__ import annotations

from lilgym_mp.wrappers.env_state import IMAGE, EnvDescription
from lilgym_mp.wrappers.transformation import Format


class SceneFormat(Format):
    """Replaces the image or adds to it."""

    def __init__(self, description: EnvDescription, *, keep_image: bool) -> None:
        """Raises WrongEnvironment unless observations show the scene."""
        super().__init__(description)
        description.require_scene()
        if not keep_image:
            self.replaces = (IMAGE,)
