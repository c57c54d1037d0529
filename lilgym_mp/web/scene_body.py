"""Response model of a scene: rendered image, items with bounding boxes, and a text description."""

from __future__ import annotations

from pydantic import BaseModel

from lilgym_mp.programs.tracing import BOX_TITLES, cell_text
from lilgym_mp.scene import BOX_PITCH, Item, Scene
from lilgym_mp.web.scene_images import data_url


class ItemBody(BaseModel):
    """An item's description, and its bounding square in native pixels of the whole image."""

    box: int
    index: int
    x: int
    y: int
    side: int
    shape: str
    description: str


class SceneBody(BaseModel):
    """`picture` is a data URL: a PNG at twice the native size of 380 x 100 pixels."""

    picture: str
    items: list[ItemBody]
    description: str


def describe_item(box_index: int, item: Item) -> str:
    middle = cell_text(box_index, item.x + item.side // 2, item.y + item.side // 2)
    return f"{item.size.name} {item.colour.name} {item.shape.name} at {middle}".lower()


def scene_body(scene: Scene) -> SceneBody:
    items = [
        ItemBody(
            box=box_index,
            index=index,
            x=box_index * BOX_PITCH + item.x,
            y=item.y,
            side=item.side,
            shape=item.shape.name.lower(),
            description=describe_item(box_index, item),
        )
        for box_index, box in enumerate(scene.boxes)
        for index, item in enumerate(box.items)
    ]
    boxes = [
        f"{title} box: {', '.join(describe_item(index, item) for item in box.items) or 'empty'}"
        for index, (title, box) in enumerate(zip(BOX_TITLES, scene.boxes, strict=True))
    ]
    return SceneBody(picture=data_url(scene), items=items, description="; ".join(boxes))
