"""Scenes as PNG pictures, drawn by the package."""

from __future__ import annotations

import base64
import io
from functools import lru_cache

from PIL import Image

from lilgym_mp.render.frames import smooth_picture
from lilgym_mp.scene import Scene

KEPT_PICTURES = 2_000
SCALE = 2  # 760 x 200 pixels
COMPRESSION = 3  # of 9: what the higher levels save takes longer than to send it


@lru_cache(KEPT_PICTURES)
def png(scene: Scene) -> bytes:
    """The scene at twice its native size, with smooth edges, as a PNG file."""
    buffer = io.BytesIO()
    Image.fromarray(smooth_picture(scene, SCALE)).save(buffer, "PNG", compress_level=COMPRESSION)
    return buffer.getvalue()


@lru_cache(KEPT_PICTURES)
def data_url(scene: Scene) -> str:
    """The picture as an URL that holds it."""
    return f"data:image/png;base64,{base64.b64encode(png(scene)).decode()}"
