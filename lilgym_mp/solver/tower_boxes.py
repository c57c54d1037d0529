"""Images of the 121 Tower boxes; the image of a Tower scene is three of them side by side."""

from __future__ import annotations

from functools import cache

import numpy as np

from lilgym_mp.appearances.tower import tower_tables
from lilgym_mp.arrays import UInt8Array
from lilgym_mp.render import draw, shrink_of
from lilgym_mp.scene import BOX_PITCH, BOX_SIDE, Box, Scene, SceneError


def tower_box_index(box: Box) -> int:
    """The box's index in `tower_box_images` and `tower_tables().boxes`. Raises SceneError if it is not a Tower box."""
    index = tower_tables().indices.get(box.items)
    if index is None:
        raise SceneError(f"{box!r} is not a Tower box")
    return index


@cache
def tower_box_images(image_size: str = "half") -> UInt8Array:
    """(121, side, side, 3) read-only; each box looks the same at all three places. `side` is 50 or, native, 100 pixels.

    Raises ValueError for an unknown image size.
    """
    shrink = shrink_of(image_size)
    side = BOX_SIDE // shrink
    scenes = [Scene((box, Box(), Box())) for box in tower_tables().boxes]
    images = np.stack([draw(scene, image_size)[:, :side] for scene in scenes])
    images.flags.writeable = False
    return images


def box_columns(index: int, image_size: str = "half") -> slice:
    """The columns of box `index` in an image. Raises ValueError for an unknown image size."""
    shrink = shrink_of(image_size)
    return slice(index * BOX_PITCH // shrink, (index * BOX_PITCH + BOX_SIDE) // shrink)
