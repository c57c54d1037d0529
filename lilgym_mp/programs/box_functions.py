"""Words of one item lifted to whole boxes: a test becomes a bit mask, a relation a mask for each item.

Bit i stands for the i-th item of the box. BoxFunction values come from the words' own definitions, and are kept
in `box.memo`: a box never changes, and play shares boxes between scenes.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from enum import Enum
from functools import cache
from typing import Any, NamedTuple

from lilgym_mp.programs.values import BoxView, ItemView
from lilgym_mp.programs.words import Dependency, Word
from lilgym_mp.scene import Box, Colour, Item, Shape, Size

MAX_BOX_ITEMS = 24  # beyond, programs are run in their reference form, which counts its steps
TABLE_SIZE = 20_000  # items whose value a test of the item alone remembers
ITEM_TYPE_FIELDS = tuple(map(Item._fields.index, ("shape", "colour", "size")))

Mask = int
Test = Callable[[ItemView], bool]
BoxFunction = Callable[[Box], Any]


class FallbackError(Exception):
    """The fast form cannot tell: the reference form must."""


class _Table(dict[Item, bool]):
    """The value of a test that depends on the item alone, by item."""

    def __init__(self, test: Test) -> None:
        self.test = test

    def __missing__(self, item: Item) -> bool:
        if len(self) >= TABLE_SIZE:
            self.clear()
        value = self[item] = self.test(ItemView(item, _NOWHERE, 0))
        return value


_NOWHERE = BoxView(Box())


def check_size(box: Box) -> None:
    """Raises FallbackError for a box that holds more items than the fast form takes."""
    if len(box.items) > MAX_BOX_ITEMS:
        raise FallbackError


@cache
def vectorised_test(word: Word, constants: tuple[Enum, ...]) -> Callable[[Box], Mask]:
    """The mask of a box's items for which the word, with these further arguments, is true."""

    def test(view: ItemView) -> bool:
        return word.function(view, *constants)

    key = " ".join(("program test", word.name, *map(str, constants)))
    if word.depends_on == "attributes":
        return _by_item_type(key, test)
    return _by_item(key, test, word.depends_on) if word.depends_on_item_only else _by_box(key, test)


@cache
def vectorised_attribute(attribute: str, value: Enum) -> Callable[[Box], Mask]:
    """The mask of a box's items that have the value: attribute is color, shape or size."""
    return _by_item_type(f"program attribute {value}", lambda view: getattr(view, attribute) is value)


class ItemTest(NamedTuple):
    """What a lifted function asks of each item by itself."""

    passes: Callable[[Item], bool]
    depends_on: Dependency  # "attributes", "position" or "item"


def item_test(lifted: BoxFunction) -> ItemTest | None:
    """What a lifted function asks of each item, None where it asks about the box."""
    return _ITEM_TESTS.get(lifted)


_ITEM_TESTS: dict[BoxFunction, ItemTest] = {}


def _alone(test: Test, depends_on: Dependency) -> ItemTest:
    def passes(item: Item) -> bool:
        return test(ItemView(item, _NOWHERE, 0))

    return ItemTest(passes, depends_on)


class _Rows(dict[int, Mask]):
    """By index of an item, the mask of the items related to it; found when asked for, as programs ask for few.

    To be indexed: going over it tells only of the items that were asked about.
    """

    def __init__(self, word: Word, box: Box) -> None:
        self._related = word.function
        self._box = box

    def __missing__(self, index: int) -> Mask:
        related = self._related(_view(self._box).members[index])
        row = self[index] = sum([1 << view.index for view in related])
        return row


@cache
def vectorised_relation(word: Word) -> Callable[[Box], Mapping[int, Mask]]:
    """For each item of a box, by index, the mask of the items related to it."""
    key = f"program relation {word.name}"

    def lifted(box: Box) -> Mapping[int, Mask]:
        rows = box.memo.get(key)
        if rows is None:
            check_size(box)
            rows = box.memo[key] = _Rows(word, box)
        return rows

    return lifted


def is_tower(box: Box) -> bool:
    """`BoxView.is_tower`, remembered."""
    value = box.memo.get("program is_tower")
    if value is None:
        value = box.memo["program is_tower"] = _view(box).is_tower()
    return value


def _by_item_type(key: str, test: Test) -> Callable[[Box], Mask]:
    """Few item types pass, mostly those with one value of one field, which is the quickest test."""
    items = [Item(0, 0, *fields) for fields in itertools.product(Shape, Colour, Size)]
    passing = frozenset(item for item in items if test(ItemView(item, _NOWHERE, 0)))
    for field, value in {(field, item[field]) for item in passing for field in ITEM_TYPE_FIELDS}:
        if passing == frozenset(item for item in items if item[field] == value):
            lifted = _by_field(key, field, int(value))
            _ITEM_TESTS[lifted] = _alone(test, "attributes")
            return lifted
    return _by_item(key, test, "attributes")


def _by_field(key: str, field: int, value: int) -> Callable[[Box], Mask]:
    def lifted(box: Box) -> Mask:
        mask = box.memo.get(key)
        if mask is None:
            items = box.items
            if len(items) > MAX_BOX_ITEMS:
                raise FallbackError
            mask, bit = 0, 1
            for item in items:
                if item[field] == value:
                    mask |= bit
                bit <<= 1
            box.memo[key] = mask
        return mask

    return lifted


def _by_item(key: str, test: Test, depends_on: Dependency) -> Callable[[Box], Mask]:
    table = _Table(test)

    def lifted(box: Box) -> Mask:
        mask = box.memo.get(key)
        if mask is None:
            items = box.items
            if len(items) > MAX_BOX_ITEMS:
                raise FallbackError
            mask, bit = 0, 1
            for item in items:
                if table[item]:
                    mask |= bit
                bit <<= 1
            box.memo[key] = mask
        return mask

    _ITEM_TESTS[lifted] = _alone(test, depends_on)
    return lifted


def _by_box(key: str, test: Test) -> Callable[[Box], Mask]:
    def lifted(box: Box) -> Mask:
        mask = box.memo.get(key)
        if mask is None:
            check_size(box)
            mask = box.memo[key] = sum([1 << view.index for view in _view(box).members if test(view)])
        return mask

    return lifted


def _view(box: Box) -> BoxView:
    view = box.memo.get("program view")
    if view is None:
        view = box.memo["program view"] = BoxView(box)
    return view
