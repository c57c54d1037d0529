"""Unparses syntax trees to source text."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from lilgym_mp.programs import syntax

# Operator precedence, lowest first: an operand of lower precedence than its context requires is parenthesised.
LAMBDA, OR, AND, NOT, COMPARISON, SUM, PRODUCT, ATOM = range(8)
_PRECEDENCE = {"or": OR, "and": AND, "+": SUM, "%": PRODUCT}


def source_of(node: syntax.Node) -> str:
    """The source text of a tree: `parse(source_of(tree)) == tree`."""
    return _text(node, LAMBDA)


def _text(node: syntax.Node, required: int) -> str:
    text, precedence = _unparsed(node)
    return f"({text})" if precedence < required else text


def _unparsed(node: syntax.Node) -> tuple[str, int]:
    """The text of a node and its precedence."""
    match node:
        case syntax.Constant(value=Enum() as member):
            return str(member), ATOM
        case syntax.Constant(value=value):
            return str(value), ATOM
        case syntax.SceneName(name=name) | syntax.Variable(name=name):
            return name, ATOM
        case syntax.WordName(word=word):
            return word.name, ATOM
        case syntax.Lambda(parameter=parameter, body=body):
            return f"lambda {parameter}: {_text(body, LAMBDA)}", LAMBDA
        case syntax.Call():
            return f"{node.word.name}({', '.join(_arguments(node))})", ATOM
        case syntax.Member(of=of, name=name, called=called):
            owner = f"({of.value})" if isinstance(of, syntax.Constant) and type(of.value) is int else _text(of, ATOM)
            return f"{owner}.{name}{'()' if called else ''}", ATOM
        case syntax.Logic(operator=operator, operands=operands):
            precedence = _PRECEDENCE[operator]
            return f" {operator} ".join(_text(operand, precedence + 1) for operand in operands), precedence
        case syntax.Not(operand=operand):
            return f"not {_text(operand, NOT)}", NOT
        case syntax.Comparison(left=left, operators=operators, rights=rights):
            steps = [f"{name} {_text(right, SUM)}" for name, right in zip(operators, rights, strict=True)]
            return " ".join([_text(left, SUM), *steps]), COMPARISON
        case syntax.Arithmetic(operator=operator, left=left, right=right):
            precedence = _PRECEDENCE[operator]
            return f"{_text(left, precedence)} {operator} {_text(right, precedence + 1)}", precedence
        case syntax.Subscript(of=of, index=index):
            return f"{_text(of, ATOM)}[{_text(index, LAMBDA)}]", ATOM
        case syntax.Slice(of=of, start=start, stop=stop, step=step):
            parts = ["" if part is None else _text(part, LAMBDA) for part in (start, stop)]
            stride = "" if step is None else f":{_text(step, LAMBDA)}"
            return f"{_text(of, ATOM)}[{':'.join(parts)}{stride}]", ATOM
        case syntax.Display(kind=kind, elements=elements):
            inner = ", ".join(_text(element, LAMBDA) for element in elements)
            opening, closing = "[]" if kind is list else "{}"
            return f"{opening}{inner}{closing}", ATOM


def _arguments(node: syntax.Call) -> Iterable[str]:
    skipped = False
    for parameter, argument in zip(node.word.parameters, node.arguments, strict=True):
        if argument is None:
            skipped = True
        elif skipped or parameter.keyword_only:
            yield f"{parameter.name}={_text(argument, LAMBDA)}"
        else:
            yield _text(argument, LAMBDA)
