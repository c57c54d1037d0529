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
    AttributeList,
    AttributeSet,
    AttributeValue,
    Bool,
    BoxItems,
    BoxRef,
    Combinations,
    Int,
    ItemMask,
    ItemRef,
    Items,
    StaticList,
    UniqueItem,
    Value,
    all_total,
    as_truth,
    conjunction,
    equality,
    max_elements,
    narrow,
    paired_by_box,
    unsupported,
)

MAX_TUPLES = 100  # combinations of static elements, which are unrolled


class Generator(Protocol):
    """The part of the code generator that lowerings use."""

    def box_call(self, name: str, function: Any, box: str) -> str: ...
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
            return Int("(" + " + ".join(part.count for part in s.parts) + ")", s.total)
        case StaticList():
            present: dict[object, list[str]] = {}  # conditions of each object; a box may be listed twice
            for index, (element, condition) in enumerate(zip(s.elements, s.conditions, strict=True)):
                present.setdefault(element if isinstance(element, BoxRef) else index, []).append(condition.text)
            counts = [f"({' | '.join(texts)})" for texts in present.values()]
            return Int(f"({' + '.join(['0', *counts])})", s.total)
        case AttributeSet():
            return Int(f"({s.text}).bit_count()", s.total)
        case AttributeList():
            return Int(f"len(set({s.text}))", s.total)
        case Combinations():
            return Int(s.count, s.total)
        case _:
            unsupported("count")


def _lower_len(generator: Generator, s: Value) -> Int:
    match s:
        case AttributeList():
            return Int(f"len({s.text})", s.total)
        case StaticList():
            return Int("(" + " + ".join(["0", *(condition.text for condition in s.conditions)]) + ")", s.total)
        case _:
            return _lower_count(generator, s)


def _lower_unique(_: Generator, s: Value) -> ItemRef | UniqueItem:
    if not isinstance(s, Items):
        unsupported("unique")
    if len(s.parts) != 1:
        return UniqueItem(s)
    return ItemRef(s.parts[0].box, f"only({s.parts[0].mask})", total=False)


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
            return StaticList(tuple(map(BoxRef, sorted(boxes))), (Bool("True"),) * len(boxes), ordered=False)
        case AttributeList():
            return AttributeSet(s.enum, f"mask_of({s.text})", s.total)
        case _:
            unsupported("set")


def _lower_set_operation(sign: str) -> Callable[..., Value]:
    def lower(generator: Generator, a: Value, b: Value) -> Value:
        a, b = _lower_set(generator, a), _lower_set(generator, b)
        if isinstance(a, AttributeSet) and isinstance(b, AttributeSet) and a.enum is b.enum:
            return AttributeSet(a.enum, f"({a.text} {sign} {b.text})", all_total((a, b)))
        if isinstance(a, Items) and isinstance(b, Items):
            pairs = paired_by_box(a, b)
            parts = (BoxItems(x.box, f"({x.mask} {sign} {y.mask})", all_total((x, y))) for x, y in pairs)
            return Items(tuple(parts), ordered=False)
        unsupported("set operation")

    return lower


def _lower_contained(generator: Generator, a: Value, b: Value) -> Bool:
    a, b = _lower_set(generator, a), _lower_set(generator, b)
    total = all_total((a, b))
    if isinstance(a, AttributeSet) and isinstance(b, AttributeSet) and a.enum is b.enum:
        return Bool(f"({a.text} & ~{b.text} == 0)", total)
    if isinstance(a, Items) and isinstance(b, Items):
        return conjunction([f"({x.mask} & ~{y.mask} == 0)" for x, y in paired_by_box(a, b)], total=total)
    unsupported("contained")


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
        combined = Combinations(s.parts, size, f"comb({' + '.join(part.count for part in s.parts)}, {size})", s.total)
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
    tuples = tuple(StaticList(elements, (Bool("True"),) * len(elements)) for elements in chosen)
    return StaticList(tuples, (Bool("True"),) * len(tuples))


# Words with one variant per attribute


def _lower_query(attribute: str) -> Callable[..., AttributeList]:
    def lower(generator: Generator, x: Value) -> AttributeList:
        if isinstance(x, ItemRef):
            value = generator.attribute_of(x, attribute)
            return AttributeList(value.enum, f"[{value.text}]", value.total)
        if not isinstance(x, Items):
            unsupported("query")
        field = ITEM_FIELDS[attribute]
        texts = [f"[{part.box}.items[i][{field}] for i in bits({part.mask})]" for part in x.parts]
        return AttributeList(ATTRIBUTE_TYPES[attribute], f"({' + '.join(texts)})", x.total)

    return lower


def _lower_values(attribute: str) -> Callable[..., AttributeSet]:
    enum = ATTRIBUTE_TYPES[attribute]

    def lower(generator: Generator, s: Value) -> AttributeSet:
        if not isinstance(s, Items):
            unsupported("values")
        texts: list[str] = []
        for part in s.parts:
            masks = [_value_mask(generator, attribute, value, part.box) for value in enum]
            texts.append(f"occurring({part.mask}, {', '.join(masks)})")
        return AttributeSet(enum, f"({' | '.join(texts)})", s.total)

    return lower


def _lower_filter(attribute: str) -> Callable[..., Items]:
    enum = ATTRIBUTE_TYPES[attribute]

    def lower(generator: Generator, s: Value, value: Value) -> Items:
        if not isinstance(s, Items) or not isinstance(value, AttributeValue) or value.enum is not enum:
            unsupported("filter")
        if not value.text.isdecimal():
            unsupported("filter by a variable")
        wanted = enum(int(value.text))
        parts = (narrow(part, ItemMask(_value_mask(generator, attribute, wanted, part.box))) for part in s.parts)
        return Items(tuple(parts), ordered=True)

    return lower


def _value_mask(generator: Generator, attribute: str, value: Enum, box: str) -> str:
    function = box_functions.vectorised_attribute(attribute, value)
    return generator.box_call(f"{type(value).__name__}_{value.name}", function, box)


def _lower_all_same(attribute: str) -> Callable[..., Bool]:
    values = _lower_values(attribute)

    def lower(generator: Generator, s: Value) -> Bool:
        found = values(generator, s)
        return Bool(f"(({found.text}).bit_count() == 1)", found.total)

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
