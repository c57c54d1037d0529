"""Words about collections, and the built-ins of Python that programs may use (SPEC section 8, "sets")."""

from __future__ import annotations

import itertools
from typing import Any

from lilgym_mp.programs.errors import ProgramRuntimeError
from lilgym_mp.programs.words import (
    AFunction,
    Collections,
    Elements,
    Growth,
    Integer,
    Value,
    described,
    identity,
    word,
)

MANY = 10**9  # stands for any number of combinations beyond every limit


def number_of_choices(n: int, k: int) -> int:
    """How many ways there are to choose k of n, at most MANY: never a huge number."""
    if k < 0 or k > n:
        return 0
    ways = 1
    for index in range(min(k, n - k)):
        ways = ways * (n - index) // (index + 1)
        if ways >= MANY:
            return MANY
    return ways


def growth_of_sublists(k: int, s: list[Any]) -> Growth:
    """How large `select(k, s)` is."""
    return Growth(number_of_choices(len(s), k), k, len(s))


def growth_of_tuples(s: list[Any], k: int) -> Growth:
    """How large `combinations(s, k)` is."""
    return Growth(number_of_choices(len(s), k), k, len(s))


@word("sets")
def exist(s: Elements) -> bool:
    """Whether `s` has at least one element."""
    return bool(s)


@word("sets")
def count(s: Elements) -> int:
    """The number of distinct objects in `s`; equal items at different places are different objects."""
    return len({identity(x) for x in s})


@word("sets")
def unique(s: Elements) -> Any:
    """The only element of `s`. An error unless there is exactly one."""
    if count(s) != 1:
        raise ProgramRuntimeError(f"unique: s must hold exactly one object, not {count(s)}")
    return s[0]


@word("sets")
def filter_obj(s: Elements, f: AFunction) -> list[Any]:
    """The list of those x of `s`, in order, for which f(x) is true or not empty."""
    return [x for x in s if f(x)]


@word("sets")
def union(a: Elements, b: Elements) -> set[Any]:
    """The set of what is in `a` or in `b`."""
    return as_set(a) | as_set(b)


@word("sets")
def intersect(a: Elements, b: Elements) -> set[Any]:
    """The set of what is in both `a` and `b`."""
    return as_set(a) & as_set(b)


@word("sets")
def union_all(sets: Collections) -> set[Any]:
    """The set of what is in any of `sets`; empty for none."""
    return as_set([x for part in sets for x in part])


@word("sets")
def intersect_all(sets: Collections) -> set[Any]:
    """The set of what is in all of `sets`; empty for none."""
    return as_set(sets[0]).intersection(*map(as_set, sets[1:])) if sets else set()


@word("sets")
def contained(a: Elements, b: Elements) -> bool:
    """Whether every element of `a` is in `b`."""
    return as_set(a) <= as_set(b)


@word("sets")
def equal_set(a: Elements, b: Elements) -> bool:
    """Whether `a` and `b` have the same elements, whatever their order and repetitions."""
    return as_set(a) == as_set(b)


@word("sets")
def member_of(x: Value, s: Elements) -> bool:
    """Whether `x` is in `s`."""
    return x in s


@word("sets", growth=growth_of_sublists)
def select(k: Integer, s: Elements) -> list[list[Any]]:
    """All sub-lists of `s` of size `k`, in order."""
    return [list(choice) for choice in itertools.combinations(s, k)] if k >= 0 else []


@word("sets", growth=growth_of_tuples)
def combinations(s: Elements, k: Integer) -> list[tuple[Any, ...]]:
    """All `k`-tuples of elements of `s`, in order, each choice once."""
    return list(itertools.combinations(s, k)) if k >= 0 else []


@word("built-ins", name="set")
def as_set(s: Elements = ()) -> set[Any]:  # pyright: ignore[reportArgumentType]
    """The set of the elements of `s`."""
    try:
        return set(s)
    except TypeError:
        raise ProgramRuntimeError("set: a list or a set cannot be an element of a set") from None


@word("built-ins", name="len")
def length(s: Elements) -> int:
    """The number of elements of `s`, repetitions counted."""
    return len(s)


@word("built-ins", name="min")
def smallest(s: Elements, *, key: AFunction | None = None) -> Any:
    """The first of the elements x of `s` with the smallest key(x). An error when `s` is empty."""
    if not s:
        raise ProgramRuntimeError("min: s is empty")
    try:
        return min(s, key=key)
    except TypeError:
        raise ProgramRuntimeError(f"min: {described(s)} whose elements cannot be ordered") from None


@word("built-ins", name="all")
def every(s: Elements) -> bool:
    """Whether every element of `s` is true or not empty; true when `s` is empty."""
    return all(s)
