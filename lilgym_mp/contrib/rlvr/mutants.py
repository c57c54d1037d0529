"""Programs one edit away from a program, which scenes to check replies on must tell from it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import Enum

from lilgym_mp.programs import syntax
from lilgym_mp.programs.words import WORDS

COMPARISONS = ("==", "!=", "<", "<=", ">", ">=")
# Words that can stand in for each other
_GROUPS = (
    ("is_yellow", "is_blue", "is_black"),
    ("is_circle", "is_square", "is_triangle"),
    ("is_big", "is_medium", "is_small"),
    ("is_top", "is_bottom", "is_second", "is_third"),
    ("is_touching_wall", "is_closely_touching_wall", "is_touching_corner", "is_closely_touching_corner"),
    ("get_touching", "get_closely_touching", "get_above", "get_below", "get_box_all_above", "get_box_all_below"),
    ("get_set_colors", "get_set_shapes", "get_set_sizes"),
    ("all_same_color", "all_same_shape", "all_same_size"),
    ("le", "ge", "lt", "gt", "equal_int"),
    ("All", "Any"),
)
_SIBLINGS: Mapping[str, tuple[str, ...]] = {
    name: tuple(other for other in group if other != name) for group in _GROUPS for name in group
}


def mutants(node: syntax.Node) -> Iterator[syntax.Node]:
    """Every tree one edit away: another word, number, colour, comparison or connective, or a part left out."""
    yield from _replacements(node)
    for child in syntax.children(node):
        for changed in mutants(child):
            yield syntax.with_children(node, lambda part, old=child, new=changed: new if part is old else part)


def _replacements(node: syntax.Node) -> Iterator[syntax.Node]:
    match node:
        case syntax.Constant(value=Enum() as member):
            yield from (syntax.Constant(other) for other in type(member) if other is not member)
        case syntax.Constant(value=value) if type(value) is int:
            yield from (syntax.Constant(other) for other in (value - 1, value + 1) if other >= 0)
        case syntax.WordName(word=word):
            yield from (syntax.WordName(WORDS[name]) for name in _SIBLINGS.get(word.name, ()))
        case syntax.Not(operand=operand):
            yield operand
        case syntax.Logic(operator=operator, operands=operands):
            yield syntax.Logic("or" if operator == "and" else "and", operands)
            for index in range(len(operands)):
                rest = operands[:index] + operands[index + 1 :]
                yield rest[0] if len(rest) == 1 else syntax.Logic(operator, rest)
        case syntax.Comparison(operators=operators):
            for index, operator in enumerate(operators):
                for other in COMPARISONS if operator in COMPARISONS else ():
                    if other != operator:
                        changed = (*operators[:index], other, *operators[index + 1 :])
                        yield syntax.Comparison(node.left, changed, node.rights)
        case syntax.Call(word=word, arguments=arguments):
            yield from (syntax.Call(WORDS[name], arguments) for name in _SIBLINGS.get(word.name, ()))
            yield from _shortened(word.name, arguments)
        case _:
            pass


def _shortened(name: str, arguments: tuple[syntax.Node | None, ...]) -> Iterator[syntax.Node]:
    """A call without its negation or filter, and counts in place of `exist`."""
    first = arguments[0] if arguments else None
    if first is None:
        return
    if name == "NOT" or name.startswith("filter_"):
        yield first
    elif name == "exist":
        count = syntax.call(WORDS["count"], first)
        yield from (syntax.Comparison(count, (sign,), (syntax.Constant(1),)) for sign in ("==", ">", "<"))
