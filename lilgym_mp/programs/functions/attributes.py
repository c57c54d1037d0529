"""Words about the colours, shapes and sizes of items (SPEC section 8, "attributes")."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import Any

from lilgym_mp.programs.views import Color, ItemView, Shape, Size
from lilgym_mp.programs.words import (
    AColor,
    AFunction,
    AShape,
    ASize,
    Elements,
    ItemOrItems,
    Items,
    value_key,
    word,
)


@word("attributes")
def query_color(x: ItemOrItems) -> list[Color]:
    """The colours of `x`, one an item, in order."""
    return [item.color for item in x]


@word("attributes")
def query_size(x: ItemOrItems) -> list[Size]:
    """The sizes of `x`, one an item, in order."""
    return [item.size for item in x]


@word("attributes")
def query_shape(x: ItemOrItems) -> list[Shape]:
    """The shapes of `x`, one an item, in order."""
    return [item.shape for item in x]


@word("attributes")
def get_set_colors(s: Items) -> set[Color]:
    """The colours that occur in `s`."""
    return {x.color for x in s}


@word("attributes")
def get_set_sizes(s: Items) -> set[Size]:
    """The sizes that occur in `s`."""
    return {x.size for x in s}


@word("attributes")
def get_set_shapes(s: Items) -> set[Shape]:
    """The shapes that occur in `s`."""
    return {x.shape for x in s}


@word("attributes")
def filter_color(s: Items, color: AColor) -> list[ItemView]:
    """The list of the items of `s` with that colour, in order."""
    return [x for x in s if x.color is color]


@word("attributes")
def filter_size(s: Items, size: ASize) -> list[ItemView]:
    """The list of the items of `s` with that size, in order."""
    return [x for x in s if x.size is size]


@word("attributes")
def filter_shape(s: Items, shape: AShape) -> list[ItemView]:
    """The list of the items of `s` with that shape, in order."""
    return [x for x in s if x.shape is shape]


@word("attributes", steps_each=8)
def all_same(values: Elements) -> bool:
    """Whether `values` holds exactly one distinct value; false when it is empty."""
    return _one_value(values)


@word("attributes")
def all_same_color(s: Items) -> bool:
    """Whether the items of `s` have one colour; false when there are none."""
    return _one_value(x.color for x in s)


@word("attributes")
def all_same_shape(s: Items) -> bool:
    """Whether the items of `s` have one shape; false when there are none."""
    return _one_value(x.shape for x in s)


@word("attributes")
def all_same_size(s: Items) -> bool:
    """Whether the items of `s` have one size; false when there are none."""
    return _one_value(x.size for x in s)


@word("attributes")
def all_same_attribute(s: Elements, f: AFunction) -> bool:
    """Whether f(x) is the same for all x of `s`; false when there are none."""
    return _one_value(f(x) for x in s)


def _one_value(values: Iterable[Any]) -> bool:
    """Every value is looked at, for what may be wrong with a later one; only the first is kept."""
    first: Hashable = None
    is_empty = same = True
    for value in values:
        key = value_key(value)
        if is_empty:
            first, is_empty = key, False
        same = same and key == first
    return same and not is_empty
