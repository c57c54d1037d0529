"""Words that compare values and combine truths (SPEC section 8, "comparison" and "logic")."""

from __future__ import annotations

from typing import Any

from lilgym_mp.programs.words import (
    AFunction,
    Boolean,
    Colors,
    Elements,
    Integer,
    Shapes,
    Sizes,
    Value,
    elements,
    is_collection,
    value_key,
    word,
)


@word("comparison")
def le(a: Integer, b: Integer) -> bool:
    """Whether a <= b."""
    return a <= b


@word("comparison")
def ge(a: Integer, b: Integer) -> bool:
    """Whether a >= b."""
    return a >= b


@word("comparison")
def lt(a: Integer, b: Integer) -> bool:
    """Whether a < b."""
    return a < b


@word("comparison")
def gt(a: Integer, b: Integer) -> bool:
    """Whether a > b."""
    return a > b


@word("comparison")
def equal_int(a: Integer, b: Integer) -> bool:
    """Whether the numbers `a` and `b` are equal."""
    return a == b


@word("comparison", steps_each=8)
def equal(a: Value, b: Value) -> bool:
    """Whether `a` equals `b`. Values of different types are compared as sets, a lone value as {value}."""
    if type(a) is type(b):
        return a == b
    return {value_key(x) for x in _as_list(a)} == {value_key(x) for x in _as_list(b)}


@word("comparison")
def equal_color(a: Colors, b: Colors) -> bool:
    """`equal` for colours and collections of colours only."""
    return equal(a, b)


@word("comparison")
def equal_size(a: Sizes, b: Sizes) -> bool:
    """`equal` for sizes and collections of sizes only."""
    return equal(a, b)


@word("comparison")
def equal_shape(a: Shapes, b: Shapes) -> bool:
    """`equal` for shapes and collections of shapes only."""
    return equal(a, b)


@word("logic")
def AND(a: Boolean, b: Boolean) -> bool:
    """Whether both are true. Both are evaluated, and must be bools."""
    return a and b


@word("logic")
def OR(a: Boolean, b: Boolean) -> bool:
    """Whether at least one is true. Both are evaluated, and must be bools."""
    return a or b


@word("logic")
def NOT(a: Boolean) -> bool:
    """Whether `a`, which must be a bool, is false."""
    return not a


@word("logic", name="All")
def every(s: Elements, f: AFunction) -> bool:
    """Whether f(x) is True (not merely not empty) for every x of `s`, up to the first failure; false for no x."""
    return bool(s) and all(f(x) is True for x in s)


@word("logic", name="Any")
def some(s: Elements, f: AFunction) -> bool:
    """Whether f(x) is True (not merely not empty) for some x of `s`, up to the first success."""
    return any(f(x) is True for x in s)


def _as_list(value: Any) -> list[Any]:
    return elements(value) if is_collection(value) else [value]
