"""Words for the items related to an item, or to any of several items (SPEC section 8, "related items")."""

from __future__ import annotations

from lilgym_mp.programs.functions.items import MARGIN
from lilgym_mp.programs.views import ItemView
from lilgym_mp.programs.words import EachItem, word

TOUCHING = 1  # pixels


@word("related items", depends_on="box")
def get_touching(x: EachItem) -> set[ItemView]:
    """The other items of the box at most 1 pixel from `x`."""
    return {y for y in x.box.members if _touching(x, y)}


@word("related items", depends_on="box")
def get_closely_touching(x: EachItem) -> set[ItemView]:
    """The other items of the box at most 4 pixels from `x`."""
    return {y for y in x.box.members if _within(x, y, MARGIN)}


@word("related items", depends_on="box")
def get_above(x: EachItem) -> set[ItemView]:
    """The items of the box whose bottom is at the top of `x` or higher; in a tower, those touching it."""
    tower = x.box.is_tower()
    return {y for y in x.box.members if _above(y, x) and (not tower or _touching(x, y))}


@word("related items", depends_on="box")
def get_below(x: EachItem) -> set[ItemView]:
    """The items of the box whose top is at the bottom of `x` or lower; in a tower, those touching it."""
    tower = x.box.is_tower()
    return {y for y in x.box.members if _above(x, y) and (not tower or _touching(x, y))}


@word("related items", depends_on="box")
def get_box_all_above(x: EachItem) -> set[ItemView]:
    """The items of the box whose bottom is at the top of `x` or higher, touching or not."""
    return {y for y in x.box.members if _above(y, x)}


@word("related items", depends_on="box")
def get_box_all_below(x: EachItem) -> set[ItemView]:
    """The items of the box whose top is at the bottom of `x` or lower, touching or not."""
    return {y for y in x.box.members if _above(x, y)}


@word("related items", depends_on="scene")
def get_img_all_above(x: EachItem) -> set[ItemView]:
    """The items of the image whose bottom is at the top of `x` or higher, whatever their box."""
    return {y for y in _image(x) if _above(y, x)}


@word("related items", depends_on="scene")
def get_img_all_below(x: EachItem) -> set[ItemView]:
    """The items of the image whose top is at the bottom of `x` or lower, whatever their box."""
    return {y for y in _image(x) if _above(x, y)}


@word("related items", depends_on="box")
def get_box_inclusive(x: EachItem) -> set[ItemView]:
    """The items of the box of `x`, itself included."""
    return set(x.box.members)


@word("related items", depends_on="box")
def get_box_exclusive(x: EachItem) -> set[ItemView]:
    """The other items of the box of `x`."""
    return set(x.box.members) - {x}


@word("related items", depends_on="scene")
def get_img_exclusive(x: EachItem) -> set[ItemView]:
    """The other items of the image."""
    return set(_image(x)) - {x}


def _image(x: ItemView) -> list[ItemView]:
    assert x.box.scene is not None
    return x.box.scene.items()


def _above(higher: ItemView, lower: ItemView) -> bool:
    return lower.top <= higher.bottom


def _touching(x: ItemView, y: ItemView) -> bool:
    return _within(x, y, TOUCHING)


def _within(x: ItemView, y: ItemView, reach: int) -> bool:
    """Whether there are at most `reach` pixels between the bounding squares of two items of one box.

    The greatest of the four differences tells; most pairs are told apart by the first of them.
    """
    return (
        y is not x
        and x.left - y.right <= reach
        and y.left - x.right <= reach
        and x.bottom - y.top <= reach
        and y.bottom - x.top <= reach
    )
