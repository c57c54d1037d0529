"""The typed intermediate representation of generated code: values that a program computes, and the code that does so.

A `Code` is Python source. Where it consists of operations on integers it also has that structure, from which
`instructions` are made. `total`: evaluating a value never raises.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, NoReturn

from lilgym_mp.fast import box_functions
from lilgym_mp.programs import costs
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
class Code:
    """The source of an expression, and the operation on integers that it is, if any."""

    text: str
    operation: str = ""  # an operator, comparison operators separated by blanks, or the name of a function
    operands: tuple[Code, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Number(Code):
    value: int


@dataclass(frozen=True, kw_only=True)
class ItemCount(Code):
    """The number of items in a box."""

    box: str


@dataclass(frozen=True, kw_only=True)
class BoxCall(Code):
    """A call of a function of a box: a vectorised word, or a kernel with its own code."""

    box: str
    function: box_functions.BoxFunction
    kernel: Code | None  # the function's own code, in which the box is LOCAL_BOX; None for a vectorised word


def number(value: int) -> Code:
    return Number(str(value), value=value)


def item_count(box: str) -> Code:
    return ItemCount(f"len({box}.items)", box=box)


def operate(operator: str, *operands: Code) -> Code:
    """The operands joined by a binary operator, from left to right."""
    return Code(f"({f' {operator} '.join(operand.text for operand in operands)})", operator, operands)


def compare(operators: Sequence[str], *operands: Code) -> Code:
    """A chain of comparisons."""
    steps = zip(operators, operands[1:], strict=True)
    text = " ".join([operands[0].text, *(f"{operator} {operand.text}" for operator, operand in steps)])
    return Code(f"({text})", " ".join(operators), operands)


def invert(mask: Code) -> Code:
    return Code(f"~{mask.text}", "~", (mask,))


def negative(truth: Code) -> Code:
    """0 or, if true, a mask of all bits."""
    return Code(f"-({truth.text})", "negative", (truth,))


def has_bit(mask: Code, position: Code) -> Code:
    return operate("&", operate(">>", mask, position), number(1))


def bits_at(positions: Iterable[Code]) -> Code:
    """The mask of the bits at one or more positions."""
    return operate("|", *(operate("<<", number(1), position) for position in positions))


def bit_count(mask: Code) -> Code:
    return Code(f"({mask.text}).bit_count()", "bit_count", (mask,))


def only(mask: Code) -> Code:
    return Code(f"only({mask.text})", "only", (mask,))


def occurring(mask: Code, by_value: Sequence[Code]) -> Code:
    """`box_functions._occurring`."""
    return Code(f"occurring({', '.join(code.text for code in (mask, *by_value))})", "occurring", (mask, *by_value))


@dataclass(frozen=True)
class Coded:
    """A value that one expression computes."""

    code: Code
    total: bool = True

    @property
    def text(self) -> str:
        return self.code.text


@dataclass(frozen=True)
class Bool(Coded):
    """0, 1, False or True."""


@dataclass(frozen=True)
class Int(Coded):
    pass


@dataclass(frozen=True, kw_only=True)
class Attribute(Coded):
    """Members of an enum."""

    enum: type[Enum]


class AttributeValue(Attribute):
    """An enum member, represented by its integer value."""


class AttributeSet(Attribute):
    """A set of enum members, represented as a bitmask of their integer values."""


class AttributeList(Attribute):
    """A list of enum members, represented as a list of their integer values."""


@dataclass(frozen=True, kw_only=True)
class ItemRef(Coded):
    """An item, represented by its index in a box."""

    box: str


TRUE, FALSE = Bool(Number("True", value=1)), Bool(Number("False", value=0))


@dataclass(frozen=True)
class BoxRef:
    box: str
    total: bool = True


@dataclass(frozen=True)
class BoxItems:
    """Items of one box, represented as a bitmask; `chosen` None means all items."""

    box: str
    chosen: Code | None
    total: bool = True

    @property
    def mask(self) -> Code:
        if self.chosen is not None:
            return self.chosen
        return operate("-", operate("<<", number(1), item_count(self.box)), number(1))

    @property
    def nonempty(self) -> Code:
        return operate("!=", item_count(self.box) if self.chosen is None else self.chosen, number(0))

    @property
    def count(self) -> Code:
        return item_count(self.box) if self.chosen is None else bit_count(self.chosen)


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
        return all(condition == TRUE for condition in self.conditions)

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
    count: Code
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
    """A condition on the items of a box."""

    code: Code
    in_range: bool = True  # no bits set beyond the last item of the box
    total: bool = True


def narrow(part: BoxItems, mask: ItemMask) -> BoxItems:
    if part.chosen is None and mask.in_range:
        return BoxItems(part.box, mask.code, mask.total)
    return BoxItems(part.box, operate("&", part.mask, mask.code), part.total and mask.total)


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
        if isinstance(part, BoxItems):
            length += 0 if part.chosen is None else len(part.chosen.text)
        else:
            length += text_length(part, limit)
        if length > limit:
            break
    return length


def as_static_list(values: AttributeSet) -> StaticList:
    """An attribute set as a list of all members of the enum, each present if its bit is set."""
    members = [AttributeValue(number(value.value), enum=values.enum) for value in values.enum]
    conditions = (Bool(has_bit(values.code, member.code), values.total) for member in members)
    return StaticList(tuple(members), tuple(conditions))


def all_total(values: Iterable[Any]) -> bool:
    return all(value.total for value in values)


def negate(truth: Bool) -> Bool:
    return Bool(Code(f"(not {truth.text})", "not", (truth.code,)), truth.total)


def as_collection(value: Value) -> Value:
    """Coerces a box, or a static tuple of items, to Items; other values are returned unchanged."""
    if isinstance(value, BoxRef):
        return Items((BoxItems(value.box, None),), ordered=True)
    if isinstance(value, StaticList) and value.unconditional and value.elements:
        items = [element for element in value.elements if isinstance(element, ItemRef)]
        if len(items) == len(value.elements):  # one of several combinations, in scene order
            parts: dict[str, list[Code]] = {}
            for item in items:
                parts.setdefault(item.box, []).append(item.code)
            return Items(tuple(BoxItems(box, bits_at(indices)) for box, indices in parts.items()), ordered=True)
    return value


def as_truth(value: Value) -> Bool:
    match value:
        case Bool():
            return value
        case Int() | AttributeSet():
            return Bool(operate("!=", value.code, number(0)), value.total)
        case AttributeList():
            return Bool(Code(f"({value.text} != [])"), value.total)
        case Items() | Combinations():
            return existence(value)
        case BoxRef():
            return existence(Items((BoxItems(value.box, None),), ordered=True))
        case StaticList():
            return existence(value) if value.elements else FALSE
        case _:
            return TRUE if value.total else unsupported("truth of a value that may raise")


def existence(value: Items | StaticList | Combinations) -> Bool:
    if isinstance(value, Combinations):
        return Bool(operate("!=", value.count, number(0)), value.total)
    if isinstance(value, StaticList):
        codes = [condition.code for condition in value.conditions]
    else:
        codes = [part.nonempty for part in value.parts]
    return Bool(operate("or" if value.total else "|", *codes), value.total)


def paired_by_box(left: Items, right: Items) -> list[tuple[BoxItems, BoxItems]]:
    """The parts of two collections paired by box."""
    pairs = list(zip(left.parts, right.parts, strict=False))
    if len(left.parts) != len(right.parts) or any(a.box != b.box for a, b in pairs):
        unsupported("collections from different boxes")
    return pairs


def conjunction(codes: Iterable[Code], *, total: bool) -> Bool:
    return Bool(operate("and" if total else "&", *codes), total)


def equality(left: Value, right: Value) -> Bool:
    """`left == right`, for operands of comparable types."""
    total = all_total((left, right))
    match left, right:
        case (Bool() | Int(), Bool() | Int()):
            return Bool(operate("==", left.code, right.code), total)
        case (
            (AttributeValue(), AttributeValue()) | (AttributeSet(), AttributeSet()) | (AttributeList(), AttributeList())
        ):
            same = left.enum is right.enum
            return Bool(operate("==", left.code, right.code), total) if same else unsupported("different attributes")
        case (Items(), Items()) if left.ordered == right.ordered:
            return conjunction((operate("==", a.mask, b.mask) for a, b in paired_by_box(left, right)), total=total)
        case (ItemRef(), ItemRef()) if left.box == right.box:
            return Bool(operate("==", left.code, right.code), total)
        case (BoxRef(), BoxRef()):
            return TRUE if left.box == right.box else FALSE
        case _:
            unsupported("equality")
