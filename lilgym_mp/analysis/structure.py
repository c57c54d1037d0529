"""Queries on syntax trees of programs: counts, comparisons, selections, conjunctions. Used by `phenomena`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from lilgym_mp.programs import syntax
from lilgym_mp.programs.syntax import walk


class Compared(NamedTuple):
    """A comparison `left operator right`, written with an operator or a word."""

    left: syntax.Node
    operator: str
    right: syntax.Node


_OPERATOR_OF_WORD = {"le": "<=", "ge": ">=", "lt": "<", "gt": ">"}  # all other comparison words mean ==
MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
_COUNTING = ("count", "len")
FILTERING = ("filter_obj", "filter_color", "filter_shape", "filter_size")
_VALUE_SETS = ("get_set_colors", "get_set_shapes", "get_set_sizes", "query_color", "query_shape", "query_size")


def word_name(node: syntax.Node) -> str | None:
    """The name of the word that the node calls or refers to."""
    return node.word.name if isinstance(node, syntax.Call | syntax.WordName) else None


def word_names(tree: syntax.Node) -> set[str]:
    """The names of all words that the tree uses."""
    return {name for node in walk(tree) if (name := word_name(node)) is not None}


def uses(tree: syntax.Node, *names: str) -> bool:
    return any(word_name(node) in names for node in walk(tree))


def calls(tree: syntax.Node, *names: str) -> Iterator[syntax.Call]:
    """The calls of words of those names."""
    return (node for node in walk(tree) if isinstance(node, syntax.Call) and node.word.name in names)


def arguments(node: syntax.Node) -> tuple[syntax.Node, ...]:
    """The explicit arguments of a call; empty for other nodes."""
    return tuple(syntax.children(node)) if isinstance(node, syntax.Call) else ()


def comparisons(tree: syntax.Node) -> Iterator[Compared]:
    """Every comparison in the tree; a constant operand is moved to the right."""
    for node in walk(tree):
        if isinstance(node, syntax.Comparison):
            lefts = (node.left, *node.rights)
            found = [Compared(*pair) for pair in zip(lefts, node.operators, node.rights, strict=False)]
        elif isinstance(node, syntax.Call) and node.word.group == "comparison":
            left, right = arguments(node)
            found = [Compared(left, _OPERATOR_OF_WORD.get(node.word.name, "=="), right)]
        else:
            continue
        for left, operator, right in found:
            if isinstance(left, syntax.Constant) and not isinstance(right, syntax.Constant):
                yield Compared(right, MIRRORED.get(operator, operator), left)
            else:
                yield Compared(left, operator, right)


def literal_int(node: syntax.Node) -> int | None:
    return node.value if isinstance(node, syntax.Constant) and type(node.value) is int else None


def literal_bool(node: syntax.Node) -> bool | None:
    return node.value if isinstance(node, syntax.Constant) and isinstance(node.value, bool) else None


def is_literal(node: syntax.Node) -> bool:
    """Whether the node is a constant, or a list or set of constants."""
    return all(isinstance(part, syntax.Constant | syntax.Display) for part in walk(node))


def counted_set(node: syntax.Node) -> syntax.Node | None:
    """The set whose elements the node counts."""
    return arguments(node)[0] if word_name(node) in _COUNTING and arguments(node) else None


def is_count(node: syntax.Node) -> bool:
    """Whether the node is a count, or a sum or remainder with a count as an operand."""
    parts = (node.left, node.right) if isinstance(node, syntax.Arithmetic) else (node,)
    return any(counted_set(part) is not None for part in parts)


def selected_from(node: syntax.Node) -> syntax.Node | None:
    """The set that the node selects from."""
    return arguments(node)[0] if word_name(node) in FILTERING and arguments(node) else None


def selection_sources(node: syntax.Node) -> Iterator[syntax.Node]:
    """The set that the node selects from, followed by the set that one was selected from, and so on."""
    found = selected_from(node)
    while found is not None:
        yield found
        found = selected_from(found)


def structure_key(node: syntax.Node, bound: tuple[str, ...] = ()) -> tuple[object, ...]:
    """A key that is equal for alpha-equivalent expressions (up to renaming of bound variables)."""
    match node:
        case syntax.Variable(name=name):
            return ("bound", bound.index(name)) if name in bound else ("free", name)
        case syntax.Lambda(parameter=parameter, body=body):
            return "lambda", structure_key(body, (parameter, *bound))
        case syntax.Constant(value=value):
            return "constant", repr(value)
        case syntax.SceneName(name=name):
            return "scene", name
        case syntax.Member(of=of, name=name):
            return name, structure_key(of, bound)
        case syntax.Comparison(operators=names):
            own: tuple[object, ...] = names
        case syntax.Logic(operator=name) | syntax.Arithmetic(operator=name):
            own = (name,)
        case syntax.Display(kind=kind):
            own = (kind.__name__,)
        case _:
            own = (word_name(node),)
    return type(node).__name__, *own, *(structure_key(child, bound) for child in syntax.children(node))


def conjuncts(node: syntax.Node) -> Iterator[syntax.Node]:
    """The operands of an `and`, with nested `and`s flattened; the node itself if it is not an `and`."""
    if (isinstance(node, syntax.Logic) and node.operator == "and") or (
        word_name(node) == "AND" and isinstance(node, syntax.Call)
    ):
        for operand in syntax.children(node):
            yield from conjuncts(operand)
    else:
        yield node


def conjunctions(tree: syntax.Node) -> Iterator[list[syntax.Node]]:
    """The operands of every `and` in the tree."""
    for node in walk(tree):
        operands = list(conjuncts(node))
        if len(operands) > 1:
            yield operands


def counts_values(node: syntax.Node) -> bool:
    """Whether the node counts colours, shapes or sizes."""
    counted = counted_set(node)
    return counted is not None and word_name(counted) in _VALUE_SETS


def are_neighbours(items: syntax.Node) -> bool:
    """Whether the items are the result of a related-items word, such as `get_above`."""
    return isinstance(items, syntax.Call) and items.word.group == "related items"


def selections(tree: syntax.Node) -> set[tuple[object, ...]]:
    """Keys of the sets that the tree selects, without those that depend on variables bound in the tree."""
    bound_inside = {node.parameter for node in walk(tree) if isinstance(node, syntax.Lambda)}
    return {
        structure_key(node)
        for node in walk(tree)
        if selected_from(node) is not None and not bound_inside & syntax.free_variables(node)
    }


def item_conditions(tree: syntax.Node) -> Iterator[tuple[str, syntax.Node]]:
    """Parameter and body of every lambda applied to a set other than the boxes."""
    for node in walk(tree):
        match arguments(node):
            case (collection, syntax.Lambda(parameter=parameter, body=body)):
                origins = (collection, *selection_sources(collection))
                if not any(isinstance(origin, syntax.SceneName) and origin.name == "all_boxes" for origin in origins):
                    yield parameter, body
            case _:
                continue
