"""The object types of the program language: items, boxes, scenes, and the enums Color, Shape, Size and Side.

Coordinates: left = x, right = x + side. Heights are measured upwards from the bottom of the box: top = 100 - y,
bottom = 100 - (y + side) (docs/spec.md, "Programs"). Items and boxes are compared by identity.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from lilgym_mp.scene import BOX_SIDE, SIZE_PIXELS, Box, Colour, Item, Scene
from lilgym_mp.scene import Shape as SceneShape
from lilgym_mp.scene import Size as SceneSize


class Color(Enum):
    """Not an IntEnum: no colour may equal a shape or a number."""

    YELLOW = Colour.YELLOW.value
    BLACK = Colour.BLACK.value
    BLUE = Colour.BLUE.value


class Shape(Enum):
    """Shapes by their names in programs."""

    CIRCLE = SceneShape.CIRCLE.value
    SQUARE = SceneShape.SQUARE.value
    TRIANGLE = SceneShape.TRIANGLE.value


class Size(Enum):
    """Sizes by their names in programs: the language says BIG for LARGE."""

    SMALL = SceneSize.SMALL.value
    MEDIUM = SceneSize.MEDIUM.value
    BIG = SceneSize.LARGE.value


class Side(Enum):
    """Walls of a box in tests of position; ANY matches each of them."""

    TOP = 0
    BOTTOM = 1
    LEFT = 2
    RIGHT = 3
    ANY = 4


ATTRIBUTE_TYPES: dict[str, type[Enum]] = {"color": Color, "shape": Shape, "size": Size}
ENUMS: dict[str, type[Enum]] = {"Color": Color, "Shape": Shape, "Size": Size, "Side": Side}
_COLORS = tuple(Color)
_SHAPES = tuple(Shape)
_SIZES = tuple(Size)


class ItemView:
    """An item of a scene; `index` is its index in its box."""

    __slots__ = ("bottom", "box", "color", "index", "left", "right", "shape", "size", "top")

    def __init__(self, item: Item, box: BoxView, index: int) -> None:
        x, y, shape, colour, size = item
        side = SIZE_PIXELS[size]
        self.box = box
        self.index = index
        self.left = x
        self.right = x + side
        self.top = BOX_SIDE - y
        self.bottom = BOX_SIDE - y - side
        self.color = _COLORS[colour]
        self.shape = _SHAPES[shape]
        self.size = _SIZES[size]


class BoxView:
    """A box of a scene, usable as the list of its items. `index` counts boxes from the left."""

    __slots__ = ("_members", "content", "index", "scene")

    def __init__(self, content: Box, index: int = 0, scene: SceneView | None = None) -> None:
        self.content = content
        self.index = index
        self.scene = scene
        self._members: tuple[ItemView, ...] | None = None

    @property
    def members(self) -> tuple[ItemView, ...]:
        """Views of the box's items, in its order."""
        if self._members is None:
            self._members = tuple(ItemView(item, self, index) for index, item in enumerate(self.content.items))
        return self._members

    def __iter__(self) -> Iterator[ItemView]:
        return iter(self.members)

    def __len__(self) -> int:
        return len(self.content.items)

    def is_tower(self) -> bool:
        """Whether the box holds a tower: not empty, squares only, all with the same right edge."""
        items = self.content.items
        if not items or any(item[2] != SceneShape.SQUARE for item in items):
            return False
        return len({item[0] + SIZE_PIXELS[item[4]] for item in items}) == 1

    def all_items_in_box(self) -> list[ItemView]:
        """The items of the box, in scene order."""
        return list(self.members)


class SceneView:
    """The three boxes of a scene, left to right. Objects of different views are never equal."""

    __slots__ = ("boxes",)

    def __init__(self, scene: Scene) -> None:
        self.boxes = tuple(BoxView(box, index, self) for index, box in enumerate(scene.boxes))

    def items(self) -> list[ItemView]:
        """Views of all items, from the left box to the right one."""
        return [item for box in self.boxes for item in box]
