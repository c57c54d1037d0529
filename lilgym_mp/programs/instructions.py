"""Branch-free instructions on 64-bit integers, by which compiled (numba) code evaluates a program.

They are lowered from the generated expression and have the same value. Expressions that need lists, sets of objects or
loops are not supported, nor are box functions that the caller cannot lower.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from enum import IntEnum, auto, unique
from typing import Any, NamedTuple

from lilgym_mp.programs import box_functions
from lilgym_mp.programs.code_generation import Expression, Kernel, generate_expression
from lilgym_mp.programs.ir import BOXES, LOCAL_BOX, Unsupported
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
    NOT = auto()
    INVERT = auto()
    NEGATIVE = auto()
    AND_THEN = auto()  # Python's `a and b`: b if a is non-zero, else a
    OR_ELSE = auto()  # Python's `a or b`
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
    operation: Operation
    a: int = 0
    b: int = 0


# Lowers a box function (vectorised word or kernel) applied to box `b` to one instruction, or raises Unsupported.
LowerBoxFunction = Callable[[box_functions.BoxFunction, int], Instruction]

_BINARY: Mapping[type[ast.AST], Operation] = {
    ast.BitAnd: Operation.BIT_AND,
    ast.BitOr: Operation.BIT_OR,
    ast.LShift: Operation.SHIFT_LEFT,
    ast.RShift: Operation.SHIFT_RIGHT,
    ast.Add: Operation.ADD,
    ast.Sub: Operation.SUBTRACT,
    ast.Mod: Operation.REMAINDER,
    ast.Eq: Operation.EQUAL,
    ast.NotEq: Operation.UNEQUAL,
    ast.Lt: Operation.LESS,
    ast.LtE: Operation.LESS_OR_EQUAL,
    ast.And: Operation.AND_THEN,
    ast.Or: Operation.OR_ELSE,
}
_UNARY: Mapping[type[ast.AST], Operation] = {
    ast.Not: Operation.NOT,
    ast.Invert: Operation.INVERT,
    ast.USub: Operation.NEGATIVE,
}
_SWAPPED: Mapping[type[ast.AST], Operation] = {ast.Gt: Operation.LESS, ast.GtE: Operation.LESS_OR_EQUAL}


def instructions(tree: Node, lower_box_function: LowerBoxFunction) -> list[Instruction] | None:
    """A program's instructions, or None when it is unsupported. The last one is the truth value (non-zero: true)."""
    expression = generate_expression(tree)
    if expression is None:
        return None
    lowering = _Lowering(lower_box_function)
    try:
        last = lowering.lower_text(expression.text, expression, dict(zip(BOXES, range(len(BOXES)), strict=True)))
    except (Unsupported, RecursionError):
        return None
    emitted = list(lowering.indices)
    if last != len(emitted) - 1:
        emitted.append(Instruction(Operation.BIT_OR, last, last))
    return emitted if len(emitted) <= MAX_INSTRUCTIONS else None


class _Lowering:
    """Lowers expressions, emitting each distinct instruction once (common subexpression elimination)."""

    def __init__(self, lower_box_function: LowerBoxFunction) -> None:
        self.indices: dict[Instruction, int] = {}
        self._lower_box_function = lower_box_function

    def add(self, *instruction: int) -> int:
        """Emits an instruction unless already present; returns its index."""
        return self.indices.setdefault(Instruction(Operation(instruction[0]), *instruction[1:]), len(self.indices))

    def lower_text(self, text: str, within: Expression, boxes: Mapping[str, int]) -> int:
        return self.lower(ast.parse(text, mode="eval").body, within, boxes)

    def lower(self, node: ast.expr, within: Expression, boxes: Mapping[str, int]) -> int:
        """Lowers a node of the expression `within`; `boxes` maps its box names to box indices. Returns the index of the
        instruction with the node's value."""

        def lower(part: ast.expr) -> int:
            return self.lower(part, within, boxes)

        match node:
            case ast.Constant(value=int() as value):
                return self.add(Operation.CONSTANT, int(value))
            case ast.Name(id=name) if name in within.hoisted:
                return self.lower_text(within.hoisted[name], within, boxes)
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _BINARY:
                return self.add(_BINARY[type(operator)], lower(left), lower(right))
            case ast.UnaryOp(op=operator, operand=operand) if type(operator) in _UNARY:
                return self.add(_UNARY[type(operator)], lower(operand))
            case ast.BoolOp(op=operator, values=values):
                return self._joined(_BINARY[type(operator)], [lower(value) for value in values])
            case ast.Compare(left=left, ops=operators, comparators=rights):
                values = [lower(left), *map(lower, rights)]
                pairs = zip(operators, values[:-1], values[1:], strict=True)
                return self._joined(Operation.BIT_AND, [self._compared(*pair) for pair in pairs])
            case ast.Call(func=ast.Attribute(value=owner, attr="bit_count"), args=[]):
                return self.add(Operation.BIT_COUNT, lower(owner))
            case ast.Call(func=ast.Name(id="len"), args=[ast.Attribute(value=ast.Name(id=box), attr="items")]):
                return self.add(Operation.LENGTH, 0, boxes[box])
            case ast.Call(func=ast.Name(id="only"), args=[mask]):
                return self.add(Operation.ONLY_BIT, lower(mask))
            case ast.Call(func=ast.Name(id="occurring"), args=[mask, *by_value]):
                return self._occurring(lower(mask), [lower(with_value) for with_value in by_value])
            case ast.Call(func=ast.Name(id=name), args=[ast.Name(id=box)]) if box in boxes:
                return self._box_function(name, within.names, boxes[box])
            case _:
                raise Unsupported

    def _joined(self, operation: Operation, values: list[int]) -> int:
        joined = values[0]
        for value in values[1:]:
            joined = self.add(operation, joined, value)
        return joined

    def _compared(self, operator: ast.cmpop, left: int, right: int) -> int:
        if type(operator) in _SWAPPED:
            return self.add(_SWAPPED[type(operator)], right, left)
        if type(operator) not in _BINARY:
            raise Unsupported
        return self.add(_BINARY[type(operator)], left, right)

    def _occurring(self, mask: int, by_value: list[int]) -> int:
        """`runtime._occurring`."""
        zero = self.add(Operation.CONSTANT, 0)
        occurs = [
            self.add(Operation.UNEQUAL, self.add(Operation.BIT_AND, mask, with_value), zero) for with_value in by_value
        ]
        bits = [
            self.add(Operation.SHIFT_LEFT, occurring, self.add(Operation.CONSTANT, value))
            for value, occurring in enumerate(occurs)
        ]
        return self._joined(Operation.BIT_OR, bits)

    def _box_function(self, name: str, names: Mapping[str, Any], box: int) -> int:
        kernel = names.get(f"{name}_object")
        try:
            return self.add(*self._lower_box_function(names[name], box))
        except Unsupported:
            if not isinstance(kernel, Kernel):
                raise
            return self.lower_text(kernel.expression.text, kernel.expression, {LOCAL_BOX: box})
