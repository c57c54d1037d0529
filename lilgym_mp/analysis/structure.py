"""Queries on syntax trees of programs: counts, comparisons, selections, conjunctions. Used by `phenomena`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from lilgym_mp.programs.syntax import (
    Arithmetic,
    Call,
    Comparison,
    Constant,
    Display,
    Lambda,
    Logic,
    Member,
    Node,
    SceneName,
    Variable,
    WordName,
    children,
)


class Compared(NamedTuple):
    """A comparison `left operator right`, written with an operator or a word."""

    left: Node
    operator: str
    right: Node


_OPERATOR_OF_WORD = {"le": "<=", "ge": ">=", "lt": "<", "gt": ">"}  # all other comparison words mean ==
MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
_COUNTING = ("count", "len")
FILTERING = ("filter_obj", "filter_color", "filter_shape", "filter_size")
_VALUE_SETS = ("get_set_colors", "get_set_shapes", "get_set_sizes", "query_color", "query_shape", "query_size")


def nodes(tree: Node) -> Iterator[Node]:
    """The node and all its descendants."""
    yield tree
    for child in children(tree):
        yield from nodes(child)


def word_name(node: Node) -> str | None:
    """The name of the word that the node calls or refers to."""
    return node.word.name if isinstance(node, Call | WordName) else None


def word_names(tree: Node) -> set[str]:
    """The names of all words that the tree uses."""
    return {name for node in nodes(tree) if (name := word_name(node)) is not None}


def uses(tree: Node, *names: str) -> bool:
    return any(word_name(node) in names for node in nodes(tree))


def calls(tree: Node, *names: str) -> Iterator[Call]:
    """The calls of words of those names."""
    return (node for node in nodes(tree) if isinstance(node, Call) and node.word.name in names)


def arguments(node: Node) -> tuple[Node, ...]:
    """The explicit arguments of a call; empty for other nodes."""
    return tuple(children(node)) if isinstance(node, Call) else ()


def comparisons(tree: Node) -> Iterator[Compared]:
    """Every comparison in the tree; a constant operand is moved to the right."""
    for node in nodes(tree):
        if isinstance(node, Comparison):
            lefts = (node.left, *node.rights)
            found = [Compared(*pair) for pair in zip(lefts, node.operators, node.rights, strict=False)]
        elif isinstance(node, Call) and node.word.group == "comparison":
            left, right = arguments(node)
            found = [Compared(left, _OPERATOR_OF_WORD.get(node.word.name, "=="), right)]
        else:
            continue
        for left, operator, right in found:
            if isinstance(left, Constant) and not isinstance(right, Constant):
                yield Compared(right, MIRRORED.get(operator, operator), left)
            else:
                yield Compared(left, operator, right)


def literal_int(node: Node) -> int | None:
    return node.value if isinstance(node, Constant) and type(node.value) is int else None


def literal_bool(node: Node) -> bool | None:
    return node.value if isinstance(node, Constant) and isinstance(node.value, bool) else None


def is_literal(node: Node) -> bool:
    """Whether the node is a constant, or a list or set of constants."""
    return all(isinstance(part, Constant | Display) for part in nodes(node))


def counted_set(node: Node) -> Node | None:
    """The set whose elements the node counts."""
    return arguments(node)[0] if word_name(node) in _COUNTING and arguments(node) else None


def is_count(node: Node) -> bool:
    """Whether the node is a count, or a sum or remainder with a count as an operand."""
    parts = (node.left, node.right) if isinstance(node, Arithmetic) else (node,)
    return any(counted_set(part) is not None for part in parts)


def selected_from(node: Node) -> Node | None:
    """The set that the node selects from."""
    return arguments(node)[0] if word_name(node) in FILTERING and arguments(node) else None


def selection_sources(node: Node) -> Iterator[Node]:
    """The set that the node selects from, followed by the set that one was selected from, and so on."""
    found = selected_from(node)
    while found is not None:
        yield found
        found = selected_from(found)


def structure_key(node: Node, bound: tuple[str, ...] = ()) -> tuple[object, ...]:
    """A key that is equal for alpha-equivalent expressions (up to renaming of bound variables)."""
    match node:
        case Variable(name=name):
            return ("bound", bound.index(name)) if name in bound else ("free", name)
        case Lambda(parameter=parameter, body=body):
            return "lambda", structure_key(body, (parameter, *bound))
        case Constant(value=value):
            return "constant", repr(value)
        case SceneName(name=name):
            return "scene", name
        case Member(of=of, name=name):
            return name, structure_key(of, bound)
        case Comparison(operators=names):
            own: tuple[object, ...] = names
        case Logic(operator=name) | Arithmetic(operator=name):
            own = (name,)
        case Display(kind=kind):
            own = (kind.__name__,)
        case _:
            own = (word_name(node),)
    return type(node).__name__, *own, *(structure_key(child, bound) for child in children(node))


def conjuncts(node: Node) -> Iterator[Node]:
    """The operands of an `and`, with nested `and`s flattened; the node itself if it is not an `and`."""
    if (isinstance(node, Logic) and node.operator == "and") or (word_name(node) == "AND" and isinstance(node, Call)):
        for operand in children(node):
            yield from conjuncts(operand)
    else:
        yield node


def conjunctions(tree: Node) -> Iterator[list[Node]]:
    """The operands of every `and` in the tree."""
    for node in nodes(tree):
        operands = list(conjuncts(node))
        if len(operands) > 1:
            yield operands


def counts_values(node: Node) -> bool:
    """Whether the node counts colours, shapes or sizes."""
    counted = counted_set(node)
    return counted is not None and word_name(counted) in _VALUE_SETS


def are_neighbours(items: Node) -> bool:
    """Whether the items are the result of a related-items word, such as `get_above`."""
    return isinstance(items, Call) and items.word.group == "related items"


def selections(tree: Node) -> set[tuple[object, ...]]:
    """Keys of the sets that the tree selects, without those that depend on variables bound in the tree."""
    bound_inside = {node.parameter for node in nodes(tree) if isinstance(node, Lambda)}
    return {
        structure_key(node)
        for node in nodes(tree)
        if selected_from(node) is not None and not bound_inside & free_variables(node)
    }


def item_conditions(tree: Node) -> Iterator[tuple[str, Node]]:
    """Parameter and body of every lambda applied to a set other than the boxes."""
    for node in nodes(tree):
        match arguments(node):
            case (collection, Lambda(parameter=parameter, body=body)):
                origins = (collection, *selection_sources(collection))
                if not any(isinstance(origin, SceneName) and origin.name == "all_boxes" for origin in origins):
                    yield parameter, body
            case _:
                continue


def free_variables(node: Node) -> set[str]:
    """The names of the free variables of the node."""
    match node:
        case Variable(name=name):
            return {name}
        case Lambda(parameter=parameter, body=body):
            return free_variables(body) - {parameter}
        case _:
            return set[str]().union(*map(free_variables, children(node)))
