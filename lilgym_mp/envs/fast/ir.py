"""The intermediate representation of generated code: a tree of operations, and the typed values that they compute.

`printing` writes the tree as Python source, `instructions` its integer part as instructions for compiled code. Nothing
that it represents can fail, but for boxes of more than MAX_BOX_ITEMS items.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Any, NoReturn

from lilgym_mp.envs.fast import box_functions
from lilgym_mp.programs import costs
from lilgym_mp.scene import BOX_COUNT, Box

MAX_ITEMS = BOX_COUNT * box_functions.MAX_BOX_ITEMS  # most items of a scene that generated code accepts
BOXES = tuple(f"b{index}" for index in range(BOX_COUNT))
LOCAL_BOX = "b"  # the parameter of a kernel
MAX_SIZE = 4_000  # nodes of a tree


class Unsupported(Exception):
    """Code generation does not support this construct."""


@dataclass(frozen=True)
class Code:
    """A node of the tree. Raises Unsupported for a tree that is too long to print."""

    def __post_init__(self) -> None:
        if self.size > MAX_SIZE:
            unsupported("too long")

    @property
    def parts(self) -> tuple[Code, ...]:
        """The nodes below it."""
        return ()

    @cached_property
    def size(self) -> int:
        """The number of nodes, a shared one counted each time it is printed."""
        return 1 + sum(part.size for part in self.parts)

    @cached_property
    def indices(self) -> frozenset[str]:
        """The names of the loop indices in it."""
        return frozenset[str]().union(*(part.indices for part in self.parts))


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

    @property
    def parts(self) -> tuple[Code, ...]:
        return self.operands


@dataclass(frozen=True)
class Where(Code):
    """The mask of the items in `mask` for whose `index` the condition is true."""

    index: str
    mask: Code
    condition: Code

    @property
    def parts(self) -> tuple[Code, ...]:
        return self.mask, self.condition


def operate(operator: str, *operands: Code) -> Code:
    """The operands joined by an operator, or by those of a chain of comparisons, or given to a function."""
    return Apply(operator, operands)


@dataclass(frozen=True)
class Bool:
    """0, 1, False or True."""

    code: Code


@dataclass(frozen=True)
class Int:
    """An integer."""

    code: Code


@dataclass(frozen=True)
class AttributeValue:
    """A colour, shape or size that the program names."""

    value: Enum


@dataclass(frozen=True)
class AttributeSet:
    """A set of values of one attribute, represented as a bitmask of their integer values."""

    code: Code


@dataclass(frozen=True)
class ItemRef:
    """An item, represented by its index in a box."""

    index: LoopIndex
    box: str


TRUE = Bool(Number(True))
FALSE = Bool(Number(False))


@dataclass(frozen=True)
class BoxRef:
    """A box, by the name of its variable in the generated code."""

    box: str


@dataclass(frozen=True)
class BoxItems:
    """Items of one box, represented as a bitmask; `chosen` None means all items."""

    box: str
    chosen: Code | None

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


@dataclass(frozen=True)
class Boxes:
    """A list of boxes of the scene; each is present if its condition is true."""

    conditions: tuple[Code, ...] = (TRUE.code,) * BOX_COUNT

    @property
    def unconditional(self) -> bool:
        """Whether it has all boxes in every scene."""
        return self == Boxes()


Value = Bool | Int | AttributeValue | AttributeSet | ItemRef | BoxRef | Items | Boxes
Scope = dict[str, Value]


def unsupported(construct: object = "") -> NoReturn:
    """Raises Unsupported, naming the construct."""
    raise Unsupported(construct)


@dataclass(frozen=True)
class ItemMask:
    """A condition on the items of a box."""

    code: Code
    in_range: bool = True  # no bits set beyond the last item of the box


def narrow(part: BoxItems, mask: ItemMask) -> BoxItems:
    """The items that also have their bits in a mask."""
    if part.chosen is None and mask.in_range:
        return BoxItems(part.box, mask.code)
    return BoxItems(part.box, operate("&", part.mask, mask.code))


def max_elements(value: Value) -> int:
    """Upper bound on the elements of a value at all levels, itself included."""
    match value:
        case Items(parts=parts):
            return 1 + len(parts) * box_functions.MAX_BOX_ITEMS
        case BoxRef():
            return 1 + box_functions.MAX_BOX_ITEMS
        case AttributeSet() | Boxes():
            return 1 + BOX_COUNT  # as many as an attribute has values
        case _:
            return 1


def max_measure_steps(value: Value) -> int:
    """Upper bound on the steps charged for measuring a value and, if it is a set, sorting it."""
    count = max_elements(value)
    return 2 * count + costs.sort_steps(count, count)


def codes_of(values: Sequence[Value], *kinds: type[Bool | Int]) -> list[Code]:
    """The code of each value. Raises Unsupported if one is of none of the kinds."""
    found = [value.code for value in values if isinstance(value, kinds)]
    if len(found) < len(values):
        unsupported("operand of the wrong type")
    return found


def negate(truth: Bool) -> Bool:
    """The opposite truth."""
    return Bool(operate("not", truth.code))


def as_collection(value: Value) -> Value:
    """A box as its items; other values are returned unchanged."""
    return Items((BoxItems(value.box, None),)) if isinstance(value, BoxRef) else value


def as_truth(value: Value) -> Bool:
    """The truth of a value, as Python's `bool` has it."""
    match as_collection(value):
        case Bool() as truth:
            return truth
        case Int(code=code) | AttributeSet(code=code):
            return Bool(operate("!=", code, Number(0)))
        case Items(parts=parts):
            return Bool(operate("or", *(part.nonempty for part in parts)))
        case Boxes(conditions=conditions):
            return Bool(operate("or", *conditions))
        case _:
            return TRUE
