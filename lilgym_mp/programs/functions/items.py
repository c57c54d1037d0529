"""Tests of one item (attributes, position in the box, walls, corners) and of the distance between two items.

Source: docs/programs.md, "Item tests", "Walls", "Two items".
"""

from __future__ import annotations

from lilgym_mp.programs.values import Color, ItemView, Shape, Side, Size
from lilgym_mp.programs.words import ItemArg, SideArg, word
from lilgym_mp.scene import BOX_SIDE

MARGIN = 4  # pixels: "closely touching"
WIDE_MARGIN = 2 * MARGIN  # pixels: "close to"; our choice, because both such functions of the release always raise
LEVEL_HEIGHT = 21  # pixels between the bottoms of consecutive blocks of a tower


def _attribute_test(value: Color | Shape | Size, meaning: str) -> None:
    """Declares the word that tests for one colour, shape or size, such as `is_yellow`."""
    attribute = type(value).__name__.lower()

    def test(x: ItemArg) -> bool:
        return getattr(x, attribute) is value

    test.__doc__ = f"Whether `x` is {meaning}."
    word("item tests", depends_on="attributes", name=f"is_{value.name.lower()}")(test)


_attribute_test(Color.YELLOW, "yellow")
_attribute_test(Color.BLUE, "blue")
_attribute_test(Color.BLACK, "black")
_attribute_test(Shape.CIRCLE, "a circle")
_attribute_test(Shape.SQUARE, "a square")
_attribute_test(Shape.TRIANGLE, "a triangle")
_attribute_test(Size.BIG, "big (30 pixels)")
_attribute_test(Size.MEDIUM, "medium (20 pixels)")
_attribute_test(Size.SMALL, "small (10 pixels)")


@word("item tests", depends_on="box")
def is_top(x: ItemArg) -> bool:
    """Whether no item of its box has a higher top than `x`."""
    return all(y.top <= x.top for y in x.box.members)


@word("item tests", depends_on="box")
def is_bottom(x: ItemArg) -> bool:
    """Whether no item of its box has a lower top than `x` (tops are compared, not bottoms)."""
    return all(y.top >= x.top for y in x.box.members)


@word("item tests", depends_on="box")
def is_second(x: ItemArg) -> bool:
    """Whether `x` is the second block of a tower, counted from the bottom."""
    return x.bottom == LEVEL_HEIGHT and x.box.is_tower()


@word("item tests", depends_on="box")
def is_third(x: ItemArg) -> bool:
    """Whether `x` is the third block of a tower, counted from the bottom."""
    return x.bottom == 2 * LEVEL_HEIGHT and x.box.is_tower()


@word("walls", depends_on="position")
def is_touching_wall(x: ItemArg, side: SideArg = Side.ANY) -> bool:
    """Whether `x` touches the wall of its box on that side."""
    return _near_wall(x, side, 0)


@word("walls", depends_on="position")
def is_closely_touching_wall(x: ItemArg, side: SideArg = Side.ANY) -> bool:
    """Whether `x` is at most 4 pixels from the wall of its box on that side."""
    return _near_wall(x, side, MARGIN)


@word("walls", depends_on="position")
def is_close_to_wall(x: ItemArg, side: SideArg = Side.ANY) -> bool:
    """Whether `x` is at most 8 pixels from the wall of its box on that side."""
    return _near_wall(x, side, WIDE_MARGIN)


@word("walls", depends_on="position")
def is_touching_corner(x: ItemArg, side: SideArg = Side.ANY) -> bool:
    """Whether `x` touches exactly two walls, one of them on that side."""
    return _near_corner(x, 0, side)


@word("walls", depends_on="position")
def is_closely_touching_corner(x: ItemArg, side: SideArg = Side.ANY) -> bool:
    """Whether `x` is at most 4 pixels from exactly two walls, one of them on that side."""
    return _near_corner(x, MARGIN, side)


@word("walls", depends_on="position")
def is_closely_touching_specific_corner(x: ItemArg, side_a: SideArg, side_b: SideArg) -> bool:
    """Whether `x` is at most 4 pixels from exactly two walls: those on the two sides."""
    return _near_corner(x, MARGIN, side_a, side_b)


@word("walls", depends_on="position")
def is_close_to_corner(x: ItemArg, side: SideArg = Side.ANY) -> bool:
    """Whether `x` is at most 8 pixels from exactly two walls, one of them on that side."""
    return _near_corner(x, WIDE_MARGIN, side)


@word("two items")
def is_closely_touching(x: ItemArg, y: ItemArg) -> bool:
    """Whether an edge of `x` is at most 4 pixels from the opposite edge of `y`, even in different boxes."""
    gaps = (x.top - y.bottom, x.bottom - y.top, x.left - y.right, x.right - y.left)
    return any(abs(gap) <= MARGIN for gap in gaps)


def _walls(x: ItemView, margin: int) -> tuple[bool, bool, bool, bool]:
    """Whether `x` is within the margin of each wall, in the order of Side."""
    far = BOX_SIDE - margin
    return x.top >= far, x.bottom <= margin, x.left <= margin, x.right >= far


def _near_wall(x: ItemView, side: Side, margin: int) -> bool:
    walls = _walls(x, margin)
    return any(walls) if side is Side.ANY else walls[side.value]


def _near_corner(x: ItemView, margin: int, *sides: Side) -> bool:
    walls = _walls(x, margin)
    return sum(walls) == 2 and all(side is Side.ANY or walls[side.value] for side in sides)
