"""What generated expressions stand for: the types of the fast form, and what can be done with them alone.

`text` is the source of an expression; `total` says that it never raises.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any, NoReturn

from lilgym_mp.programs import box_functions, costs
from lilgym_mp.programs.values import Color, Shape, Size
from lilgym_mp.scene import BOX_COUNT, Item

MOST_ITEMS = BOX_COUNT * box_functions.MAX_BOX_ITEMS  # in a scene that the fast form takes
BOXES = tuple(f"b{index}" for index in range(BOX_COUNT))
LOCAL_BOX = "b"  # the one box of a kernel
ATTRIBUTE_TYPES: dict[str, type[Enum]] = {"color": Color, "shape": Shape, "size": Size}
ITEM_FIELDS = dict(zip(ATTRIBUTE_TYPES, map(Item._fields.index, ("colour", "shape", "size")), strict=True))


class Unsupported(Exception):
    """A construct the fast form does not have."""


@dataclass(frozen=True)
class Truth:
    """0, 1, False or True."""

    text: str
    total: bool = True


@dataclass(frozen=True)
class Number:
    text: str
    total: bool = True


@dataclass(frozen=True)
class Attribute:
    """A value of an enum, as its number."""

    kind: type[Enum]
    text: str
    total: bool = True


@dataclass(frozen=True)
class Attributes:
    """A set of values of an enum, as the mask of their numbers."""

    kind: type[Enum]
    text: str
    total: bool = True


@dataclass(frozen=True)
class AttributeList:
    """A list of values of an enum, as a list of their numbers."""

    kind: type[Enum]
    text: str
    total: bool = True


@dataclass(frozen=True)
class OneItem:
    """An item, as its index in a box."""

    box: str
    text: str
    total: bool = True


@dataclass(frozen=True)
class OneBox:
    box: str
    total: bool = True


@dataclass(frozen=True)
class Part:
    """Items of one box, as a mask; `text` None for all of them."""

    box: str
    text: str | None
    total: bool = True

    @property
    def mask(self) -> str:
        return self.text if self.text is not None else f"((1 << len({self.box}.items)) - 1)"

    @property
    def some(self) -> str:
        return f"({self.mask} != 0)" if self.text is not None else f"(len({self.box}.items) != 0)"

    @property
    def number(self) -> str:
        return f"({self.mask}).bit_count()" if self.text is not None else f"len({self.box}.items)"


@dataclass(frozen=True)
class Items:
    """A list or set of items, box by box; no item twice."""

    parts: tuple[Part, ...]
    ordered: bool  # a list, in scene order; else a set

    @property
    def total(self) -> bool:
        return all(part.total for part in self.parts)


@dataclass(frozen=True)
class Static:
    """A list or tuple of elements known when the program is compiled, each there if its condition holds."""

    elements: tuple[Code, ...]
    conditions: tuple[Truth, ...]

    @property
    def total(self) -> bool:
        return all(condition.total for condition in self.conditions)

    @property
    def certain(self) -> bool:
        return all(condition.text == "True" for condition in self.conditions)


@dataclass(frozen=True)
class TheOnly:
    """The only item of a collection from several boxes."""

    of: Items
    total: bool = False


@dataclass(frozen=True)
class Choices:
    """A list of tuples of `size` items of the parts, of which only the number is told."""

    parts: tuple[Part, ...]
    size: int
    number: str
    total: bool = True
    filtered: bool = False


Code = Truth | Number | Attribute | Attributes | AttributeList | OneItem | OneBox | Items | Static | TheOnly | Choices
Scope = dict[str, Code]


def uncovered(what: object = "") -> NoReturn:
    raise Unsupported(what)


@dataclass(frozen=True)
class ItemMask:
    text: str
    within: bool = True  # no bits beyond the box's items
    total: bool = True


def narrowed(part: Part, mask: ItemMask) -> Part:
    if part.text is None and mask.within:
        return Part(part.box, mask.text, mask.total)
    return Part(part.box, f"({part.mask} & {mask.text})", part.total and mask.total)


def most_elements(value: Code) -> int:
    """The most elements that a value can have, at all levels and itself included."""
    match value:
        case Items(parts=parts):
            return 1 + len(parts) * box_functions.MAX_BOX_ITEMS
        case OneBox():
            return 1 + box_functions.MAX_BOX_ITEMS
        case AttributeList():
            return 1 + MOST_ITEMS
        case Attributes(kind=kind):
            return 1 + len(kind)
        case Choices(parts=parts, size=size):
            return 1 + math.comb(len(parts) * box_functions.MAX_BOX_ITEMS, size) * (1 + size)
        case Static(elements=elements):
            return 1 + len(elements) + sum(most_elements(e) for e in elements if isinstance(e, Static | AttributeList))
        case _:
            return 1


def steps_to_weigh(value: Code) -> int:
    """The most steps that counting a value's elements, and bringing a set of them into order, can take."""
    weight = most_elements(value)
    if isinstance(value, Attributes) or (isinstance(value, Items) and not value.ordered):
        return 2 * weight + costs.sort_steps(weight, weight)
    return 2 * weight


def text_length(value: Code, enough: int) -> int:
    """The characters of a value's text, or more than `enough` if there are more."""
    match value:
        case OneBox():
            return 0
        case Static(elements=parts, conditions=conditions):
            parts = (*parts, *conditions)
        case Items(parts=parts) | TheOnly(of=Items(parts=parts)):
            pass
        case Choices(parts=parts, number=number):
            parts = (*parts, Number(number))
        case _:
            return len(value.text)
    length = 0
    for part in parts:
        length += len(part.text or "") if isinstance(part, Part) else text_length(part, enough)
        if length > enough:
            break
    return length


def each_value(values: Attributes) -> Static:
    """A set of attribute values, in order, as the values that it may hold."""
    numbers = [str(value.value) for value in values.kind]
    conditions = (Truth(f"({values.text} >> {number} & 1)", values.total) for number in numbers)
    return Static(tuple(Attribute(values.kind, number) for number in numbers), tuple(conditions))


def all_total(values: Iterable[Any]) -> bool:
    return all(value.total for value in values)


def negated(truth: Truth) -> Truth:
    return Truth(f"(not {truth.text})", truth.total)


def as_collection(value: Code) -> Code:
    """A box as its items, where a collection is meant; anything else as it is."""
    if isinstance(value, OneBox):
        return Items((Part(value.box, None),), ordered=True)
    if isinstance(value, Static) and value.certain and value.elements:
        items = [element for element in value.elements if isinstance(element, OneItem)]
        if len(items) == len(value.elements):  # a choice of items, in scene order
            parts: dict[str, list[str]] = {}
            for item in items:
                parts.setdefault(item.box, []).append(f"1 << {item.text}")
            return Items(tuple(Part(box, f"({' | '.join(bits)})") for box, bits in parts.items()), ordered=True)
    return value


def as_truth(value: Code) -> Truth:
    match value:
        case Truth():
            return value
        case Number() | Attributes():
            return Truth(f"({value.text} != 0)", value.total)
        case AttributeList():
            return Truth(f"({value.text} != [])", value.total)
        case Items() | Choices():
            return existence(value)
        case OneBox():
            return existence(Items((Part(value.box, None),), ordered=True))
        case Static():
            return existence(value) if value.elements else Truth("False")
        case _:
            return Truth("True") if value.total else uncovered("truth of an uncertain value")


def existence(value: Items | Static | Choices) -> Truth:
    if isinstance(value, Choices):
        return Truth(f"({value.number} != 0)", value.total)
    if isinstance(value, Static):
        texts = [condition.text for condition in value.conditions]
    else:
        texts = [part.some for part in value.parts]
    return Truth("(" + (" or " if value.total else " | ").join(texts) + ")", value.total)


def parallel(left: Items, right: Items) -> list[tuple[Part, Part]]:
    """The parts of two collections, box by box."""
    pairs = list(zip(left.parts, right.parts, strict=False))
    if len(left.parts) != len(right.parts) or any(a.box != b.box for a, b in pairs):
        uncovered("collections from different boxes")
    return pairs


def conjunction(texts: list[str], *, total: bool) -> Truth:
    return Truth("(" + (" and " if total else " & ").join(texts) + ")", total)


def equality(left: Code, right: Code) -> Truth:
    """`==`, for values that can be equal at all."""
    total = all_total((left, right))
    match left, right:
        case (Truth() | Number(), Truth() | Number()):
            return Truth(f"({left.text} == {right.text})", total)
        case (Attribute(), Attribute()) | (Attributes(), Attributes()) | (AttributeList(), AttributeList()):
            same = left.kind is right.kind
            return Truth(f"({left.text} == {right.text})", total) if same else uncovered("different attributes")
        case (Items(), Items()) if left.ordered == right.ordered:
            return conjunction([f"({a.mask} == {b.mask})" for a, b in parallel(left, right)], total=total)
        case (OneItem(), OneItem()) if left.box == right.box:
            return Truth(f"({left.text} == {right.text})", total)
        case (OneBox(), OneBox()):
            return Truth(str(left.box == right.box), total)
        case _:
            uncovered("equality")
