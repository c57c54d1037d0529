"""Program source fragments used by both generators (`program_realisation` and the templates)."""

from __future__ import annotations

from lilgym_mp.generator.semantics import Quantity

ALL_ITEMS = "all_items"


def items_in_box(box: str) -> str:
    return f"{box}.all_items_in_box()"


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
