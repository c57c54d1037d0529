"""PNG images of scenes, cached."""

from __future__ import annotations

import base64
import io
from functools import lru_cache

from PIL import Image

from lilgym_mp.render.frames import smooth_picture
from lilgym_mp.scene import Scene

IMAGE_CACHE_SIZE = 2_000
SCALE = 2  # 760 x 200 pixels
COMPRESSION = 3  # zlib level; higher levels take longer than sending the bytes they save


@lru_cache(IMAGE_CACHE_SIZE)
def png(scene: Scene) -> bytes:
    """The scene at twice its native size, antialiased, as a PNG file."""
    buffer = io.BytesIO()
    Image.fromarray(smooth_picture(scene, SCALE)).save(buffer, "PNG", compress_level=COMPRESSION)
    return buffer.getvalue()


@lru_cache(IMAGE_CACHE_SIZE)
def data_url(scene: Scene) -> str:
    return f"data:image/png;base64,{base64.b64encode(png(scene)).decode()}"
