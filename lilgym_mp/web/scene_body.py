"""A scene as pages get it: its picture, its items in words, and where they are in the picture."""

from __future__ import annotations

from pydantic import BaseModel

from lilgym_mp.programs.tracing import BOX_TITLES
from lilgym_mp.scene import BOX_PITCH, Item, Scene
from lilgym_mp.web.scene_images import data_url


class ItemBody(BaseModel):
    """An item: its bounding square in native pixels of the whole image, and in words."""

    box: int
    index: int
    x: int
    y: int
    side: int
    description: str


class SceneBody(BaseModel):
    """A scene to show. `picture` is an URL that holds a PNG of 380 x 100 native pixels, drawn larger."""

    picture: str
    items: list[ItemBody]
    description: str


def described_item(item: Item) -> str:
    return f"{item.size.name} {item.colour.name} {item.shape.name} at ({item.x}, {item.y})".lower()


def scene_body(scene: Scene) -> SceneBody:
    items = [
        ItemBody(
            box=box_index,
            index=index,
            x=box_index * BOX_PITCH + item.x,
            y=item.y,
            side=item.side,
            description=described_item(item),
        )
        for box_index, box in enumerate(scene.boxes)
        for index, item in enumerate(box.items)
    ]
    boxes = [
        f"{title} box: {', '.join(map(described_item, box.items)) or 'empty'}"
        for title, box in zip(BOX_TITLES, scene.boxes, strict=True)
    ]
    return SceneBody(picture=data_url(scene), items=items, description="; ".join(boxes))
