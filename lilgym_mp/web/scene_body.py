"""Response model of a scene: rendered image, items with bounding boxes, and a text description."""

from __future__ import annotations

from pydantic import BaseModel

from lilgym_mp.programs.tracing import BOX_TITLES
from lilgym_mp.scene import BOX_PITCH, Item, Scene
from lilgym_mp.web.scene_images import data_url


class ItemBody(BaseModel):
    """An item's description, and its bounding square in native pixels of the whole image."""

    box: int
    index: int
    x: int
    y: int
    side: int
    description: str


class SceneBody(BaseModel):
    """`picture` is a data URL: a PNG at twice the native size of 380 x 100 pixels."""

    picture: str
    items: list[ItemBody]
    description: str


def describe_item(item: Item) -> str:
    return f"{item.size.name} {item.colour.name} {item.shape.name} at ({item.x}, {item.y})".lower()


def scene_body(scene: Scene) -> SceneBody:
    items = [
        ItemBody(
            box=box_index,
            index=index,
            x=box_index * BOX_PITCH + item.x,
            y=item.y,
            side=item.side,
            description=describe_item(item),
        )
        for box_index, box in enumerate(scene.boxes)
        for index, item in enumerate(box.items)
    ]
    boxes = [
        f"{title} box: {', '.join(map(describe_item, box.items)) or 'empty'}"
        for title, box in zip(BOX_TITLES, scene.boxes, strict=True)
    ]
    return SceneBody(picture=data_url(scene), items=items, description="; ".join(boxes))
