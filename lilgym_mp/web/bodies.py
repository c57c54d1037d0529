"""Response models shared by several pages, and PNG images of scenes."""

from __future__ import annotations

import base64
import io
from functools import lru_cache
from typing import Annotated, Any, Self

from PIL import Image
from pydantic import AfterValidator, BaseModel, ConfigDict

from lilgym_mp.programs.tracing import BOX_TITLES, cell_text
from lilgym_mp.render.frames import smooth_picture
from lilgym_mp.scene import BOX_PITCH, Item, Scene

IMAGE_CACHE_SIZE = 2_000
SCALE = 2  # 760 x 200 pixels
COMPRESSION = 3  # zlib level; higher levels take longer than sending the bytes they save

Reward = Annotated[float, AfterValidator(lambda reward: round(reward, 6))]


class Body(BaseModel):
    """Base of the response models. A nested body can be given as any object with its attributes."""

    model_config = ConfigDict(from_attributes=True)

    @classmethod
    def of(cls, source: object, **others: Any) -> Self:
        """A body with the attributes of `source` that have the names of its fields, except for the `others`."""
        return cls(**{name: getattr(source, name) for name in cls.model_fields.keys() - others.keys()}, **others)


class LegalBody(Body):
    """Names of legal actions."""

    actions: list[str]


class ProgramPart(Body):
    """A subexpression of the program, its value, and the items (box, index) in that value."""

    depth: int
    source: str
    value: str
    items: list[tuple[int, int]]


class ItemBody(Body):
    """An item's description, and its bounding square in native pixels of the whole image."""

    box: int
    index: int
    x: int
    y: int
    side: int
    shape: str
    description: str


class SceneBody(Body):
    """`picture` is a data URL: a PNG at twice the native size of 380 x 100 pixels."""

    picture: str
    items: list[ItemBody]
    description: str


@lru_cache(IMAGE_CACHE_SIZE)
def png(scene: Scene) -> bytes:
    """The scene at twice its native size, antialiased, as a PNG file."""
    buffer = io.BytesIO()
    Image.fromarray(smooth_picture(scene, SCALE)).save(buffer, "PNG", compress_level=COMPRESSION)
    return buffer.getvalue()


@lru_cache(IMAGE_CACHE_SIZE)
def data_url(scene: Scene) -> str:
    return f"data:image/png;base64,{base64.b64encode(png(scene)).decode()}"


def scene_body(scene: Scene) -> SceneBody:
    items = [
        ItemBody.of(
            item,
            box=box,
            index=index,
            x=box * BOX_PITCH + item.x,
            shape=item.shape.name.lower(),
            description=_description(box, item),
        )
        for box, content in enumerate(scene.boxes)
        for index, item in enumerate(content.items)
    ]
    boxes = [
        f"{title} box: {', '.join(item.description for item in items if item.box == box) or 'empty'}"
        for box, title in enumerate(BOX_TITLES)
    ]
    return SceneBody(picture=data_url(scene), items=items, description="; ".join(boxes))


def _description(box: int, item: Item) -> str:
    middle = cell_text(box, item.x + item.side // 2, item.y + item.side // 2)
    return f"{item.size.name} {item.colour.name} {item.shape.name} at {middle}".lower()
