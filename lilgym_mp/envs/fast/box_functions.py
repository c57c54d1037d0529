"""Words vectorised over a box: a test of an item becomes a bitmask, a relation one bitmask per item.

Bit i represents the i-th item of the box. Results are computed by the words' own functions and memoised in `box.memo`:
boxes are immutable, and consecutive scenes share them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from enum import Enum
from functools import cache, lru_cache
from typing import Any, NamedTuple

from lilgym_mp.programs.compiler import MAX_MEMO, forget_programs
from lilgym_mp.programs.errors import FallbackError
from lilgym_mp.programs.values import BoxView, ItemView
from lilgym_mp.programs.words import Dependency, Word
from lilgym_mp.scene import Box, Colour, Item, Shape, Size

MAX_BOX_ITEMS = 24  # larger boxes use the reference evaluator, which counts steps
TABLE_SIZE = 20_000  # cached items per test
ITEM_TYPE_FIELDS = tuple(map(Item._fields.index, ("shape", "colour", "size")))

Mask = int
BoxFunction = Callable[[Box], Any]


_BITS = tuple(1 << index for index in range(MAX_BOX_ITEMS))
_EMPTY_BOX = BoxView(Box())  # placeholder for tests that do not depend on the box


def memoised(key: str, compute: BoxFunction) -> BoxFunction:
    """The function of a box, memoised in `box.memo`. Raises FallbackError for a box with too many items."""

    def value_of(box: Box) -> Any:
        value = box.memo.get(key)
        if value is None:
            if len(box.items) > MAX_BOX_ITEMS:
                raise FallbackError
            if len(box.memo) >= MAX_MEMO:
                forget_programs(box.memo)
            value = box.memo[key] = compute(box)
        return value

    return value_of


@cache
def vectorised_test(word: Word, constants: tuple[Enum, ...]) -> Callable[[Box], Mask]:
    """The bitmask of a box's items for which the word, given the constants as further arguments, is true."""

    def mask_of_view(box: Box) -> Mask:
        return sum([1 << view.index for view in _view(box).members if word.function(view, *constants)])

    @lru_cache(TABLE_SIZE)
    def passes(item: Item) -> bool:
        return word.function(ItemView(item, _EMPTY_BOX, 0), *constants)

    def mask_of(box: Box) -> Mask:
        return sum([bit for bit, item in zip(_BITS, box.items, strict=False) if passes(item)])

    def mask_by_field(box: Box) -> Mask:  # the most frequent case, so without calls
        return sum([bit for bit, item in zip(_BITS, box.items, strict=False) if item[field] == value])

    key = " ".join(("program test", word.name, *map(str, constants)))
    if not word.depends_on_item_only:
        return memoised(key, mask_of_view)
    tested = _tested_field(passes) if word.depends_on == "attributes" else None
    field, value = tested or (0, 0)
    function = memoised(key, mask_of if tested is None else mask_by_field)
    ITEM_TESTS[function] = ItemTest(passes.__wrapped__, word.depends_on)
    return function


class ItemTest(NamedTuple):
    """The per-item predicate of a vectorised test."""

    passes: Callable[[Item], bool]
    depends_on: Dependency  # "attributes", "position" or "item"


ITEM_TESTS: dict[BoxFunction, ItemTest] = {}  # of the vectorised tests that do not depend on the whole box


@cache
def vectorised_relation(word: Word) -> Callable[[Box], Sequence[Mask]]:
    """The relation on a box's items: by item index, the bitmask of related items."""

    def masks_of(box: Box) -> list[Mask]:
        return [sum([1 << view.index for view in word.function(member)]) for member in _view(box).members]

    return memoised(f"program relation {word.name}", masks_of)


is_tower: Callable[[Box], bool] = memoised("program is_tower", lambda box: _view(box).is_tower())


def _tested_field(passes: Callable[[Item], bool]) -> tuple[int, int] | None:
    """The field and value that a test of the item type compares; None if it compares more than one."""
    items = [Item(0, 0, *fields) for fields in itertools.product(Shape, Colour, Size)]
    for field, value in itertools.product(ITEM_TYPE_FIELDS, range(3)):
        if all(passes(item) == (item[field] == value) for item in items):
            return field, value
    return None


def _view(box: Box) -> BoxView:
    view = box.memo.get("program view")
    if view is None:
        view = box.memo["program view"] = BoxView(box)
    return view


def _bits(mask: int) -> list[int]:
    """The positions of the set bits of a mask, ascending."""
    positions: list[int] = []
    while mask:
        low = mask & -mask
        positions.append(low.bit_length() - 1)
        mask ^= low
    return positions


def _only(mask: int) -> int:
    """The position of the only set bit of a mask. Raises FallbackError unless there is exactly one."""
    if mask == 0 or mask & (mask - 1):
        raise FallbackError
    return mask.bit_length() - 1


def _union(rows: Sequence[Mask], mask: Mask) -> Mask:
    union = 0
    for position in _bits(mask):
        union |= rows[position]
    return union


# The only names that generated code can use, besides functions of a box
NAMES: dict[str, Any] = {
    "__builtins__": {"len": len, "sum": sum, "bool": bool},
    "bits": _bits,
    "only": _only,
    "union": _union,
    "choose": itertools.combinations,
    "comb": math.comb,
}
