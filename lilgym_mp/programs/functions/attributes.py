"""Words about the colours, shapes and sizes of items (docs/spec.md, "Attributes")."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import Any

from lilgym_mp.programs.values import Color, ItemView, Shape, Size
from lilgym_mp.programs.words import (
    CollectionArg,
    ColorArg,
    FunctionArg,
    ItemOrItemsArg,
    ItemsArg,
    ShapeArg,
    SizeArg,
    value_key,
    word,
)


@word("attributes")
def query_color(x: ItemOrItemsArg) -> list[Color]:
    """The colour of each item of `x`, in order."""
    return [item.color for item in x]


@word("attributes")
def query_size(x: ItemOrItemsArg) -> list[Size]:
    """The size of each item of `x`, in order."""
    return [item.size for item in x]


@word("attributes")
def query_shape(x: ItemOrItemsArg) -> list[Shape]:
    """The shape of each item of `x`, in order."""
    return [item.shape for item in x]


@word("attributes")
def get_set_colors(s: ItemsArg) -> set[Color]:
    """The colours that occur in `s`."""
    return {x.color for x in s}


@word("attributes")
def get_set_sizes(s: ItemsArg) -> set[Size]:
    """The sizes that occur in `s`."""
    return {x.size for x in s}


@word("attributes")
def get_set_shapes(s: ItemsArg) -> set[Shape]:
    """The shapes that occur in `s`."""
    return {x.shape for x in s}


@word("attributes")
def filter_color(s: ItemsArg, color: ColorArg) -> list[ItemView]:
    """The items of `s` with that colour, in order."""
    return [x for x in s if x.color is color]


@word("attributes")
def filter_size(s: ItemsArg, size: SizeArg) -> list[ItemView]:
    """The items of `s` with that size, in order."""
    return [x for x in s if x.size is size]


@word("attributes")
def filter_shape(s: ItemsArg, shape: ShapeArg) -> list[ItemView]:
    """The items of `s` with that shape, in order."""
    return [x for x in s if x.shape is shape]


@word("attributes", steps_per_element=8)
def all_same(values: CollectionArg) -> bool:
    """Whether `values` holds exactly one distinct value; false when it is empty."""
    return _all_equal(values)


@word("attributes")
def all_same_color(s: ItemsArg) -> bool:
    """Whether all items of `s` have the same colour; false when there are none."""
    return _all_equal(x.color for x in s)


@word("attributes")
def all_same_shape(s: ItemsArg) -> bool:
    """Whether all items of `s` have the same shape; false when there are none."""
    return _all_equal(x.shape for x in s)


@word("attributes")
def all_same_size(s: ItemsArg) -> bool:
    """Whether all items of `s` have the same size; false when there are none."""
    return _all_equal(x.size for x in s)


@word("attributes")
def all_same_attribute(s: CollectionArg, f: FunctionArg) -> bool:
    """Whether f(x) is the same for all x in `s`; false when `s` is empty."""
    return _all_equal(f(x) for x in s)


def _all_equal(values: Iterable[Any]) -> bool:
    """Whether there is exactly one distinct value. Consumes all values: computing a later one may raise."""
    first: Hashable = None
    is_empty = same = True
    for value in values:
        key = value_key(value)
        if is_empty:
            first, is_empty = key, False
        same = same and key == first
    return same and not is_empty
