"""Lowering of words to generated code, for the words that take no functions.

A program that uses a word without a lowering is run by the reference evaluator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from functools import partial

from lilgym_mp.envs.fast import box_functions
from lilgym_mp.envs.fast.ir import (
    AttributeSet,
    AttributeValue,
    Bool,
    BoxCall,
    Boxes,
    Int,
    ItemMask,
    Items,
    Number,
    Value,
    as_truth,
    narrow,
    operate,
    unsupported,
)
from lilgym_mp.programs.values import ATTRIBUTE_TYPES
from lilgym_mp.programs.words import WORDS, Word


def _lower_exist(s: Value) -> Bool:
    if not isinstance(s, Items | Boxes | AttributeSet):
        unsupported("exist")
    return as_truth(s)


def _lower_count(s: Value) -> Int:
    match s:
        case Items():
            return Int(operate("+", *(part.count for part in s.parts)))
        case Boxes():
            return Int(operate("+", Number(0), *s.conditions))
        case AttributeSet():
            return Int(operate("bit_count", s.code))
        case _:
            unsupported("count")


# Words with one variant per attribute


def _lower_values(attribute: str, s: Value) -> AttributeSet:
    if not isinstance(s, Items):
        unsupported("values")
    bits = [
        operate("<<", narrow(part, _value_mask(value, part.box)).nonempty, Number(value.value))
        for part in s.parts
        for value in ATTRIBUTE_TYPES[attribute]
    ]
    return AttributeSet(operate("|", *bits))


def _lower_filter(attribute: str, s: Value, value: Value) -> Items:
    if not isinstance(s, Items) or not isinstance(value, AttributeValue):
        unsupported("filter")
    if not isinstance(value.value, ATTRIBUTE_TYPES[attribute]):
        unsupported("filter by another attribute")
    return Items(tuple(narrow(part, _value_mask(value.value, part.box)) for part in s.parts))


def _value_mask(value: Enum, box: str) -> ItemMask:
    """The mask of the test for a colour, shape or size, such as `is_yellow`."""
    test = WORDS[f"is_{value.name.lower()}"]
    return ItemMask(BoxCall(box, test.name, box_functions.vectorised_test(test, ())))


def _lower_all_same(attribute: str, s: Value) -> Bool:
    return Bool(operate("==", _lower_count(_lower_values(attribute, s)).code, Number(1)))


_LOWERINGS: Mapping[str, Callable[..., Value]] = {  # by the form of the word
    "exist": _lower_exist,
    "count": _lower_count,
    "len": _lower_count,
    "get_set_{}s": _lower_values,
    "filter_{}": _lower_filter,
    "all_same_{}": _lower_all_same,
}


def lowering_of(word: Word) -> Callable[..., Value] | None:
    """What lowers a call of the word, given its arguments; None if nothing does."""
    lower = _LOWERINGS.get(word.form)
    return partial(lower, word.attribute) if lower is not None and word.attribute else lower
