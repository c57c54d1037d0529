"""Lowering of words to generated code, for the words that take no functions.

A program that uses a word without a lowering is run by the reference evaluator.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from enum import Enum
from typing import Any, Protocol

from lilgym_mp.programs import box_functions, costs
from lilgym_mp.programs.functions.collections import binomial
from lilgym_mp.programs.ir import (
    ATTRIBUTE_TYPES,
    ITEM_FIELDS,
    MAX_ITEMS,
    TRUE,
    AttributeList,
    AttributeSet,
    AttributeValue,
    Bool,
    BoxItems,
    BoxRef,
    Code,
    Combinations,
    Int,
    ItemMask,
    ItemRef,
    Items,
    Number,
    StaticList,
    UniqueItem,
    Value,
    all_total,
    as_truth,
    bit_count,
    conjunction,
    equality,
    invert,
    max_elements,
    narrow,
    number,
    occurring,
    only,
    operate,
    paired_by_box,
    unsupported,
)

MAX_TUPLES = 100  # combinations of static elements, which are unrolled


class Generator(Protocol):
    """The part of the code generator that lowerings use."""

    def box_call(self, name: str, function: Any, box: str) -> Code: ...
    def attribute_of(self, item: ItemRef, name: str) -> AttributeValue: ...
    def membership(self, value: Value, collection: Value) -> Bool: ...
    def charge(self, steps: int) -> None: ...


def _lower_exist(_: Generator, s: Value) -> Bool:
    if not isinstance(s, Items | StaticList | Combinations | AttributeSet | AttributeList):
        unsupported("exist")
    return as_truth(s)


def _lower_count(_: Generator, s: Value) -> Int:
    match s:
        case Items():
            return Int(operate("+", *(part.count for part in s.parts)), s.total)
        case StaticList():
            present: dict[object, list[Code]] = {}  # conditions of each object; a box may be listed twice
            for index, (element, condition) in enumerate(zip(s.elements, s.conditions, strict=True)):
                present.setdefault(element if isinstance(element, BoxRef) else index, []).append(condition.code)
            return Int(operate("+", number(0), *(operate("|", *codes) for codes in present.values())), s.total)
        case AttributeSet():
            return Int(bit_count(s.code), s.total)
        case AttributeList():
            return Int(Code(f"len(set({s.text}))"), s.total)
        case Combinations():
            return Int(s.count, s.total)
        case _:
            unsupported("count")


def _lower_len(generator: Generator, s: Value) -> Int:
    match s:
        case AttributeList():
            return Int(Code(f"len({s.text})"), s.total)
        case StaticList():
            return Int(operate("+", number(0), *(condition.code for condition in s.conditions)), s.total)
        case _:
            return _lower_count(generator, s)


def _lower_unique(_: Generator, s: Value) -> ItemRef | UniqueItem:
    if not isinstance(s, Items):
        unsupported("unique")
    if len(s.parts) != 1:
        return UniqueItem(s)
    return ItemRef(only(s.parts[0].mask), total=False, box=s.parts[0].box)


def _lower_set(_: Generator, s: Value) -> Value:
    match s:
        case Items():
            return Items(tuple(sorted(s.parts, key=lambda part: part.box)), ordered=False)
        case AttributeSet():
            return s
        case StaticList() if s.unconditional:
            boxes = {element.box for element in s.elements if isinstance(element, BoxRef)}
            if not all(isinstance(element, BoxRef) for element in s.elements):
                unsupported("set")
            return StaticList(tuple(map(BoxRef, sorted(boxes))), (TRUE,) * len(boxes), ordered=False)
        case AttributeList():
            return AttributeSet(Code(f"mask_of({s.text})"), s.total, enum=s.enum)
        case _:
            unsupported("set")


def _lower_set_operation(sign: str) -> Callable[..., Value]:
    def lower(generator: Generator, a: Value, b: Value) -> Value:
        a, b = _lower_set(generator, a), _lower_set(generator, b)
        if isinstance(a, AttributeSet) and isinstance(b, AttributeSet) and a.enum is b.enum:
            return AttributeSet(operate(sign, a.code, b.code), all_total((a, b)), enum=a.enum)
        if isinstance(a, Items) and isinstance(b, Items):
            pairs = paired_by_box(a, b)
            parts = (BoxItems(x.box, operate(sign, x.mask, y.mask), all_total((x, y))) for x, y in pairs)
            return Items(tuple(parts), ordered=False)
        unsupported("set operation")

    return lower


def _lower_contained(generator: Generator, a: Value, b: Value) -> Bool:
    a, b = _lower_set(generator, a), _lower_set(generator, b)
    total = all_total((a, b))
    if isinstance(a, AttributeSet) and isinstance(b, AttributeSet) and a.enum is b.enum:
        return Bool(_is_contained(a.code, b.code), total)
    if isinstance(a, Items) and isinstance(b, Items):
        return conjunction((_is_contained(x.mask, y.mask) for x, y in paired_by_box(a, b)), total=total)
    unsupported("contained")


def _is_contained(mask: Code, other: Code) -> Code:
    return operate("==", operate("&", mask, invert(other)), number(0))


def _lower_equal_set(generator: Generator, a: Value, b: Value) -> Bool:
    return equality(_lower_set(generator, a), _lower_set(generator, b))


def _lower_equal(generator: Generator, a: Value, b: Value) -> Bool:
    if isinstance(a, Items) and isinstance(b, Items) and a.ordered != b.ordered:
        return _lower_equal_set(generator, a, b)
    return equality(a, b)


def _lower_member_of(generator: Generator, x: Value, s: Value) -> Bool:
    return generator.membership(x, s)


def _lower_combinations(generator: Generator, s: Value, k: Value) -> StaticList | Combinations:
    if isinstance(s, Items) and isinstance(k, Int) and k.text in ("2", "3"):
        size = int(k.text)
        items = " + ".join(part.count.text for part in s.parts)
        combined = Combinations(s.parts, size, Code(f"comb({items}, {size})"), s.total)
        count = binomial(MAX_ITEMS, size)
        if len({part.box for part in s.parts}) == len(s.parts) and count <= costs.SIZE_LIMIT:
            generator.charge(costs.SUBSET_ELEMENT * (1 + size) * count)
            return combined
        unsupported("combinations")
    if not isinstance(s, StaticList) or not s.unconditional or not isinstance(k, Int) or not k.text.isdecimal():
        unsupported("combinations")
    count = binomial(len(s.elements), int(k.text))
    if count > MAX_TUPLES:
        unsupported("combinations of many")
    generator.charge(costs.SUBSET_ELEMENT * (1 + int(k.text)) * (1 + count) * max_elements(s))
    chosen = itertools.combinations(s.elements, int(k.text))
    tuples = tuple(StaticList(elements, (TRUE,) * len(elements)) for elements in chosen)
    return StaticList(tuples, (TRUE,) * len(tuples))


# Words with one variant per attribute


def _lower_query(attribute: str) -> Callable[..., AttributeList]:
    def lower(generator: Generator, x: Value) -> AttributeList:
        if isinstance(x, ItemRef):
            value = generator.attribute_of(x, attribute)
            return AttributeList(Code(f"[{value.text}]"), value.total, enum=value.enum)
        if not isinstance(x, Items):
            unsupported("query")
        field = ITEM_FIELDS[attribute]
        texts = [f"[{part.box}.items[i][{field}] for i in bits({part.mask.text})]" for part in x.parts]
        return AttributeList(Code(f"({' + '.join(texts)})"), x.total, enum=ATTRIBUTE_TYPES[attribute])

    return lower


def _lower_values(attribute: str) -> Callable[..., AttributeSet]:
    enum = ATTRIBUTE_TYPES[attribute]

    def lower(generator: Generator, s: Value) -> AttributeSet:
        if not isinstance(s, Items):
            unsupported("values")
        found = [
            occurring(part.mask, [_value_mask(generator, attribute, value, part.box) for value in enum])
            for part in s.parts
        ]
        return AttributeSet(operate("|", *found), s.total, enum=enum)

    return lower


def _lower_filter(attribute: str) -> Callable[..., Items]:
    enum = ATTRIBUTE_TYPES[attribute]

    def lower(generator: Generator, s: Value, value: Value) -> Items:
        if not isinstance(s, Items) or not isinstance(value, AttributeValue) or value.enum is not enum:
            unsupported("filter")
        if not isinstance(value.code, Number):
            unsupported("filter by a variable")
        wanted = enum(value.code.value)
        parts = (narrow(part, ItemMask(_value_mask(generator, attribute, wanted, part.box))) for part in s.parts)
        return Items(tuple(parts), ordered=True)

    return lower


def _value_mask(generator: Generator, attribute: str, value: Enum, box: str) -> Code:
    function = box_functions.vectorised_attribute(attribute, value)
    return generator.box_call(f"{type(value).__name__}_{value.name}", function, box)


def _lower_all_same(attribute: str) -> Callable[..., Bool]:
    values = _lower_values(attribute)

    def lower(generator: Generator, s: Value) -> Bool:
        found = values(generator, s)
        return Bool(operate("==", bit_count(found.code), number(1)), found.total)

    return lower


def _lower_equal_attribute(attribute: str) -> Callable[..., Bool]:
    enum = ATTRIBUTE_TYPES[attribute]

    def lower(_: Generator, a: Value, b: Value) -> Bool:
        for value in (a, b):
            if not isinstance(value, AttributeValue | AttributeSet | AttributeList) or value.enum is not enum:
                unsupported("equality of attributes")
        return equality(a, b)

    return lower


BINARY_WORDS: dict[str, tuple[type, str]] = {
    "AND": (Bool, "and"),
    "OR": (Bool, "or"),
    "NOT": (Bool, "not"),
    "le": (Int, "<="),
    "ge": (Int, ">="),
    "lt": (Int, "<"),
    "gt": (Int, ">"),
    "equal_int": (Int, "=="),
}
VALUE_WORDS: dict[str, Callable[..., Value]] = {
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
ATTRIBUTE_WORDS: dict[str, Callable[..., Value]] = {
    pattern.format(attribute): lower(attribute)
    for attribute in ATTRIBUTE_TYPES
    for pattern, lower in {
        "query_{}": _lower_query,
        "get_set_{}s": _lower_values,
        "filter_{}": _lower_filter,
        "all_same_{}": _lower_all_same,
        "equal_{}": _lower_equal_attribute,
    }.items()
}
