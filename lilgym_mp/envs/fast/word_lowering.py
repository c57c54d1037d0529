"""Lowering of words to generated code, for the words that take no functions.

A program that uses a word without a lowering is run by the reference evaluator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from functools import partial

from lilgym_mp.envs.fast import box_functions, ir
from lilgym_mp.programs.words import WORDS, Word


def _lower_exist(s: ir.Value) -> ir.Bool:
    if not isinstance(s, ir.Items | ir.StaticList | ir.AttributeSet | ir.Combinations):
        ir.unsupported("exist")
    return ir.as_truth(s)


def _lower_count(s: ir.Value) -> ir.Int:
    match s:
        case ir.Items():
            return ir.Int(ir.operate("+", *(part.count for part in s.parts)), s.total)
        case ir.AttributeSet():
            return ir.Int(ir.operate("bit_count", s.code), s.total)
        case ir.Combinations():
            return ir.Int(s.count, s.total)
        case ir.StaticList():
            present: dict[object, list[ir.Code]] = {}  # conditions of each object; a box may be listed twice
            for index, (element, condition) in enumerate(zip(ir.settled(s).elements, s.conditions, strict=True)):
                if isinstance(element, ir.AttributeValue):
                    ir.unsupported("count of attributes")
                present.setdefault(element if isinstance(element, ir.BoxRef) else index, []).append(condition.code)
            distinct = (ir.operate("|", *codes) for codes in present.values())
            return ir.Int(ir.operate("+", ir.Number(0), *distinct), s.total)
        case _:
            ir.unsupported("count")


def _lower_len(s: ir.Value) -> ir.Int:
    if not isinstance(s, ir.StaticList):
        return _lower_count(s)
    return ir.Int(ir.operate("+", ir.Number(0), *(condition.code for condition in ir.settled(s).conditions)), s.total)


def _lower_unique(s: ir.Value) -> ir.ItemRef:
    if not isinstance(s, ir.Items) or len(s.parts) != 1:
        ir.unsupported("unique")
    return ir.ItemRef(ir.operate("only", s.parts[0].mask), total=False, box=s.parts[0].box)


def _lower_set(s: ir.Value) -> ir.Items | ir.AttributeSet:
    match s:
        case ir.Items():
            return ir.Items(tuple(sorted(s.parts, key=lambda part: part.box)), ordered=False)
        case ir.AttributeSet():
            return s
        case ir.StaticList() if s.unconditional:
            return ir.attribute_set(s.elements)
        case _:
            ir.unsupported("set")


def _lower_set_operation(sign: str, a: ir.Value, b: ir.Value) -> ir.Value:
    a = _lower_set(a)
    b = _lower_set(b)
    if isinstance(a, ir.AttributeSet) and isinstance(b, ir.AttributeSet) and a.enum is b.enum:
        return ir.AttributeSet(ir.operate(sign, a.code, b.code), ir.all_total((a, b)), enum=a.enum)
    if isinstance(a, ir.Items) and isinstance(b, ir.Items):
        pairs = ir.paired_by_box(a, b)
        parts = (ir.BoxItems(x.box, ir.operate(sign, x.mask, y.mask), ir.all_total((x, y))) for x, y in pairs)
        return ir.Items(tuple(parts), ordered=False)
    ir.unsupported("set operation")


def _lower_contained(a: ir.Value, b: ir.Value) -> ir.Bool:
    a = _lower_set(a)
    b = _lower_set(b)
    if isinstance(a, ir.AttributeSet) and isinstance(b, ir.AttributeSet) and a.enum is b.enum:
        outside = ir.operate("&", a.code, ir.operate("~", b.code))
        return ir.Bool(ir.operate("==", outside, ir.Number(0)), ir.all_total((a, b)))
    ir.unsupported("contained")


def _lower_equal_set(a: ir.Value, b: ir.Value) -> ir.Bool:
    return ir.equality(_lower_set(a), _lower_set(b))


# Words with one variant per attribute


def _lower_query(attribute: str, x: ir.Value) -> ir.StaticList:
    if not isinstance(x, ir.ItemRef):
        ir.unsupported("query")
    return ir.static_list([ir.attribute_of(x, attribute)])


def _lower_values(attribute: str, s: ir.Value) -> ir.AttributeSet:
    if not isinstance(s, ir.Items):
        ir.unsupported("values")
    enum = ir.ATTRIBUTE_TYPES[attribute]
    bits = [
        ir.operate("<<", ir.narrow(part, ir.ItemMask(_value_mask(value, part.box))).nonempty, ir.Number(value.value))
        for part in s.parts
        for value in enum
    ]
    return ir.AttributeSet(ir.operate("|", *bits), s.total, enum=enum)


def _lower_filter(attribute: str, s: ir.Value, value: ir.Value) -> ir.Items:
    enum = ir.ATTRIBUTE_TYPES[attribute]
    if not isinstance(s, ir.Items) or not isinstance(value, ir.AttributeValue) or value.enum is not enum:
        ir.unsupported("filter")
    if not isinstance(value.code, ir.Number):
        ir.unsupported("filter by a variable")
    wanted = enum(value.code.value)
    parts = (ir.narrow(part, ir.ItemMask(_value_mask(wanted, part.box))) for part in s.parts)
    return ir.Items(tuple(parts), ordered=True)


def _value_mask(value: Enum, box: str) -> ir.Code:
    """The mask of the test for a colour, shape or size, such as `is_yellow`."""
    test = WORDS[f"is_{value.name.lower()}"]
    return ir.BoxCall(box, test.name, box_functions.vectorised_test(test, ()))


def _lower_all_same(attribute: str, s: ir.Value) -> ir.Bool:
    found = _lower_values(attribute, s)
    return ir.Bool(ir.operate("==", ir.operate("bit_count", found.code), ir.Number(1)), found.total)


def _lower_equal_attribute(attribute: str, a: ir.Value, b: ir.Value) -> ir.Bool:
    enum = ir.ATTRIBUTE_TYPES[attribute]
    for value in (a, b):
        for part in value.elements if isinstance(value, ir.StaticList) else (value,):
            if not isinstance(part, ir.Attribute) or part.enum is not enum:
                ir.unsupported("equality of attributes")
    return ir.equality(a, b)


_LOWERINGS: Mapping[str, Callable[..., ir.Value]] = {  # by the form of the word
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


def lowering_of(word: Word) -> Callable[..., ir.Value] | None:
    """What lowers a call of the word, given its arguments; None if nothing does."""
    lower = _LOWERINGS.get(word.form)
    return partial(lower, word.attribute) if lower is not None and word.attribute else lower
