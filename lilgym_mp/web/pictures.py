"""Scenes as PNG pictures, drawn by the package."""

from __future__ import annotations

import base64
import io
from functools import lru_cache

from PIL import Image

from lilgym_mp.render import draw
from lilgym_mp.scene import Scene

KEPT_PICTURES = 2_000


@lru_cache(KEPT_PICTURES)
def png(scene: Scene) -> bytes:
    """The scene at native size, 380 x 100 pixels, as a PNG file."""
    buffer = io.BytesIO()
    Image.fromarray(draw(scene)).save(buffer, "PNG")
    return buffer.getvalue()


def data_url(scene: Scene) -> str:
    """The picture as an URL that holds it."""
    return f"data:image/png;base64,{base64.b64encode(png(scene)).decode()}"
