"""The intermediate representation of generated code: a tree of operations, and the typed values that they compute.

`printing` writes the tree as Python source, `instructions` its integer part as instructions for compiled code. `total`:
evaluating a value never raises.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from enum import Enum
from functools import cached_property
from typing import Any, NoReturn, cast

from lilgym_mp.envs.fast import box_functions
from lilgym_mp.programs import costs
from lilgym_mp.programs.values import ATTRIBUTE_TYPES
from lilgym_mp.scene import BOX_COUNT, Box, Item

MAX_ITEMS = BOX_COUNT * box_functions.MAX_BOX_ITEMS  # most items of a scene that generated code accepts
BOXES = tuple(f"b{index}" for index in range(BOX_COUNT))
LOCAL_BOX = "b"  # the parameter of a kernel
MAX_SIZE = 4_000  # nodes of a tree
ITEM_FIELDS = dict(zip(ATTRIBUTE_TYPES, map(Item._fields.index, ("colour", "shape", "size")), strict=True))


class Unsupported(Exception):
    """Code generation does not support this construct."""


@dataclass(frozen=True)
class Code:
    """A node of the tree. Raises Unsupported for a tree that is too long to print."""

    def __post_init__(self) -> None:
        if self.size > MAX_SIZE:
            unsupported("too long")

    @cached_property
    def parts(self) -> tuple[Code, ...]:
        """The nodes below it."""
        return tuple(_codes([getattr(self, field.name) for field in fields(self)]))

    @cached_property
    def size(self) -> int:
        """The number of nodes, a shared one counted each time it is printed."""
        return 1 + sum(part.size for part in self.parts)

    @cached_property
    def indices(self) -> frozenset[str]:
        """The names of the loop indices in it."""
        return frozenset[str]().union(*(part.indices for part in self.parts))


def _codes(values: Iterable[Any]) -> Iterator[Code]:
    for value in values:
        if isinstance(value, Code):
            yield value
        elif isinstance(value, tuple):
            yield from _codes(cast("tuple[Any, ...]", value))


@dataclass(frozen=True)
class Number(Code):
    """A constant."""

    value: int  # or a bool


@dataclass(frozen=True)
class LoopIndex(Code):
    """The index of an item in a loop over items of a box."""

    name: str

    @cached_property
    def indices(self) -> frozenset[str]:
        return frozenset({self.name})


@dataclass(frozen=True)
class ItemCount(Code):
    """The number of items in a box."""

    box: str


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class Kernel:
    """A function of a box with its own code, in which the box is LOCAL_BOX."""

    function: Callable[[Box], Any]
    code: Code


@dataclass(frozen=True)
class BoxCall(Code):
    """A call of a function of a box: a vectorised word, or a kernel."""

    box: str
    name: str
    function: box_functions.BoxFunction
    kernel: Kernel | None = None


@dataclass(frozen=True)
class Apply(Code):
    """An operator of Python between the operands, several for a chain of comparisons, or one of `printing.CALLS`."""

    operator: str
    operands: tuple[Code, ...]


@dataclass(frozen=True)
class ItemField(Code):
    """A field of an item of a box, as a number."""

    box: str
    item: Code
    field: int


@dataclass(frozen=True)
class Where(Code):
    """The mask of the items in `mask` for whose `index` the condition is true."""

    index: str
    mask: Code
    condition: Code


@dataclass(frozen=True)
class TupleCount(Code):
    """The number of tuples of items that satisfy the condition; a loop has its indices, and the mask they are from."""

    loops: tuple[tuple[tuple[str, ...], Code], ...]
    condition: Code


def operate(operator: str, *operands: Code) -> Code:
    """The operands joined by an operator, or by those of a chain of comparisons, or given to a function."""
    return Apply(operator, operands)


def has_bit(mask: Code, position: Code) -> Code:
    """Code: whether a mask has the bit at a position, as 0 or 1."""
    return operate("&", operate(">>", mask, position), Number(1))


def bits_at(positions: Iterable[Code]) -> Code:
    """The mask of the bits at one or more positions."""
    return operate("|", *(operate("<<", Number(1), position) for position in positions))


@dataclass(frozen=True)
class Coded:
    """A value that one expression computes."""

    code: Code
    total: bool = True


@dataclass(frozen=True)
class Bool(Coded):
    """0, 1, False or True."""


@dataclass(frozen=True)
class Int(Coded):
    """An integer."""


@dataclass(frozen=True, kw_only=True)
class Attribute(Coded):
    """Members of an enum."""

    enum: type[Enum]


class AttributeValue(Attribute):
    """An enum member, represented by its integer value."""


class AttributeSet(Attribute):
    """A set of enum members, represented as a bitmask of their integer values."""


@dataclass(frozen=True, kw_only=True)
class ItemRef(Coded):
    """An item, represented by its index in a box."""

    box: str


TRUE = Bool(Number(True))
FALSE = Bool(Number(False))


@dataclass(frozen=True)
class BoxRef:
    """A box, by the name of its variable in the generated code."""

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
        """Code for the bits of its items."""
        if self.chosen is not None:
            return self.chosen
        return operate("-", operate("<<", Number(1), ItemCount(self.box)), Number(1))

    @property
    def nonempty(self) -> Code:
        """Code: whether it has any items."""
        return operate("!=", ItemCount(self.box) if self.chosen is None else self.chosen, Number(0))

    @property
    def count(self) -> Code:
        """Code for the number of its items."""
        return ItemCount(self.box) if self.chosen is None else operate("bit_count", self.chosen)


@dataclass(frozen=True)
class Items:
    """A list or set of distinct items, one bitmask per box."""

    parts: tuple[BoxItems, ...]
    ordered: bool  # True: a list in scene order; False: a set

    @property
    def total(self) -> bool:
        """Whether evaluating it never raises."""
        return all(part.total for part in self.parts)


@dataclass(frozen=True)
class StaticList:
    """A collection whose possible elements are known at compile time; each is present if its condition is true."""

    elements: tuple[Value, ...]
    conditions: tuple[Bool, ...]

    @property
    def total(self) -> bool:
        """Whether evaluating it never raises."""
        return all_total((*self.elements, *self.conditions))

    @property
    def unconditional(self) -> bool:
        """Whether it has all its elements in every scene."""
        return all(condition == TRUE for condition in self.conditions)


@dataclass(frozen=True)
class Combinations:
    """The list of `size`-element tuples of the items in `parts`; only its length is represented."""

    parts: tuple[BoxItems, ...]
    size: int
    count: Code
    total: bool = True
    filtered: bool = False


Value = Bool | Int | AttributeValue | AttributeSet | ItemRef | BoxRef | Items | StaticList | Combinations
Scope = dict[str, Value]


def unsupported(construct: object = "") -> NoReturn:
    """Raises Unsupported, naming the construct."""
    raise Unsupported(construct)


@dataclass(frozen=True)
class ItemMask:
    """A condition on the items of a box."""

    code: Code
    in_range: bool = True  # no bits set beyond the last item of the box
    total: bool = True


def narrow(part: BoxItems, mask: ItemMask) -> BoxItems:
    """The items that also have their bits in a mask."""
    if part.chosen is None and mask.in_range:
        return BoxItems(part.box, mask.code, mask.total)
    return BoxItems(part.box, operate("&", part.mask, mask.code), part.total and mask.total)


def attribute_of(item: ItemRef, name: str) -> AttributeValue:
    """The value of an item's attribute, as a member of the enum of that name."""
    return AttributeValue(ItemField(item.box, item.code, ITEM_FIELDS[name]), item.total, enum=ATTRIBUTE_TYPES[name])


def max_elements(value: Value) -> int:
    """Upper bound on the elements of a value at all levels, itself included."""
    match value:
        case Items(parts=parts):
            return 1 + len(parts) * box_functions.MAX_BOX_ITEMS
        case BoxRef():
            return 1 + box_functions.MAX_BOX_ITEMS
        case AttributeSet(enum=enum):
            return 1 + len(enum)
        case StaticList(elements=elements):
            return 1 + len(elements) + sum(max_elements(e) for e in elements if isinstance(e, StaticList))
        case Combinations(parts=parts, size=size):
            return 1 + math.comb(len(parts) * box_functions.MAX_BOX_ITEMS, size) * (1 + size)
        case _:
            return 1


def max_measure_steps(value: Value) -> int:
    """Upper bound on the steps charged for measuring a value and, for a set, sorting it."""
    count = max_elements(value)
    if isinstance(value, AttributeSet) or (isinstance(value, Items) and not value.ordered):
        return 2 * count + costs.sort_steps(count, count)
    return 2 * count


def static_list(elements: Iterable[Value]) -> StaticList:
    """A list that has all these elements."""
    listed = tuple(elements)
    return StaticList(listed, (TRUE,) * len(listed))


def attribute_set(values: Iterable[Value]) -> AttributeSet:
    """The set of values of one attribute. Raises Unsupported when it is empty, or has values of another kind."""
    listed = list(values)
    found = [value for value in listed if isinstance(value, AttributeValue)]
    enums = {value.enum for value in found}
    if len(found) < len(listed) or len(enums) != 1:
        unsupported("set")
    return AttributeSet(bits_at(value.code for value in found), all_total(found), enum=enums.pop())


def all_total(values: Iterable[Any]) -> bool:
    """Whether none of the values raises when evaluated."""
    return all(value.total for value in values)


def negate(truth: Bool) -> Bool:
    """The opposite truth; raises where `truth` does."""
    return Bool(operate("not", truth.code), truth.total)


def as_collection(value: Value) -> Value:
    """A box, or a tuple of items, as Items; other values are returned unchanged."""
    if isinstance(value, BoxRef):
        return Items((BoxItems(value.box, None),), ordered=True)
    if isinstance(value, StaticList) and value.unconditional and value.elements:
        parts: dict[str, list[Code]] = {}
        for item in value.elements:  # one of several combinations, in scene order
            if not isinstance(item, ItemRef):
                return value
            parts.setdefault(item.box, []).append(item.code)
        return Items(tuple(BoxItems(box, bits_at(indices)) for box, indices in parts.items()), ordered=True)
    return value


def as_truth(value: Value) -> Bool:
    """The truth of a value, as Python's `bool` has it."""
    match as_collection(value):
        case Bool() as truth:
            return truth
        case Int(code=code) | AttributeSet(code=code):
            return Bool(operate("!=", code, Number(0)), value.total)
        case Items() | StaticList() | Combinations() as collection:
            return existence(collection)
        case _:
            if not value.total:
                unsupported("truth of a value that may raise")
            return TRUE


def settled(value: StaticList) -> StaticList:
    """The list. Raises Unsupported if an element may fail, which code that does not use the element would not see."""
    if not all_total(value.elements):
        unsupported("an element that may raise")
    return value


def existence(value: Items | StaticList | Combinations) -> Bool:
    """Whether the collection has any element."""
    if isinstance(value, Combinations):
        codes = [operate("!=", value.count, Number(0))]
    elif isinstance(value, StaticList):
        codes = [condition.code for condition in settled(value).conditions]
    else:
        codes = [part.nonempty for part in value.parts]
    return Bool(operate("or" if value.total else "|", *codes), value.total) if codes else FALSE


def paired_by_box(left: Items, right: Items) -> list[tuple[BoxItems, BoxItems]]:
    """The parts of two collections paired by box."""
    pairs = list(zip(left.parts, right.parts, strict=False))
    if len(left.parts) != len(right.parts) or any(a.box != b.box for a, b in pairs):
        unsupported("collections from different boxes")
    return pairs


def conjunction(codes: Iterable[Code], *, total: bool) -> Bool:
    """Whether all codes are true; unless `total`, evaluates each one, as the reference does."""
    return Bool(operate("and" if total else "&", *codes), total)


def membership(value: Value, collection: Value) -> Bool:
    """Whether a set of attribute values contains one of the same enum; else raises Unsupported."""
    if isinstance(value, AttributeValue) and isinstance(collection, AttributeSet) and value.enum is collection.enum:
        return Bool(has_bit(collection.code, value.code), all_total((value, collection)))
    unsupported("membership")


def equality(left: Value, right: Value) -> Bool:
    """`left == right`, for operands of comparable types."""
    total = all_total((left, right))
    match left, right:
        case (AttributeValue(), AttributeValue()) | (AttributeSet(), AttributeSet()) if left.enum is right.enum:
            return Bool(operate("==", left.code, right.code), total)
        case (StaticList(), StaticList()) if left.unconditional and right.unconditional:
            if len(left.elements) != len(right.elements) and not total:
                unsupported("an element that may raise")
            if len(left.elements) != len(right.elements):
                return FALSE
            same = (equality(*pair).code for pair in zip(left.elements, right.elements, strict=True))
            return conjunction((TRUE.code, *same), total=total)
        case (Items(), Items()) if left.ordered == right.ordered:
            return conjunction((operate("==", a.mask, b.mask) for a, b in paired_by_box(left, right)), total=total)
        case (BoxRef(), BoxRef()):
            return TRUE if left.box == right.box else FALSE
        case _:
            unsupported("equality")
