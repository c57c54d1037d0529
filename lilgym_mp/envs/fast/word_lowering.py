"""Lowering of words to generated code, for the words that take no functions.

A program that uses a word without a lowering is run by the reference evaluator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from functools import partial

from lilgym_mp.envs.fast import box_functions, ir
from lilgym_mp.envs.fast.ir import AttributeSet, Bool, Items, StaticList, Value, operate, unsupported
from lilgym_mp.programs.words import WORDS, Word


def _lower_exist(s: Value) -> Bool:
    if not isinstance(s, Items | StaticList | AttributeSet | ir.Combinations):
        unsupported("exist")
    return ir.as_truth(s)


def _lower_count(s: Value) -> ir.Int:
    match s:
        case Items():
            return ir.Int(operate("+", *(part.count for part in s.parts)), s.total)
        case AttributeSet():
            return ir.Int(operate("bit_count", s.code), s.total)
        case ir.Combinations():
            return ir.Int(s.count, s.total)
        case StaticList():
            present: dict[object, list[ir.Code]] = {}  # conditions of each object; a box may be listed twice
            for index, (element, condition) in enumerate(zip(ir.settled(s).elements, s.conditions, strict=True)):
                if isinstance(element, ir.AttributeValue):
                    unsupported("count of attributes")
                present.setdefault(element if isinstance(element, ir.BoxRef) else index, []).append(condition.code)
            distinct = (operate("|", *codes) for codes in present.values())
            return ir.Int(operate("+", ir.Number(0), *distinct), s.total)
        case _:
            unsupported("count")


def _lower_len(s: Value) -> ir.Int:
    if not isinstance(s, StaticList):
        return _lower_count(s)
    return ir.Int(operate("+", ir.Number(0), *(condition.code for condition in ir.settled(s).conditions)), s.total)


def _lower_unique(s: Value) -> ir.ItemRef:
    if not isinstance(s, Items) or len(s.parts) != 1:
        unsupported("unique")
    return ir.ItemRef(operate("only", s.parts[0].mask), total=False, box=s.parts[0].box)


def _lower_set(s: Value) -> Items | AttributeSet:
    match s:
        case Items():
            return Items(tuple(sorted(s.parts, key=lambda part: part.box)), ordered=False)
        case AttributeSet():
            return s
        case StaticList() if s.unconditional:
            return ir.attribute_set(s.elements)
        case _:
            unsupported("set")


def _lower_set_operation(sign: str, a: Value, b: Value) -> Value:
    a = _lower_set(a)
    b = _lower_set(b)
    if isinstance(a, AttributeSet) and isinstance(b, AttributeSet) and a.enum is b.enum:
        return AttributeSet(operate(sign, a.code, b.code), ir.all_total((a, b)), enum=a.enum)
    if isinstance(a, Items) and isinstance(b, Items):
        pairs = ir.paired_by_box(a, b)
        parts = (ir.BoxItems(x.box, operate(sign, x.mask, y.mask), ir.all_total((x, y))) for x, y in pairs)
        return Items(tuple(parts), ordered=False)
    unsupported("set operation")


def _lower_contained(a: Value, b: Value) -> Bool:
    a = _lower_set(a)
    b = _lower_set(b)
    if isinstance(a, AttributeSet) and isinstance(b, AttributeSet) and a.enum is b.enum:
        outside = operate("&", a.code, operate("~", b.code))
        return Bool(operate("==", outside, ir.Number(0)), ir.all_total((a, b)))
    unsupported("contained")


def _lower_equal_set(a: Value, b: Value) -> Bool:
    return ir.equality(_lower_set(a), _lower_set(b))


# Words with one variant per attribute


def _lower_query(attribute: str, x: Value) -> StaticList:
    if not isinstance(x, ir.ItemRef):
        unsupported("query")
    return ir.static_list([ir.attribute_of(x, attribute)])


def _lower_values(attribute: str, s: Value) -> AttributeSet:
    if not isinstance(s, Items):
        unsupported("values")
    enum = ir.ATTRIBUTE_TYPES[attribute]
    bits = [
        operate("<<", ir.narrow(part, ir.ItemMask(_value_mask(value, part.box))).nonempty, ir.Number(value.value))
        for part in s.parts
        for value in enum
    ]
    return AttributeSet(operate("|", *bits), s.total, enum=enum)


def _lower_filter(attribute: str, s: Value, value: Value) -> Items:
    enum = ir.ATTRIBUTE_TYPES[attribute]
    if not isinstance(s, Items) or not isinstance(value, ir.AttributeValue) or value.enum is not enum:
        unsupported("filter")
    if not isinstance(value.code, ir.Number):
        unsupported("filter by a variable")
    wanted = enum(value.code.value)
    parts = (ir.narrow(part, ir.ItemMask(_value_mask(wanted, part.box))) for part in s.parts)
    return Items(tuple(parts), ordered=True)


def _value_mask(value: Enum, box: str) -> ir.Code:
    """The mask of the test for a colour, shape or size, such as `is_yellow`."""
    test = WORDS[f"is_{value.name.lower()}"]
    return ir.BoxCall(box, test.name, box_functions.vectorised_test(test, ()))


def _lower_all_same(attribute: str, s: Value) -> Bool:
    found = _lower_values(attribute, s)
    return Bool(operate("==", operate("bit_count", found.code), ir.Number(1)), found.total)


def _lower_equal_attribute(attribute: str, a: Value, b: Value) -> Bool:
    enum = ir.ATTRIBUTE_TYPES[attribute]
    for value in (a, b):
        for part in value.elements if isinstance(value, StaticList) else (value,):
            if not isinstance(part, ir.Attribute) or part.enum is not enum:
                unsupported("equality of attributes")
    return ir.equality(a, b)


_LOWERINGS: Mapping[str, Callable[..., Value]] = {  # by the form of the word
    "exist": _lower_exist,
    "count": _lower_count,
    "len": _lower_len,
    "unique": _lower_unique,
    "set": _lower_set,
    "union": partial(_lower_set_operation, "|"),
    "intersect": partial(_lower_set_operation, "&"),
    "contained": _lower_contained,
    "equal_set": _lower_equal_set,
    "member_of": ir.membership,
    "query_{}": _lower_query,
    "get_set_{}s": _lower_values,
    "filter_{}": _lower_filter,
    "all_same_{}": _lower_all_same,
    "equal_{}": _lower_equal_attribute,
}


def lowering_of(word: Word) -> Callable[..., Value] | None:
    """What lowers a call of the word, given its arguments; None if nothing does."""
    lower = _LOWERINGS.get(word.form)
    return partial(lower, word.attribute) if lower is not None and word.attribute else lower
