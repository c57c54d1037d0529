"""Fragments of program source, and the ranges of counts that they test."""

from __future__ import annotations

from typing import NamedTuple

ALL_ITEMS = "all_items"
BOX = "b"  # lambda variable for a box
TOWERS = f"filter_obj(all_boxes, lambda {BOX}: {BOX}.is_tower())"


class Quantity(NamedTuple):
    """A range of counts, both ends included; `high` None means no upper bound. Words like "several" are `vague`."""

    low: int
    high: int | None
    vague: bool = False

    def test(self, collection: str) -> str:
        """Program text: the number of elements is in the range."""
        low, high, _ = self
        if high == 0:
            return f"NOT(exist({collection}))"
        if (low, high) == (1, None):
            return f"exist({collection})"
        if low == high:
            return f"count({collection}) == {low}"
        if high is None:
            return f"ge(count({collection}), {low})"
        if low == 0:
            return f"le(count({collection}), {high})"
        return f"{low} <= count({collection}) <= {high}"


def exactly(count: int) -> Quantity:
    """The quantity of `count`, no more and no fewer."""
    return Quantity(count, count)


def at_least(count: int) -> Quantity:
    """The quantity of `count` or more."""
    return Quantity(count, None)


def at_most(count: int) -> Quantity:
    """The quantity of `count` or fewer, including zero."""
    return Quantity(0, count)


SOME = at_least(1)
NONE = exactly(0)


def boxes_where(test: str) -> str:
    """The boxes that pass a test of the variable BOX."""
    return f"filter_obj(all_boxes, lambda {BOX}: {test})"
