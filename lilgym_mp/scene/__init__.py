"""Scenes: three boxes of coloured items, immutable, with the released JSON format.

Source: docs/spec.md, "Scenes" (NLVR's `structured_rep`); colours and sizes as in Wu et al. 2023, section 3.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import FrozenInstanceError
from enum import IntEnum
from itertools import product
from typing import Any, NamedTuple, NoReturn, Self, TypeVar, cast

from lilgym_mp.scene.choices import listed
from lilgym_mp.submodules import submodule_getter

Member = TypeVar("Member")

BOX_COUNT = 3
BOX_SIDE = 100  # pixels
SEPARATOR_WIDTH = 40
BOX_PITCH = BOX_SIDE + SEPARATOR_WIDTH  # x distance between the left borders of neighbouring boxes
IMAGE_WIDTH = BOX_COUNT * BOX_SIDE + (BOX_COUNT - 1) * SEPARATOR_WIDTH
IMAGE_HEIGHT = BOX_SIDE


class SceneError(ValueError):
    """An invalid scene: wrong JSON, an item outside its box, overlapping items."""


class Shape(IntEnum):
    """The value orders item types."""

    CIRCLE = 0
    SQUARE = 1
    TRIANGLE = 2


class Colour(IntEnum):
    """The value orders item types and indexes palettes."""

    YELLOW = 0
    BLACK = 1
    BLUE = 2


class Size(IntEnum):
    """The value is the second part of a footprint's index, after the shape."""

    SMALL = 0
    MEDIUM = 1
    LARGE = 2

    @property
    def pixels(self) -> int:
        """Side of the bounding square."""
        return SIZE_PIXELS[self]


SIZE_PIXELS = (10, 20, 30)  # by Size
# FOOTPRINTS[shape][size] is the item's footprint: shape and size as one index, on which geometry depends.
FOOTPRINTS = tuple(tuple(shape * len(Size) + size for size in Size) for shape in Shape)
FOOTPRINT_COUNT = len(Shape) * len(Size)
FOOTPRINT_SIDES = SIZE_PIXELS * len(Shape)  # by footprint: side of the bounding square

JSON_SHAPES = {"circle": Shape.CIRCLE, "square": Shape.SQUARE, "triangle": Shape.TRIANGLE}
JSON_COLOURS = {"Yellow": Colour.YELLOW, "Black": Colour.BLACK, "#0099ff": Colour.BLUE}
JSON_SIZES = {10: Size.SMALL, 20: Size.MEDIUM, 30: Size.LARGE}
JSON_ITEM_KEYS = {"x_loc", "y_loc", "type", "color", "size"}
_ITEM_TYPES: Mapping[tuple[object, ...], tuple[Shape, Colour, Size]] = {
    names: (JSON_SHAPES[names[0]], JSON_COLOURS[names[1]], JSON_SIZES[names[2]])
    for names in product(JSON_SHAPES, JSON_COLOURS, JSON_SIZES)
}
_SHAPE_NAMES = {shape: name for name, shape in JSON_SHAPES.items()}
_COLOUR_NAMES = {colour: name for name, colour in JSON_COLOURS.items()}


# Makes a named tuple of all its fields in order, unchecked, in half the time of calling its class.
new_tuple: Any = cast("Any", tuple).__new__


class Item(NamedTuple):
    """One object.

    Attributes:
        x: Left pixel of its bounding square inside its box.
        y: Top pixel of that square, counted downwards.
        shape: Circle, square or triangle.
        colour: Yellow, black or blue.
        size: Small, medium or large: 10, 20 or 30 pixels.
    """

    x: int
    y: int
    shape: Shape
    colour: Colour
    size: Size

    @property
    def footprint(self) -> int:
        """Shape and size as one index, 0 .. 8: what the geometry depends on."""
        return FOOTPRINTS[self[2]][self[4]]

    @property
    def side(self) -> int:
        """Side of the bounding square in pixels."""
        return SIZE_PIXELS[self[4]]

    def to_json(self) -> dict[str, int | str]:
        """The item in the release's format; `x_loc`, `y_loc` and `size` in pixels."""
        return {
            "x_loc": self.x,
            "y_loc": self.y,
            "type": _SHAPE_NAMES[self.shape],
            "color": _COLOUR_NAMES[self.colour],
            "size": self.side,
        }

    @classmethod
    def from_json(cls, data: object) -> Item:
        """The item of a record in the release's format.

        Args:
            data: The object read from JSON.

        Raises:
            SceneError: Naming the key, the value and the choices.
        """
        record = cast("Mapping[str, Any]", data)
        try:  # several times as fast as what follows, which explains faults
            x = record["x_loc"]
            y = record["y_loc"]
            side = record["size"]
            if type(x) is type(y) is type(side) is int and len(record) == len(JSON_ITEM_KEYS):
                return cls(x, y, *_ITEM_TYPES[record["type"], record["color"], side])
        except (KeyError, TypeError):
            pass
        if not isinstance(data, Mapping):
            raise SceneError(f"an item must be an object with keys {listed(JSON_ITEM_KEYS)}, not {data!r}")
        if set(record) != JSON_ITEM_KEYS:
            raise SceneError(f"an item has keys {listed(record)}; it must have {listed(JSON_ITEM_KEYS)}")
        return cls(
            _pixel(record, "x_loc"),
            _pixel(record, "y_loc"),
            _one_of(record, "type", JSON_SHAPES),
            _one_of(record, "color", JSON_COLOURS),
            _one_of(record, "size", JSON_SIZES),
        )


class _Frozen:
    """Base class of immutable classes with slots, compared by `_content`. A frozen dataclass takes three times as long
    to construct, and each step constructs two.

    `memo` caches values derived from the content (masks, geometry), which stay valid because it never changes. It is
    not compared or pickled.
    """

    __slots__ = ("memo",)
    memo: dict[Hashable, Any]
    _content: Any

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise FrozenInstanceError(f"cannot set {name} of a {type(self).__name__}: make a new one")

    def __delattr__(self, name: str) -> NoReturn:
        raise FrozenInstanceError(f"cannot delete {name} of a {type(self).__name__}")

    def __eq__(self, other: object) -> bool:
        return self._content == other._content if isinstance(other, type(self)) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._content)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._content!r})"

    def __reduce__(self) -> tuple[type[Self], tuple[Any]]:
        return type(self), (self._content,)


_set_memo: Callable[[_Frozen, dict[Hashable, Any]], None] = _Frozen.__dict__["memo"].__set__


class Box(_Frozen):
    """The items of one box in the order they were added.

    Args:
        items: The items.
    """

    __slots__ = ("items",)
    items: tuple[Item, ...]

    def __init__(self, items: tuple[Item, ...] = ()) -> None:
        _set_items(self, items)
        _set_memo(self, {})

    def with_item(self, item: Item) -> Box:
        """The box with an item added as the last.

        Args:
            item: The item.
        """
        return Box((*self.items, item))

    def without(self, index: int) -> Box:
        """The box without one item.

        Args:
            index: The item's index in `items`.
        """
        return Box(self.items[:index] + self.items[index + 1 :])


_set_items: Callable[[Box, tuple[Item, ...]], None] = Box.__dict__["items"].__set__
Box._content = Box.__dict__["items"]  # pyright: ignore[reportPrivateUsage]


class Scene(_Frozen):
    """Three boxes, left to right.

    Args:
        boxes: The left, the middle and the right box.
    """

    __slots__ = ("boxes",)
    boxes: tuple[Box, Box, Box]

    def __init__(self, boxes: tuple[Box, Box, Box]) -> None:
        _set_boxes(self, boxes)
        _set_memo(self, {})

    @classmethod
    def empty(cls) -> Scene:
        """Three boxes without items."""
        return cls((Box(), Box(), Box()))

    @classmethod
    def of(cls, *boxes: Iterable[Item]) -> Scene:
        """A scene from three collections of items.

        Args:
            boxes: The items of the left, the middle and the right box.
        """
        if len(boxes) != BOX_COUNT:
            raise SceneError(f"a scene has {BOX_COUNT} boxes, not {len(boxes)}")
        return cls.of_boxes(Box(tuple(items)) for items in boxes)

    @classmethod
    def of_boxes(cls, boxes: Iterable[Box]) -> Scene:
        """A scene of three boxes.

        Args:
            boxes: The boxes, left to right.
        """
        left, middle, right = boxes
        return cls((left, middle, right))

    def items(self) -> Iterator[Item]:
        """Every item, box by box."""
        for box in self.boxes:
            yield from box.items

    def with_box(self, index: int, box: Box) -> Scene:
        """The scene with another box in one place.

        Args:
            index: 0 for the left box, 1 for the middle one, 2 for the right one.
            box: The new box.
        """
        left, middle, right = self.boxes
        if index == 0:
            return Scene((box, middle, right))
        if index == 1:
            return Scene((left, box, right))
        return Scene((left, middle, box))

    def permuted(self, order: Sequence[int]) -> Scene:
        """The scene with its boxes in another order.

        Args:
            order: A permutation of 0, 1, 2; box k is this scene's box `order[k]`.
        """
        if sorted(order) != list(range(BOX_COUNT)):
            raise SceneError(f"{tuple(order)!r} is not a permutation of the boxes 0, 1, 2")
        return Scene.of_boxes(self.boxes[index] for index in order)

    def to_json(self) -> list[list[dict[str, int | str]]]:
        """The released `structured_rep`: three lists of items."""
        return [[item.to_json() for item in box.items] for box in self.boxes]

    @classmethod
    def from_json(cls, data: object) -> Scene:
        """Reads the released `structured_rep`. Checks the form only: `appearances` check what is legal.

        Args:
            data: The object read from JSON.

        Raises:
            SceneError: Naming every box and item at fault.
        """
        if not isinstance(data, list):
            raise SceneError(f"a scene must be a list of {BOX_COUNT} boxes, not {data!r}")
        faults: list[str] = []
        read = [list(_box_items(index, box, faults)) for index, box in enumerate(cast("list[object]", data))]
        if faults:
            raise SceneError("; ".join(faults))
        return cls.of(*read)


_set_boxes: Callable[[Scene, tuple[Box, Box, Box]], None] = Scene.__dict__["boxes"].__set__
Scene._content = Scene.__dict__["boxes"]  # pyright: ignore[reportPrivateUsage]


def _box_items(box_index: int, data: object, faults: list[str]) -> Iterator[Item]:
    """The box's valid items; a message about each other one is added to `faults`."""
    if not isinstance(data, list):
        faults.append(f"box {box_index}: a box must be a list of items, not {data!r}")
        return
    for index, record in enumerate(cast("list[object]", data)):
        try:
            yield Item.from_json(record)
        except SceneError as fault:
            faults.append(f"box {box_index}, item {index}: {fault}")


def _pixel(record: Mapping[str, object], key: str) -> int:
    value = record[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or value != value // 1:
        raise SceneError(f"{key} must be a whole number of pixels, not {value!r}")
    return int(value)


def _one_of(record: Mapping[str, object], key: str, choices: Mapping[Any, Member]) -> Member:
    value = record[key]
    for name, member in choices.items():
        if value == name:
            return member
    raise SceneError(f"unknown {key} {value!r}; choose from {listed(choices)}")


__getattr__ = submodule_getter(__name__)
