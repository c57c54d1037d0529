"""Words about the colours, shapes and sizes of items (docs/programs.md, "Attributes")."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import Any

from lilgym_mp.programs import words
from lilgym_mp.programs.values import Color, ItemView, Shape, Size
from lilgym_mp.programs.words import CollectionArg, ItemsArg, word


@word("attributes", attribute="color", reads_order=True)
def query_color(x: words.ItemOrItemsArg) -> list[Color]:
    """The colour of each item of `x`, in order."""
    return [item.color for item in x]


@word("attributes", attribute="size", reads_order=True)
def query_size(x: words.ItemOrItemsArg) -> list[Size]:
    """The size of each item of `x`, in order."""
    return [item.size for item in x]


@word("attributes", attribute="shape", reads_order=True)
def query_shape(x: words.ItemOrItemsArg) -> list[Shape]:
    """The shape of each item of `x`, in order."""
    return [item.shape for item in x]


@word("attributes", attribute="color")
def get_set_colors(s: ItemsArg) -> set[Color]:
    """The colours that occur in `s`."""
    return {x.color for x in s}


@word("attributes", attribute="size")
def get_set_sizes(s: ItemsArg) -> set[Size]:
    """The sizes that occur in `s`."""
    return {x.size for x in s}


@word("attributes", attribute="shape")
def get_set_shapes(s: ItemsArg) -> set[Shape]:
    """The shapes that occur in `s`."""
    return {x.shape for x in s}


@word("attributes", attribute="color")
def filter_color(s: ItemsArg, color: words.ColorArg) -> list[ItemView]:
    """The items of `s` with that colour, in order."""
    return [x for x in s if x.color is color]


@word("attributes", attribute="size")
def filter_size(s: ItemsArg, size: words.SizeArg) -> list[ItemView]:
    """The items of `s` with that size, in order."""
    return [x for x in s if x.size is size]


@word("attributes", attribute="shape")
def filter_shape(s: ItemsArg, shape: words.ShapeArg) -> list[ItemView]:
    """The items of `s` with that shape, in order."""
    return [x for x in s if x.shape is shape]


@word("attributes", steps_per_element=8)
def all_same(values: CollectionArg) -> bool:
    """Whether `values` holds exactly one distinct value; false when it is empty."""
    return _all_equal(values)


def _all_same(attribute: str, spelling: str) -> None:
    """Declares the word that tests whether items agree in an attribute, such as `all_same_color`."""

    def test(s: ItemsArg) -> bool:
        return _all_equal(getattr(x, attribute) for x in s)

    test.__doc__ = f"Whether all items of `s` have the same {spelling}; false when there are none."
    word("attributes", attribute=attribute, name=f"all_same_{attribute}")(test)


_all_same("color", "colour")
_all_same("shape", "shape")
_all_same("size", "size")


@word("attributes")
def all_same_attribute(s: CollectionArg, f: words.FunctionArg) -> bool:
    """Whether f(x) is the same for all x in `s`; false when `s` is empty."""
    return _all_equal(f(x) for x in s)


def _all_equal(values: Iterable[Any]) -> bool:
    """Whether there is exactly one distinct value. Consumes all values: computing a later one may raise."""
    first: Hashable = None
    is_empty = same = True
    for value in values:
        key = words.value_key(value)
        if is_empty:
            first = key
            is_empty = False
        same = same and key == first
    return same and not is_empty
