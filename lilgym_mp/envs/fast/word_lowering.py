"""Lowering of words to generated code, for the words that take no functions.

A program that uses a word without a lowering is run by the reference evaluator.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from enum import Enum
from typing import Any, Protocol

from lilgym_mp.envs.fast import box_functions, ir
from lilgym_mp.programs import costs
from lilgym_mp.programs.functions.collections import binomial
from lilgym_mp.programs.words import WORDS

MAX_TUPLES = 100  # combinations of static elements, which are unrolled


class Generator(Protocol):
    """The part of the code generator that lowerings use."""

    def box_call(self, name: str, function: Any, box: str) -> ir.Code: ...
    def attribute_of(self, item: ir.ItemRef, name: str) -> ir.AttributeValue: ...
    def membership(self, value: ir.Value, collection: ir.Value) -> ir.Bool: ...
    def charge(self, steps: int) -> None: ...


def _lower_exist(_: Generator, s: ir.Value) -> ir.Bool:
    if not isinstance(s, ir.Items | ir.StaticList | ir.Combinations | ir.AttributeSet | ir.AttributeList):
        ir.unsupported("exist")
    return ir.as_truth(s)


def _lower_count(_: Generator, s: ir.Value) -> ir.Int:
    match s:
        case ir.Items():
            return ir.Int(ir.operate("+", *(part.count for part in s.parts)), s.total)
        case ir.StaticList():
            present: dict[object, list[ir.Code]] = {}  # conditions of each object; a box may be listed twice
            for index, (element, condition) in enumerate(zip(s.elements, s.conditions, strict=True)):
                present.setdefault(element if isinstance(element, ir.BoxRef) else index, []).append(condition.code)
            return ir.Int(
                ir.operate("+", ir.Number(0), *(ir.operate("|", *codes) for codes in present.values())), s.total
            )
        case ir.AttributeSet():
            return ir.Int(ir.operate("bit_count", s.code), s.total)
        case ir.AttributeList():
            return ir.Int(ir.operate("distinct", s.code), s.total)
        case ir.Combinations():
            return ir.Int(s.count, s.total)
        case _:
            ir.unsupported("count")


def _lower_len(generator: Generator, s: ir.Value) -> ir.Int:
    match s:
        case ir.AttributeList():
            return ir.Int(ir.operate("len", s.code), s.total)
        case ir.StaticList():
            return ir.Int(ir.operate("+", ir.Number(0), *(condition.code for condition in s.conditions)), s.total)
        case _:
            return _lower_count(generator, s)


def _lower_unique(_: Generator, s: ir.Value) -> ir.ItemRef | ir.UniqueItem:
    if not isinstance(s, ir.Items):
        ir.unsupported("unique")
    if len(s.parts) != 1:
        return ir.UniqueItem(s)
    return ir.ItemRef(ir.operate("only", s.parts[0].mask), total=False, box=s.parts[0].box)


def _lower_set(_: Generator, s: ir.Value) -> ir.Value:
    match s:
        case ir.Items():
            return ir.Items(tuple(sorted(s.parts, key=lambda part: part.box)), ordered=False)
        case ir.AttributeSet():
            return s
        case ir.StaticList() if s.unconditional:
            boxes = {element.box for element in s.elements if isinstance(element, ir.BoxRef)}
            if not all(isinstance(element, ir.BoxRef) for element in s.elements):
                ir.unsupported("set")
            return ir.StaticList(tuple(map(ir.BoxRef, sorted(boxes))), (ir.TRUE,) * len(boxes), ordered=False)
        case ir.AttributeList():
            return ir.AttributeSet(ir.operate("mask_of", s.code), s.total, enum=s.enum)
        case _:
            ir.unsupported("set")


def _lower_set_operation(sign: str) -> Callable[..., ir.Value]:
    def lower(generator: Generator, a: ir.Value, b: ir.Value) -> ir.Value:
        a, b = _lower_set(generator, a), _lower_set(generator, b)
        if isinstance(a, ir.AttributeSet) and isinstance(b, ir.AttributeSet) and a.enum is b.enum:
            return ir.AttributeSet(ir.operate(sign, a.code, b.code), ir.all_total((a, b)), enum=a.enum)
        if isinstance(a, ir.Items) and isinstance(b, ir.Items):
            pairs = ir.paired_by_box(a, b)
            parts = (ir.BoxItems(x.box, ir.operate(sign, x.mask, y.mask), ir.all_total((x, y))) for x, y in pairs)
            return ir.Items(tuple(parts), ordered=False)
        ir.unsupported("set operation")

    return lower


def _lower_contained(generator: Generator, a: ir.Value, b: ir.Value) -> ir.Bool:
    a, b = _lower_set(generator, a), _lower_set(generator, b)
    total = ir.all_total((a, b))
    if isinstance(a, ir.AttributeSet) and isinstance(b, ir.AttributeSet) and a.enum is b.enum:
        return ir.Bool(_is_contained(a.code, b.code), total)
    if isinstance(a, ir.Items) and isinstance(b, ir.Items):
        return ir.conjunction((_is_contained(x.mask, y.mask) for x, y in ir.paired_by_box(a, b)), total=total)
    ir.unsupported("contained")


def _is_contained(mask: ir.Code, other: ir.Code) -> ir.Code:
    return ir.operate("==", ir.operate("&", mask, ir.operate("~", other)), ir.Number(0))


def _lower_equal_set(generator: Generator, a: ir.Value, b: ir.Value) -> ir.Bool:
    return ir.equality(_lower_set(generator, a), _lower_set(generator, b))


def _lower_equal(generator: Generator, a: ir.Value, b: ir.Value) -> ir.Bool:
    if isinstance(a, ir.Items) and isinstance(b, ir.Items) and a.ordered != b.ordered:
        return _lower_equal_set(generator, a, b)
    return ir.equality(a, b)


def _lower_member_of(generator: Generator, x: ir.Value, s: ir.Value) -> ir.Bool:
    return generator.membership(x, s)


def _lower_combinations(generator: Generator, s: ir.Value, k: ir.Value) -> ir.StaticList | ir.Combinations:
    size = k.code.value if isinstance(k, ir.Int) and isinstance(k.code, ir.Number) else ir.unsupported("combinations")
    if isinstance(s, ir.Items) and size in (2, 3):
        items = ir.operate("+", *(part.count for part in s.parts))
        combined = ir.Combinations(s.parts, size, ir.operate("comb", items, k.code), s.total)
        count = binomial(ir.MAX_ITEMS, size)
        if len({part.box for part in s.parts}) == len(s.parts) and count <= costs.SIZE_LIMIT:
            generator.charge(costs.SUBSET_ELEMENT * (1 + 2 * size) * count)  # at most 2 elements an item: `ResultSize`
            return combined
        ir.unsupported("combinations")
    if not isinstance(s, ir.StaticList) or not s.unconditional:
        ir.unsupported("combinations")
    count = binomial(len(s.elements), size)
    if count > MAX_TUPLES:
        ir.unsupported("combinations of many")
    generator.charge(costs.SUBSET_ELEMENT * (1 + size) * (1 + count) * ir.max_elements(s))
    chosen = itertools.combinations(s.elements, size)
    tuples = tuple(ir.StaticList(elements, (ir.TRUE,) * len(elements)) for elements in chosen)
    return ir.StaticList(tuples, (ir.TRUE,) * len(tuples))


# Words with one variant per attribute


def _lower_query(attribute: str) -> Callable[..., ir.AttributeList]:
    def lower(generator: Generator, x: ir.Value) -> ir.AttributeList:
        if isinstance(x, ir.ItemRef):
            value = generator.attribute_of(x, attribute)
            return ir.AttributeList(ir.Listed((value.code,)), value.total, enum=value.enum)
        if not isinstance(x, ir.Items):
            ir.unsupported("query")
        field = ir.ITEM_FIELDS[attribute]
        lists = (ir.FieldList(part.box, part.mask, field) for part in x.parts)
        return ir.AttributeList(ir.operate("+", *lists), x.total, enum=ir.ATTRIBUTE_TYPES[attribute])

    return lower


def _lower_values(attribute: str) -> Callable[..., ir.AttributeSet]:
    enum = ir.ATTRIBUTE_TYPES[attribute]

    def lower(generator: Generator, s: ir.Value) -> ir.AttributeSet:
        if not isinstance(s, ir.Items):
            ir.unsupported("values")
        found = [
            ir.operate("occurring", part.mask, *(_value_mask(generator, value, part.box) for value in enum))
            for part in s.parts
        ]
        return ir.AttributeSet(ir.operate("|", *found), s.total, enum=enum)

    return lower


def _lower_filter(attribute: str) -> Callable[..., ir.Items]:
    enum = ir.ATTRIBUTE_TYPES[attribute]

    def lower(generator: Generator, s: ir.Value, value: ir.Value) -> ir.Items:
        if not isinstance(s, ir.Items) or not isinstance(value, ir.AttributeValue) or value.enum is not enum:
            ir.unsupported("filter")
        if not isinstance(value.code, ir.Number):
            ir.unsupported("filter by a variable")
        wanted = enum(value.code.value)
        parts = (ir.narrow(part, ir.ItemMask(_value_mask(generator, wanted, part.box))) for part in s.parts)
        return ir.Items(tuple(parts), ordered=True)

    return lower


def _value_mask(generator: Generator, value: Enum, box: str) -> ir.Code:
    """The mask of the test for a colour, shape or size, such as `is_yellow`."""
    test = WORDS[f"is_{value.name.lower()}"]
    return generator.box_call(test.name, box_functions.vectorised_test(test, ()), box)


def _lower_all_same(attribute: str) -> Callable[..., ir.Bool]:
    values = _lower_values(attribute)

    def lower(generator: Generator, s: ir.Value) -> ir.Bool:
        found = values(generator, s)
        return ir.Bool(ir.operate("==", ir.operate("bit_count", found.code), ir.Number(1)), found.total)

    return lower


def _lower_equal_attribute(attribute: str) -> Callable[..., ir.Bool]:
    enum = ir.ATTRIBUTE_TYPES[attribute]

    def lower(_: Generator, a: ir.Value, b: ir.Value) -> ir.Bool:
        for value in (a, b):
            if not isinstance(value, ir.Attribute) or value.enum is not enum:
                ir.unsupported("equality of attributes")
        return ir.equality(a, b)

    return lower


BINARY_WORDS: dict[str, tuple[type, str]] = {
    "AND": (ir.Bool, "and"),
    "OR": (ir.Bool, "or"),
    "NOT": (ir.Bool, "not"),
    "le": (ir.Int, "<="),
    "ge": (ir.Int, ">="),
    "lt": (ir.Int, "<"),
    "gt": (ir.Int, ">"),
    "equal_int": (ir.Int, "=="),
}
VALUE_WORDS: dict[str, Callable[..., ir.Value]] = {
    "exist": _lower_exist,
    "count": _lower_count,
    "len": _lower_len,
    "unique": _lower_unique,
    "set": _lower_set,
    "union": _lower_set_operation("|"),
    "intersect": _lower_set_operation("&"),
    "contained": _lower_contained,
    "equal_set": _lower_equal_set,
    "equal": _lower_equal,
    "member_of": _lower_member_of,
    "combinations": _lower_combinations,
}
ATTRIBUTE_WORDS: dict[str, Callable[..., ir.Value]] = {
    pattern.format(attribute): lower(attribute)
    for attribute in ir.ATTRIBUTE_TYPES
    for pattern, lower in {
        "query_{}": _lower_query,
        "get_set_{}s": _lower_values,
        "filter_{}": _lower_filter,
        "all_same_{}": _lower_all_same,
        "equal_{}": _lower_equal_attribute,
    }.items()
}
