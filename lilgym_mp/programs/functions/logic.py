"""Comparison and Boolean logic (docs/programs.md, "Comparison", "Logic")."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from lilgym_mp.programs import words
from lilgym_mp.programs.words import CollectionArg, word


def _comparison(name: str, symbol: str, compare: Callable[[int, int], bool]) -> None:
    """Declares a word that compares two numbers."""

    def compared(a: words.IntArg, b: words.IntArg) -> bool:
        return compare(a, b)

    compared.__doc__ = f"Whether a {symbol} b."
    word("comparison", operator=symbol, name=name)(compared)


_comparison("le", "<=", operator.le)
_comparison("ge", ">=", operator.ge)
_comparison("lt", "<", operator.lt)
_comparison("gt", ">", operator.gt)


@word("comparison", operator="==")
def equal_int(a: words.IntArg, b: words.IntArg) -> bool:
    """Whether the numbers `a` and `b` are equal."""
    return a == b


@word("comparison", steps_per_element=8)
def equal(a: words.AnyArg, b: words.AnyArg) -> bool:
    """Whether `a` equals `b`. Values of different types are compared as sets, a single value as {value}."""
    if type(a) is type(b):
        return a == b
    return {words.value_key(x) for x in _as_list(a)} == {words.value_key(x) for x in _as_list(b)}


@word("comparison", attribute="color")
def equal_color(a: words.ColorsArg, b: words.ColorsArg) -> bool:
    """`equal`, restricted to colours and collections of colours."""
    return equal(a, b)


@word("comparison", attribute="size")
def equal_size(a: words.SizesArg, b: words.SizesArg) -> bool:
    """`equal`, restricted to sizes and collections of sizes."""
    return equal(a, b)


@word("comparison", attribute="shape")
def equal_shape(a: words.ShapesArg, b: words.ShapesArg) -> bool:
    """`equal`, restricted to shapes and collections of shapes."""
    return equal(a, b)


@word("logic", operator="and")
def AND(a: words.BoolArg, b: words.BoolArg) -> bool:
    """Whether both are true. Both must be bools, and both are evaluated."""
    return a and b


@word("logic", operator="or")
def OR(a: words.BoolArg, b: words.BoolArg) -> bool:
    """Whether at least one is true. Both must be bools, and both are evaluated."""
    return a or b


@word("logic", operator="not")
def NOT(a: words.BoolArg) -> bool:
    """Whether `a` is false. It must be a bool."""
    return not a


@word("logic", name="All")
def every(s: CollectionArg, f: words.FunctionArg) -> bool:
    """Whether f(x) is True, not merely truthy, for all x in `s`; false for an empty `s`. Stops at the first failure."""
    return bool(s) and all(f(x) is True for x in s)


@word("logic", name="Any")
def some(s: CollectionArg, f: words.FunctionArg) -> bool:
    """Whether f(x) is True, not merely truthy, for some x in `s`. Stops at the first success."""
    return any(f(x) is True for x in s)


def _as_list(value: Any) -> list[Any]:
    return words.elements(value) if words.is_collection(value) else [value]
