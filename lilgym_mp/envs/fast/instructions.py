"""Branch-free instructions on 64-bit integers, by which compiled (numba) code evaluates a program.

They are lowered from the code of the intermediate representation and have the same value. Code that needs lists, sets
of objects or loops is not supported, nor are box functions that the caller cannot lower.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum, auto, unique
from typing import NamedTuple

from lilgym_mp.envs.fast import box_functions
from lilgym_mp.envs.fast.code_generation import generate_code
from lilgym_mp.envs.fast.ir import BOXES, LOCAL_BOX, Apply, BoxCall, Code, ItemCount, Number, Unsupported
from lilgym_mp.programs.syntax import Node

MAX_INSTRUCTIONS = 256


@unique
class Operation(IntEnum):
    """Opcode of an instruction (operation, a, b). Unless noted, a and b are indices of earlier instructions."""

    CONSTANT = 0  # the integer a
    LENGTH = auto()  # the number of items in box b
    ITEM_TYPE_TEST = auto()  # bitmask of the items of box b whose item type is in the bitmask a
    POSITION_TEST = auto()  # bitmask of the items of box b whose position and size pass test a
    BOX_TABLE = auto()  # the entry of lookup table a for box b
    ONLY_BIT = auto()  # the position of the only set bit of a; unless there is exactly one, the truth is unknown
    BIT_COUNT = auto()
    BIT_AND = auto()
    BIT_OR = auto()
    SHIFT_LEFT = auto()
    SHIFT_RIGHT = auto()
    ADD = auto()
    SUBTRACT = auto()
    REMAINDER = auto()
    EQUAL = auto()
    UNEQUAL = auto()
    LESS = auto()
    LESS_OR_EQUAL = auto()


class Instruction(NamedTuple):
    """One instruction of a program for the kernels; what `a` and `b` mean depends on the operation."""

    operation: Operation
    a: int = 0
    b: int = 0


# Lowers a box function (vectorised word or kernel) applied to box `b` to one instruction, or raises Unsupported.
LowerBoxFunction = Callable[[box_functions.BoxFunction, int], Instruction]

_UNARY: Mapping[str, Operation] = {"bit_count": Operation.BIT_COUNT, "only": Operation.ONLY_BIT}
_WITH_CONSTANT: Mapping[str, tuple[Operation, int]] = {  # of a constant and the operand
    "not": (Operation.EQUAL, 0),
    "~": (Operation.SUBTRACT, -1),
    "negative": (Operation.SUBTRACT, 0),
}
_BINARY: Mapping[str, Operation] = {
    "and": Operation.BIT_AND,  # of truth values, which are 0 or 1
    "or": Operation.BIT_OR,
    "&": Operation.BIT_AND,
    "|": Operation.BIT_OR,
    "<<": Operation.SHIFT_LEFT,
    ">>": Operation.SHIFT_RIGHT,
    "+": Operation.ADD,
    "-": Operation.SUBTRACT,
    "%": Operation.REMAINDER,
}
_COMPARISONS: Mapping[str, tuple[Operation, int]] = {  # and the order of the operands
    "==": (Operation.EQUAL, 1),
    "!=": (Operation.UNEQUAL, 1),
    "<": (Operation.LESS, 1),
    "<=": (Operation.LESS_OR_EQUAL, 1),
    ">": (Operation.LESS, -1),
    ">=": (Operation.LESS_OR_EQUAL, -1),
}


def instructions(tree: Node, lower_box_function: LowerBoxFunction) -> list[Instruction] | None:
    """A program's instructions, or None when it is unsupported. The last one is the truth value (non-zero: true)."""
    code = generate_code(tree)
    if code is None:
        return None
    lowering = _Lowering(lower_box_function)
    try:
        last = lowering.lower(code, dict(zip(BOXES, range(len(BOXES)), strict=True)))
    except (Unsupported, RecursionError):
        return None
    emitted = list(lowering.indices)
    if last != len(emitted) - 1:
        emitted.append(Instruction(Operation.BIT_OR, last, last))
    return emitted if len(emitted) <= MAX_INSTRUCTIONS else None


class _Lowering:
    """Lowers code, emitting each distinct instruction once (common subexpression elimination)."""

    def __init__(self, lower_box_function: LowerBoxFunction) -> None:
        self.indices: dict[Instruction, int] = {}
        self._lower_box_function = lower_box_function

    def lower(self, code: Code, boxes: Mapping[str, int]) -> int:
        """Returns the index of the instruction with the code's value; `boxes` maps its box names to box indices."""
        match code:
            case Number(value=value):
                return self._add(Operation.CONSTANT, int(value))
            case ItemCount(box=box):
                return self._add(Operation.LENGTH, 0, boxes[box])
            case BoxCall():
                return self._box_function(code, boxes[code.box])
            case Apply(operator=operator, operands=operands):
                values = [self.lower(operand, boxes) for operand in operands]
                return self._operation(operator, values)
            case _:
                raise Unsupported

    def _add(self, *instruction: int) -> int:
        """Emits an instruction unless already present; returns its index."""
        return self.indices.setdefault(Instruction(Operation(instruction[0]), *instruction[1:]), len(self.indices))

    def _box_function(self, call: BoxCall, box: int) -> int:
        try:
            return self._add(*self._lower_box_function(call.function, box))
        except Unsupported:
            if call.kernel is None:
                raise
            return self.lower(call.kernel.code, {LOCAL_BOX: box})

    def _operation(self, operation: str, values: Sequence[int]) -> int:
        if operation in _UNARY:
            return self._add(_UNARY[operation], *values)
        if operation in _WITH_CONSTANT:
            binary, constant = _WITH_CONSTANT[operation]
            return self._add(binary, self._add(Operation.CONSTANT, constant), *values)
        if operation in _BINARY:
            return self._joined(_BINARY[operation], values)
        operators = operation.split()
        if not set(operators) <= _COMPARISONS.keys():
            raise Unsupported
        compared: list[int] = []
        for operator, *pair in zip(operators, values[:-1], values[1:], strict=True):
            comparison, order = _COMPARISONS[operator]
            compared.append(self._add(comparison, *pair[::order]))
        return self._joined(Operation.BIT_AND, compared)

    def _joined(self, operation: Operation, values: Sequence[int]) -> int:
        joined = values[0]
        for value in values[1:]:
            joined = self._add(operation, joined, value)
        return joined
