"""A program's truth as instructions for compiled code: one after another without branches, on 64-bit integers.

They are written from the expression of the fast form, and have its value. Expressions that need lists, sets of objects
or a loop have none; so have those about a box that the compiled code has no way to ask.
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
    """What an instruction (operation, a, b) does; a and b are earlier instructions, for their values, unless said."""

    CONSTANT = 0  # the number a
    LENGTH = auto()  # the number of items of box b
    ITEM_TYPE_TEST = auto()  # the mask of the items of box b whose item type is in the mask a
    POSITION_TEST = auto()  # the mask of the items of box b that pass test a of their place
    BOX_TABLE = auto()  # what table a has of box b
    ONLY_BIT = auto()  # the position of the only bit of a; the program's truth is unknown unless there is just one
    BIT_COUNT = auto()
    NOT = auto()
    INVERT = auto()
    NEGATIVE = auto()
    AND_THEN = auto()  # a and b, as in Python: b where a is not zero
    OR_ELSE = auto()
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
    """A program's instructions, the last of which is its truth (not zero: true); None where there are none."""
    expression = generate_expression(tree)
    if expression is None:
        return None
    writer = _Writer(lower_box_function)
    try:
        last = writer.write_text(expression.text, expression, dict(zip(BOXES, range(len(BOXES)), strict=True)))
    except (Unsupported, RecursionError):
        return None
    written = list(writer.numbers)
    if last != len(written) - 1:
        written.append(Instruction(Operation.BIT_OR, last, last))
    return written if len(written) <= MAX_INSTRUCTIONS else None


class _Writer:
    """Writes each distinct instruction once."""

    def __init__(self, lower_box_function: LowerBoxFunction) -> None:
        self.numbers: dict[Instruction, int] = {}
        self._lower_box_function = lower_box_function

    def add(self, *instruction: int) -> int:
        """The number of an instruction, whose value later ones take by it."""
        return self.numbers.setdefault(Instruction(Operation(instruction[0]), *instruction[1:]), len(self.numbers))

    def write_text(self, text: str, within: Expression, boxes: Mapping[str, int]) -> int:
        return self.write(ast.parse(text, mode="eval").body, within, boxes)

    def write(self, node: ast.expr, within: Expression, boxes: Mapping[str, int]) -> int:
        """Writes a part of an expression `within` which boxes have the names `boxes`; gives the number of its value."""

        def write(part: ast.expr) -> int:
            return self.write(part, within, boxes)

        match node:
            case ast.Constant(value=int() as value):
                return self.add(Operation.CONSTANT, int(value))
            case ast.Name(id=name) if name in within.hoisted:
                return self.write_text(within.hoisted[name], within, boxes)
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _BINARY:
                return self.add(_BINARY[type(operator)], write(left), write(right))
            case ast.UnaryOp(op=operator, operand=operand) if type(operator) in _UNARY:
                return self.add(_UNARY[type(operator)], write(operand))
            case ast.BoolOp(op=operator, values=values):
                return self._joined(_BINARY[type(operator)], [write(value) for value in values])
            case ast.Compare(left=left, ops=operators, comparators=rights):
                values = [write(left), *map(write, rights)]
                pairs = zip(operators, values[:-1], values[1:], strict=True)
                return self._joined(Operation.BIT_AND, [self._compared(*pair) for pair in pairs])
            case ast.Call(func=ast.Attribute(value=owner, attr="bit_count"), args=[]):
                return self.add(Operation.BIT_COUNT, write(owner))
            case ast.Call(func=ast.Name(id="len"), args=[ast.Attribute(value=ast.Name(id=box), attr="items")]):
                return self.add(Operation.LENGTH, 0, boxes[box])
            case ast.Call(func=ast.Name(id="only"), args=[mask]):
                return self.add(Operation.ONLY_BIT, write(mask))
            case ast.Call(func=ast.Name(id="occurring"), args=[mask, *by_value]):
                return self._occurring(write(mask), [write(having) for having in by_value])
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
        occurs = [self.add(Operation.UNEQUAL, self.add(Operation.BIT_AND, mask, having), zero) for having in by_value]
        bits = [
            self.add(Operation.SHIFT_LEFT, occurring, self.add(Operation.CONSTANT, value))
            for value, occurring in enumerate(occurs)
        ]
        return self._joined(Operation.BIT_OR, bits)

    def _box_function(self, name: str, names: Mapping[str, Any], box: int) -> int:
        kernel = names.get(f"{name}_kept")
        try:
            return self.add(*self._lower_box_function(names[name], box))
        except Unsupported:
            if not isinstance(kernel, Kernel):
                raise
            return self.write_text(kernel.expression.text, kernel.expression, {LOCAL_BOX: box})
