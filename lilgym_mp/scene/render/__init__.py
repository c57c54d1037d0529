"""Scenes as pixels, as text and as captioned frames.

`drawing` is the reference, `canvas` redraws only what changed, `characters` is for terminals and language models,
`frames` adds captions, box outlines and a grid of cells.
"""

from lilgym_mp.scene.render.drawing import draw, image_shape, shrink_of
from lilgym_mp.submodules import submodule_getter

__all__ = ["draw", "image_shape", "shrink_of"]

__getattr__ = submodule_getter(__name__)
