"""Ranges of counts: "two", "at least three", "several"."""

from __future__ import annotations

from typing import NamedTuple


class Quantity(NamedTuple):
    """A range of counts, both ends included; `high` None means no upper bound. Words like "several" are `vague`."""

    low: int
    high: int | None
    vague: bool = False


def exactly(count: int) -> Quantity:
    return Quantity(count, count)


def at_least(count: int) -> Quantity:
    return Quantity(count, None)


def at_most(count: int) -> Quantity:
    return Quantity(0, count)


SOME, NONE = at_least(1), exactly(0)
