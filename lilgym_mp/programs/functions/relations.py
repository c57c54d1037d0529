"""Words that return the items related to an item, or to any of several items (docs/programs.md, "Related items")."""

from __future__ import annotations

from lilgym_mp.programs.functions.items import MARGIN
from lilgym_mp.programs.values import ItemView
from lilgym_mp.programs.words import EachItemArg, word

TOUCHING = 1  # pixels


@word("related items", depends_on="box")
def get_touching(x: EachItemArg) -> set[ItemView]:
    """The other items of its box at most 1 pixel from `x`."""
    return {y for y in x.box.members if _touching(x, y)}


@word("related items", depends_on="box")
def get_closely_touching(x: EachItemArg) -> set[ItemView]:
    """The other items of its box at most 4 pixels from `x`."""
    return {y for y in x.box.members if _within(x, y, MARGIN)}


@word("related items", depends_on="box")
def get_above(x: EachItemArg) -> set[ItemView]:
    """The items of its box whose bottom is at or above the top of `x`; in a tower, only those touching it."""
    tower = x.box.is_tower()
    return {y for y in x.box.members if _above(y, x) and (not tower or _touching(x, y))}


@word("related items", depends_on="box")
def get_below(x: EachItemArg) -> set[ItemView]:
    """The items of its box whose top is at or below the bottom of `x`; in a tower, only those touching it."""
    tower = x.box.is_tower()
    return {y for y in x.box.members if _above(x, y) and (not tower or _touching(x, y))}


@word("related items", depends_on="box")
def get_box_all_above(x: EachItemArg) -> set[ItemView]:
    """The items of its box whose bottom is at or above the top of `x`."""
    return {y for y in x.box.members if _above(y, x)}


@word("related items", depends_on="box")
def get_box_all_below(x: EachItemArg) -> set[ItemView]:
    """The items of its box whose top is at or below the bottom of `x`."""
    return {y for y in x.box.members if _above(x, y)}


@word("related items", depends_on="scene")
def get_img_all_above(x: EachItemArg) -> set[ItemView]:
    """The items of any box whose bottom is at or above the top of `x`, each measured in its own box."""
    return {y for y in _scene_items(x) if _above(y, x)}


@word("related items", depends_on="scene")
def get_img_all_below(x: EachItemArg) -> set[ItemView]:
    """The items of any box whose top is at or below the bottom of `x`, each measured in its own box."""
    return {y for y in _scene_items(x) if _above(x, y)}


@word("related items", depends_on="box")
def get_box_inclusive(x: EachItemArg) -> set[ItemView]:
    """All items of the box of `x`, including `x`."""
    return set(x.box.members)


@word("related items", depends_on="box")
def get_box_exclusive(x: EachItemArg) -> set[ItemView]:
    """The other items of the box of `x`."""
    return set(x.box.members) - {x}


@word("related items", depends_on="scene")
def get_img_exclusive(x: EachItemArg) -> set[ItemView]:
    """The other items of the scene."""
    return set(_scene_items(x)) - {x}


def _scene_items(x: ItemView) -> list[ItemView]:
    assert x.box.scene is not None
    return x.box.scene.items()


def _above(higher: ItemView, lower: ItemView) -> bool:
    return lower.top <= higher.bottom


def _touching(x: ItemView, y: ItemView) -> bool:
    return _within(x, y, TOUCHING)


def _within(x: ItemView, y: ItemView, distance: int) -> bool:
    """Whether the bounding squares of two distinct items of one box are at most `distance` pixels apart."""
    return (
        y is not x
        and x.left - y.right <= distance
        and y.left - x.right <= distance
        and x.bottom - y.top <= distance
        and y.bottom - x.top <= distance
    )
