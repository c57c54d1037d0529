"""Lowering of words to generated code, for the words that take no functions.

A program that uses a word without a lowering is run by the reference evaluator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from functools import partial

from lilgym_mp.envs.fast import box_functions, ir
from lilgym_mp.programs.values import ATTRIBUTE_TYPES
from lilgym_mp.programs.words import WORDS, Word


def _lower_exist(s: ir.Value) -> ir.Bool:
    if not isinstance(s, ir.Items | ir.Boxes | ir.AttributeSet):
        ir.unsupported("exist")
    return ir.as_truth(s)


def _lower_count(s: ir.Value) -> ir.Int:
    match s:
        case ir.Items():
            return ir.Int(ir.operate("+", *(part.count for part in s.parts)))
        case ir.Boxes():
            return ir.Int(ir.operate("+", ir.Number(0), *s.conditions))
        case ir.AttributeSet():
            return ir.Int(ir.operate("bit_count", s.code))
        case _:
            ir.unsupported("count")


# Words with one variant per attribute


def _lower_values(attribute: str, s: ir.Value) -> ir.AttributeSet:
    if not isinstance(s, ir.Items):
        ir.unsupported("values")
    bits = [
        ir.operate("<<", ir.narrow(part, _value_mask(value, part.box)).nonempty, ir.Number(value.value))
        for part in s.parts
        for value in ATTRIBUTE_TYPES[attribute]
    ]
    return ir.AttributeSet(ir.operate("|", *bits))


def _lower_filter(attribute: str, s: ir.Value, value: ir.Value) -> ir.Items:
    if not isinstance(s, ir.Items) or not isinstance(value, ir.AttributeValue):
        ir.unsupported("filter")
    if not isinstance(value.value, ATTRIBUTE_TYPES[attribute]):
        ir.unsupported("filter by another attribute")
    return ir.Items(tuple(ir.narrow(part, _value_mask(value.value, part.box)) for part in s.parts))


def _value_mask(value: Enum, box: str) -> ir.ItemMask:
    """The mask of the test for a colour, shape or size, such as `is_yellow`."""
    test = WORDS[f"is_{value.name.lower()}"]
    return ir.ItemMask(ir.BoxCall(box, test.name, box_functions.vectorised_test(test, ())))


def _lower_all_same(attribute: str, s: ir.Value) -> ir.Bool:
    return ir.Bool(ir.operate("==", _lower_count(_lower_values(attribute, s)).code, ir.Number(1)))


_LOWERINGS: Mapping[str, Callable[..., ir.Value]] = {  # by the form of the word
    "exist": _lower_exist,
    "count": _lower_count,
    "len": _lower_count,
    "get_set_{}s": _lower_values,
    "filter_{}": _lower_filter,
    "all_same_{}": _lower_all_same,
}


def lowering_of(word: Word) -> Callable[..., ir.Value] | None:
    """What lowers a call of the word, given its arguments; None if nothing does."""
    lower = _LOWERINGS.get(word.form)
    return partial(lower, word.attribute) if lower is not None and word.attribute else lower
