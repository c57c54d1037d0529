"""How the words that coerce only values are written in the fast form: a word's arguments to its source.

A word that is missing here still works, by the reference form.
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
    MOST_ITEMS,
    Attribute,
    AttributeList,
    Attributes,
    Choices,
    Code,
    ItemMask,
    Items,
    Number,
    OneBox,
    OneItem,
    Part,
    Static,
    TheOnly,
    Truth,
    all_total,
    as_truth,
    conjunction,
    equality,
    most_elements,
    narrowed,
    parallel,
    uncovered,
)

MOST_TUPLES = 100  # that are written out


class Generator(Protocol):
    """What writing a word needs of the generator."""

    def lifted(self, name: str, function: Any, box: str) -> str: ...
    def attribute_of(self, item: OneItem, name: str) -> Attribute: ...
    def membership(self, value: Code, held: Code) -> Truth: ...
    def charge(self, steps: int) -> None: ...


def _write_exist(_: Generator, s: Code) -> Truth:
    return as_truth(s) if isinstance(s, Items | Static | Choices | Attributes | AttributeList) else uncovered()


def _write_count(_: Generator, s: Code) -> Number:
    match s:
        case Items():
            return Number("(" + " + ".join(part.number for part in s.parts) + ")", s.total)
        case Static():
            return Number("(" + " + ".join(["0", *(condition.text for condition in s.conditions)]) + ")", s.total)
        case Attributes():
            return Number(f"({s.text}).bit_count()", s.total)
        case AttributeList():
            return Number(f"len(set({s.text}))", s.total)
        case Choices():
            return Number(s.number, s.total)
        case _:
            uncovered("count")


def _write_len(generator: Generator, s: Code) -> Number:
    return Number(f"len({s.text})", s.total) if isinstance(s, AttributeList) else _write_count(generator, s)


def _write_unique(_: Generator, s: Code) -> OneItem | TheOnly:
    if not isinstance(s, Items):
        uncovered("unique")
    if len(s.parts) != 1:
        return TheOnly(s)
    return OneItem(s.parts[0].box, f"only({s.parts[0].mask})", total=False)


def _write_set(_: Generator, s: Code) -> Code:
    match s:
        case Items():
            return Items(tuple(sorted(s.parts, key=lambda part: part.box)), ordered=False)
        case Attributes():
            return s
        case Static() if s.certain and all(isinstance(element, OneBox) for element in s.elements):
            boxes = tuple(dict.fromkeys(s.elements))
            return Static(boxes, (Truth("True"),) * len(boxes))
        case AttributeList():
            return Attributes(s.kind, f"mask_of({s.text})", s.total)
        case _:
            uncovered("set")


def _write_set_operation(sign: str) -> Callable[..., Code]:
    def write(generator: Generator, a: Code, b: Code) -> Code:
        a, b = _write_set(generator, a), _write_set(generator, b)
        if isinstance(a, Attributes) and isinstance(b, Attributes) and a.kind is b.kind:
            return Attributes(a.kind, f"({a.text} {sign} {b.text})", all_total((a, b)))
        if isinstance(a, Items) and isinstance(b, Items):
            pairs = parallel(a, b)
            parts = (Part(x.box, f"({x.mask} {sign} {y.mask})", all_total((x, y))) for x, y in pairs)
            return Items(tuple(parts), ordered=False)
        uncovered("set operation")

    return write


def _write_contained(generator: Generator, a: Code, b: Code) -> Truth:
    a, b = _write_set(generator, a), _write_set(generator, b)
    total = all_total((a, b))
    if isinstance(a, Attributes) and isinstance(b, Attributes) and a.kind is b.kind:
        return Truth(f"({a.text} & ~{b.text} == 0)", total)
    if isinstance(a, Items) and isinstance(b, Items):
        return conjunction([f"({x.mask} & ~{y.mask} == 0)" for x, y in parallel(a, b)], total=total)
    uncovered("contained")


def _write_equal_set(generator: Generator, a: Code, b: Code) -> Truth:
    return equality(_write_set(generator, a), _write_set(generator, b))


def _write_equal(generator: Generator, a: Code, b: Code) -> Truth:
    if isinstance(a, Items) and isinstance(b, Items) and a.ordered != b.ordered:
        return _write_equal_set(generator, a, b)
    return equality(a, b)


def _write_member_of(generator: Generator, x: Code, s: Code) -> Truth:
    return generator.membership(x, s)


def _write_combinations(generator: Generator, s: Code, k: Code) -> Static | Choices:
    if isinstance(s, Items) and isinstance(k, Number) and k.text in ("2", "3"):
        size = int(k.text)
        choices = Choices(s.parts, size, f"ways({' + '.join(part.number for part in s.parts)}, {size})", s.total)
        ways = binomial(MOST_ITEMS, size)
        if len({part.box for part in s.parts}) == len(s.parts) and ways <= costs.SIZE_LIMIT:
            generator.charge(costs.SUBSET_ELEMENT * (1 + size) * ways)
            return choices
        uncovered("combinations")
    if not isinstance(s, Static) or not s.certain or not isinstance(k, Number) or not k.text.isdecimal():
        uncovered("combinations")
    ways = binomial(len(s.elements), int(k.text))
    if ways > MOST_TUPLES:
        uncovered("combinations of many")
    generator.charge(costs.SUBSET_ELEMENT * (1 + int(k.text)) * (1 + ways) * most_elements(s))
    chosen = itertools.combinations(s.elements, int(k.text))
    tuples = tuple(Static(elements, (Truth("True"),) * len(elements)) for elements in chosen)
    return Static(tuples, (Truth("True"),) * len(tuples))


# Words about an attribute, for each attribute


def _write_query(attribute: str) -> Callable[..., AttributeList]:
    def write(generator: Generator, x: Code) -> AttributeList:
        if isinstance(x, OneItem):
            value = generator.attribute_of(x, attribute)
            return AttributeList(value.kind, f"[{value.text}]", value.total)
        if not isinstance(x, Items):
            uncovered("query")
        field = ITEM_FIELDS[attribute]
        texts = [f"[{part.box}.items[i][{field}] for i in bits({part.mask})]" for part in x.parts]
        return AttributeList(ATTRIBUTE_TYPES[attribute], f"({' + '.join(texts)})", x.total)

    return write


def _write_values(attribute: str) -> Callable[..., Attributes]:
    kind = ATTRIBUTE_TYPES[attribute]

    def write(generator: Generator, s: Code) -> Attributes:
        if not isinstance(s, Items):
            uncovered("values")
        texts: list[str] = []
        for part in s.parts:
            masks = [_value_mask(generator, attribute, value, part.box) for value in kind]
            texts.append(f"occurring({part.mask}, {', '.join(masks)})")
        return Attributes(kind, f"({' | '.join(texts)})", s.total)

    return write


def _write_filter(attribute: str) -> Callable[..., Items]:
    kind = ATTRIBUTE_TYPES[attribute]

    def write(generator: Generator, s: Code, value: Code) -> Items:
        if not isinstance(s, Items) or not isinstance(value, Attribute) or value.kind is not kind:
            uncovered("filter")
        if not value.text.isdecimal():
            uncovered("filter by a variable")
        wanted = kind(int(value.text))
        parts = (narrowed(part, ItemMask(_value_mask(generator, attribute, wanted, part.box))) for part in s.parts)
        return Items(tuple(parts), ordered=True)

    return write


def _value_mask(generator: Generator, attribute: str, value: Enum, box: str) -> str:
    lifted = box_functions.vectorised_attribute(attribute, value)
    return generator.lifted(f"{type(value).__name__}_{value.name}", lifted, box)


def _write_all_same(attribute: str) -> Callable[..., Truth]:
    values = _write_values(attribute)

    def write(generator: Generator, s: Code) -> Truth:
        found = values(generator, s)
        return Truth(f"(({found.text}).bit_count() == 1)", found.total)

    return write


def _write_equal_attribute(attribute: str) -> Callable[..., Truth]:
    kind = ATTRIBUTE_TYPES[attribute]

    def write(_: Generator, a: Code, b: Code) -> Truth:
        for value in (a, b):
            if not isinstance(value, Attribute | Attributes | AttributeList) or value.kind is not kind:
                uncovered("equality of attributes")
        return equality(a, b)

    return write


BINARY_WORDS: dict[str, tuple[type, str]] = {
    "AND": (Truth, "and"),
    "OR": (Truth, "or"),
    "NOT": (Truth, "not"),
    "le": (Number, "<="),
    "ge": (Number, ">="),
    "lt": (Number, "<"),
    "gt": (Number, ">"),
    "equal_int": (Number, "=="),
}
VALUE_WORDS: dict[str, Callable[..., Code]] = {
    "exist": _write_exist,
    "count": _write_count,
    "len": _write_len,
    "unique": _write_unique,
    "set": _write_set,
    "union": _write_set_operation("|"),
    "intersect": _write_set_operation("&"),
    "contained": _write_contained,
    "equal_set": _write_equal_set,
    "equal": _write_equal,
    "member_of": _write_member_of,
    "combinations": _write_combinations,
}
ATTRIBUTE_WORDS: dict[str, Callable[..., Code]] = {
    pattern.format(attribute): write(attribute)
    for attribute in ATTRIBUTE_TYPES
    for pattern, write in {
        "query_{}": _write_query,
        "get_set_{}s": _write_values,
        "filter_{}": _write_filter,
        "all_same_{}": _write_all_same,
        "equal_{}": _write_equal_attribute,
    }.items()
}
