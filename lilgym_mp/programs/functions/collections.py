"""Words about collections, and the Python built-ins that programs may use (docs/programs.md, "Sets", "Built-ins")."""

from __future__ import annotations

import itertools
from typing import Any

from lilgym_mp.programs import words
from lilgym_mp.programs.errors import ProgramRuntimeError
from lilgym_mp.programs.words import CollectionArg, word

MAX_BINOMIAL = 10**9  # exceeds every limit


def binomial(n: int, k: int) -> int:
    """The binomial coefficient (n over k), clipped to MAX_BINOMIAL to avoid computing huge integers."""
    if k < 0 or k > n:
        return 0
    ways = 1
    for index in range(min(k, n - k)):
        ways = ways * (n - index) // (index + 1)
        if ways >= MAX_BINOMIAL:
            return MAX_BINOMIAL
    return ways


def combinations_size(s: list[Any], k: int) -> words.ResultSize:
    """The size of `combinations(s, k)`."""
    return words.ResultSize(binomial(len(s), k), k, len(s))


def select_size(k: int, s: list[Any]) -> words.ResultSize:
    """The size of `select(k, s)`."""
    return combinations_size(s, k)


@word("sets")
def exist(s: CollectionArg) -> bool:
    """Whether `s` has at least one element."""
    return bool(s)


@word("sets")
def count(s: CollectionArg) -> int:
    """The number of distinct objects in `s`; items with equal attributes are still distinct."""
    return len({words.identity_key(x) for x in s})


@word("sets", fails_on="some values")
def unique(s: CollectionArg) -> Any:
    """The only element of `s`. An error unless there is exactly one."""
    if count(s) != 1:
        raise ProgramRuntimeError(f"unique: s must hold exactly one object, not {count(s)}")
    return s[0]


@word("sets")
def filter_obj(s: CollectionArg, f: words.FunctionArg) -> list[Any]:
    """The list of the x in `s`, in order, for which f(x) is truthy (true or not empty)."""
    return [x for x in s if f(x)]


@word("sets", fails_on="unhashable elements")
def union(a: CollectionArg, b: CollectionArg) -> set[Any]:
    """The union of `a` and `b`."""
    return as_set(a) | as_set(b)


@word("sets", fails_on="unhashable elements")
def intersect(a: CollectionArg, b: CollectionArg) -> set[Any]:
    """The intersection of `a` and `b`."""
    return as_set(a) & as_set(b)


@word("sets", fails_on="unhashable elements")
def union_all(sets: words.CollectionsArg) -> set[Any]:
    """The union of all `sets`; empty when there are none."""
    return as_set([x for part in sets for x in part])


@word("sets", fails_on="unhashable elements")
def intersect_all(sets: words.CollectionsArg) -> set[Any]:
    """The intersection of all `sets`; empty when there are none."""
    return as_set(sets[0]).intersection(*map(as_set, sets[1:])) if sets else set()


@word("sets", fails_on="unhashable elements")
def contained(a: CollectionArg, b: CollectionArg) -> bool:
    """Whether every element of `a` is in `b`."""
    return as_set(a) <= as_set(b)


@word("sets", fails_on="unhashable elements")
def equal_set(a: CollectionArg, b: CollectionArg) -> bool:
    """Whether `a` and `b` have the same elements, ignoring order and repetition."""
    return as_set(a) == as_set(b)


@word("sets")
def member_of(x: words.AnyArg, s: CollectionArg) -> bool:
    """Whether `x` is in `s`."""
    return x in s


@word("sets", result_size=select_size, fails_on="some values")
def select(k: words.IntArg, s: CollectionArg) -> list[list[Any]]:
    """All sub-lists of `s` with `k` elements, in order."""
    return [list(choice) for choice in itertools.combinations(s, k)] if k >= 0 else []


@word("sets", result_size=combinations_size, fails_on="some values")
def combinations(s: CollectionArg, k: words.IntArg) -> list[tuple[Any, ...]]:
    """All `k`-element combinations of `s` as tuples, in order."""
    return list(itertools.combinations(s, k)) if k >= 0 else []


@word("built-ins", name="set", fails_on="unhashable elements")
def as_set(s: CollectionArg = ()) -> set[Any]:  # pyright: ignore[reportArgumentType]
    """The set of the elements of `s`."""
    try:
        return set(s)
    except TypeError:
        raise ProgramRuntimeError("set: a list or a set cannot be an element of a set") from None


@word("built-ins", name="len")
def length(s: CollectionArg) -> int:
    """The number of elements of `s`, repetitions counted."""
    return len(s)


@word("built-ins", name="min", fails_on="some values", reads_order=True)
def smallest(s: CollectionArg, *, key: words.FunctionArg | None = None) -> Any:
    """The first x in `s` with the smallest key(x). An error when `s` is empty."""
    if not s:
        raise ProgramRuntimeError("min: s is empty")
    try:
        return min(s, key=key)
    except TypeError:
        raise ProgramRuntimeError(f"min: cannot order the elements of {words.describe(s)}") from None


@word("built-ins", name="all")
def every(s: CollectionArg) -> bool:
    """Whether every element of `s` is truthy (true or not empty); true when `s` is empty."""
    return all(s)
