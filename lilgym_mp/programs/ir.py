"""The typed intermediate representation of generated code: what a fragment of Python source evaluates to.

`text` is the source of an expression. `total`: evaluating it never raises.
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

MAX_ITEMS = BOX_COUNT * box_functions.MAX_BOX_ITEMS  # most items of a scene that generated code accepts
BOXES = tuple(f"b{index}" for index in range(BOX_COUNT))
LOCAL_BOX = "b"  # the parameter of a kernel
ATTRIBUTE_TYPES: dict[str, type[Enum]] = {"color": Color, "shape": Shape, "size": Size}
ITEM_FIELDS = dict(zip(ATTRIBUTE_TYPES, map(Item._fields.index, ("colour", "shape", "size")), strict=True))


class Unsupported(Exception):
    """Code generation does not support this construct."""


@dataclass(frozen=True)
class Bool:
    """0, 1, False or True."""

    text: str
    total: bool = True


@dataclass(frozen=True)
class Int:
    text: str
    total: bool = True


@dataclass(frozen=True)
class AttributeValue:
    """An enum member, represented by its integer value."""

    enum: type[Enum]
    text: str
    total: bool = True


@dataclass(frozen=True)
class AttributeSet:
    """A set of enum members, represented as a bitmask of their integer values."""

    enum: type[Enum]
    text: str
    total: bool = True


@dataclass(frozen=True)
class AttributeList:
    """A list of enum members, represented as a list of their integer values."""

    enum: type[Enum]
    text: str
    total: bool = True


@dataclass(frozen=True)
class ItemRef:
    """An item, represented by its index in a box."""

    box: str
    text: str
    total: bool = True


@dataclass(frozen=True)
class BoxRef:
    box: str
    total: bool = True


@dataclass(frozen=True)
class BoxItems:
    """Items of one box, represented as a bitmask; `text` None means all items."""

    box: str
    text: str | None
    total: bool = True

    @property
    def mask(self) -> str:
        return self.text if self.text is not None else f"((1 << len({self.box}.items)) - 1)"

    @property
    def nonempty(self) -> str:
        return f"({self.mask} != 0)" if self.text is not None else f"(len({self.box}.items) != 0)"

    @property
    def count(self) -> str:
        return f"({self.mask}).bit_count()" if self.text is not None else f"len({self.box}.items)"


@dataclass(frozen=True)
class Items:
    """A list or set of distinct items, one bitmask per box."""

    parts: tuple[BoxItems, ...]
    ordered: bool  # True: a list in scene order; False: a set

    @property
    def total(self) -> bool:
        return all(part.total for part in self.parts)


@dataclass(frozen=True)
class StaticList:
    """A collection whose possible elements are known at compile time; each is present if its condition is true."""

    elements: tuple[Value, ...]
    conditions: tuple[Bool, ...]
    ordered: bool = True  # True: a list or tuple; False: a set, elements in scene order

    @property
    def total(self) -> bool:
        return all(condition.total for condition in self.conditions)

    @property
    def unconditional(self) -> bool:
        return all(condition.text == "True" for condition in self.conditions)

    @property
    def is_indexable(self) -> bool:
        return self.ordered and self.unconditional


@dataclass(frozen=True)
class UniqueItem:
    """The only item of a collection that spans several boxes; its box is not known at compile time."""

    of: Items
    total: bool = False


@dataclass(frozen=True)
class Combinations:
    """The list of `size`-element tuples of the items in `parts`; only its length is represented."""

    parts: tuple[BoxItems, ...]
    size: int
    count: str
    total: bool = True
    filtered: bool = False


Value = (
    Bool
    | Int
    | AttributeValue
    | AttributeSet
    | AttributeList
    | ItemRef
    | BoxRef
    | Items
    | StaticList
    | UniqueItem
    | Combinations
)
Scope = dict[str, Value]


def unsupported(construct: object = "") -> NoReturn:
    raise Unsupported(construct)


@dataclass(frozen=True)
class ItemMask:
    text: str
    in_range: bool = True  # no bits set beyond the last item of the box
    total: bool = True


def narrow(part: BoxItems, mask: ItemMask) -> BoxItems:
    if part.text is None and mask.in_range:
        return BoxItems(part.box, mask.text, mask.total)
    return BoxItems(part.box, f"({part.mask} & {mask.text})", part.total and mask.total)


def max_elements(value: Value) -> int:
    """Upper bound on the elements of a value at all levels, itself included."""
    match value:
        case Items(parts=parts):
            return 1 + len(parts) * box_functions.MAX_BOX_ITEMS
        case BoxRef():
            return 1 + box_functions.MAX_BOX_ITEMS
        case AttributeList():
            return 1 + MAX_ITEMS
        case AttributeSet(enum=enum):
            return 1 + len(enum)
        case Combinations(parts=parts, size=size):
            return 1 + math.comb(len(parts) * box_functions.MAX_BOX_ITEMS, size) * (1 + size)
        case StaticList(elements=elements):
            return (
                1 + len(elements) + sum(max_elements(e) for e in elements if isinstance(e, StaticList | AttributeList))
            )
        case _:
            return 1


def max_measure_steps(value: Value) -> int:
    """Upper bound on the steps charged for measuring a value and, for a set, sorting it."""
    count = max_elements(value)
    if isinstance(value, AttributeSet) or (isinstance(value, Items | StaticList) and not value.ordered):
        return 2 * count + costs.sort_steps(count, count)
    return 2 * count


def text_length(value: Value, limit: int) -> int:
    """The length of a value's text; counting stops once it exceeds `limit`."""
    match value:
        case BoxRef():
            return 0
        case StaticList(elements=parts, conditions=conditions):
            parts = (*parts, *conditions)
        case Items(parts=parts) | UniqueItem(of=Items(parts=parts)):
            pass
        case Combinations(parts=parts, count=count):
            parts = (*parts, Int(count))
        case _:
            return len(value.text)
    length = 0
    for part in parts:
        length += len(part.text or "") if isinstance(part, BoxItems) else text_length(part, limit)
        if length > limit:
            break
    return length


def as_static_list(values: AttributeSet) -> StaticList:
    """An attribute set as a list of all members of the enum, each present if its bit is set."""
    numbers = [str(value.value) for value in values.enum]
    conditions = (Bool(f"({values.text} >> {number} & 1)", values.total) for number in numbers)
    return StaticList(tuple(AttributeValue(values.enum, number) for number in numbers), tuple(conditions))


def all_total(values: Iterable[Any]) -> bool:
    return all(value.total for value in values)


def negate(truth: Bool) -> Bool:
    return Bool(f"(not {truth.text})", truth.total)


def as_collection(value: Value) -> Value:
    """Coerces a box, or a static tuple of items, to Items; other values are returned unchanged."""
    if isinstance(value, BoxRef):
        return Items((BoxItems(value.box, None),), ordered=True)
    if isinstance(value, StaticList) and value.unconditional and value.elements:
        items = [element for element in value.elements if isinstance(element, ItemRef)]
        if len(items) == len(value.elements):  # one of several combinations, in scene order
            parts: dict[str, list[str]] = {}
            for item in items:
                parts.setdefault(item.box, []).append(f"1 << {item.text}")
            return Items(tuple(BoxItems(box, f"({' | '.join(bits)})") for box, bits in parts.items()), ordered=True)
    return value


def as_truth(value: Value) -> Bool:
    match value:
        case Bool():
            return value
        case Int() | AttributeSet():
            return Bool(f"({value.text} != 0)", value.total)
        case AttributeList():
            return Bool(f"({value.text} != [])", value.total)
        case Items() | Combinations():
            return existence(value)
        case BoxRef():
            return existence(Items((BoxItems(value.box, None),), ordered=True))
        case StaticList():
            return existence(value) if value.elements else Bool("False")
        case _:
            return Bool("True") if value.total else unsupported("truth of a value that may raise")


def existence(value: Items | StaticList | Combinations) -> Bool:
    if isinstance(value, Combinations):
        return Bool(f"({value.count} != 0)", value.total)
    if isinstance(value, StaticList):
        texts = [condition.text for condition in value.conditions]
    else:
        texts = [part.nonempty for part in value.parts]
    return Bool("(" + (" or " if value.total else " | ").join(texts) + ")", value.total)


def paired_by_box(left: Items, right: Items) -> list[tuple[BoxItems, BoxItems]]:
    """The parts of two collections paired by box."""
    pairs = list(zip(left.parts, right.parts, strict=False))
    if len(left.parts) != len(right.parts) or any(a.box != b.box for a, b in pairs):
        unsupported("collections from different boxes")
    return pairs


def conjunction(texts: list[str], *, total: bool) -> Bool:
    return Bool("(" + (" and " if total else " & ").join(texts) + ")", total)


def equality(left: Value, right: Value) -> Bool:
    """`left == right`, for operands of comparable types."""
    total = all_total((left, right))
    match left, right:
        case (Bool() | Int(), Bool() | Int()):
            return Bool(f"({left.text} == {right.text})", total)
        case (
            (AttributeValue(), AttributeValue()) | (AttributeSet(), AttributeSet()) | (AttributeList(), AttributeList())
        ):
            same = left.enum is right.enum
            return Bool(f"({left.text} == {right.text})", total) if same else unsupported("different attributes")
        case (Items(), Items()) if left.ordered == right.ordered:
            return conjunction([f"({a.mask} == {b.mask})" for a, b in paired_by_box(left, right)], total=total)
        case (ItemRef(), ItemRef()) if left.box == right.box:
            return Bool(f"({left.text} == {right.text})", total)
        case (BoxRef(), BoxRef()):
            return Bool(str(left.box == right.box), total)
        case _:
            unsupported("equality")
