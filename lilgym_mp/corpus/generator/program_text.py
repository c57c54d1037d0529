"""Fragments of program source."""

from __future__ import annotations

from lilgym_mp.corpus.generator.quantities import Quantity

ALL_ITEMS = "all_items"
BOX = "b"  # lambda variable for a box
TOWERS = f"filter_obj(all_boxes, lambda {BOX}: {BOX}.is_tower())"


def items_in_box(box: str) -> str:
    return f"{box}.all_items_in_box()"


def boxes_where(test: str) -> str:
    """The boxes that pass a test of the variable BOX."""
    return f"filter_obj(all_boxes, lambda {BOX}: {test})"


def quantity_test(quantity: Quantity, collection: str) -> str:
    """Tests that the number of elements is in the range."""
    low, high, _ = quantity
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
