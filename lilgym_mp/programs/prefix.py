"""Programs as token sequences in prefix (Polish) notation; each token has a fixed arity, so no brackets are needed.

Meant for canonical trees (`canonical_form`). The token set does not depend on a corpus: the language's words, one token
per number of arguments, variables by nesting depth, and integers up to MAX_NUMBER.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache

from lilgym_mp.programs.canonical import VARIABLES, variable_name
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.syntax import (
    ATTRIBUTES,
    METHODS,
    SCENE_NAMES,
    Arithmetic,
    Comparison,
    Constant,
    Display,
    Lambda,
    Logic,
    Member,
    Node,
    Not,
    SceneName,
    Subscript,
    Variable,
    call,
    children,
    with_children,
)
from lilgym_mp.programs.values import ENUMS
from lilgym_mp.programs.words import WORDS

MAX_NUMBER = 20
MAX_DISPLAY = 4  # elements of a list or set display
COMPARISONS = ("==", "!=", "<", "<=", ">", ">=", "in", "not in")
OPERATORS = ("+", "%")
CONNECTIVES = ("and", "or")
PART = Variable("_")  # stands for a child


class PrefixError(ValueError):
    """A tree that cannot be encoded as tokens, or tokens that do not form a tree."""


@cache
def _nodes() -> Mapping[str, Node]:
    """Every token, in a fixed order, with the node that it encodes, each child of which is PART."""
    nodes: dict[str, Node] = {name: SceneName(name) for name in SCENE_NAMES}
    nodes |= {f"v{depth}": Variable(name) for depth, name in enumerate(VARIABLES)}
    nodes |= {f"#{number}": Constant(number) for number in range(MAX_NUMBER + 1)}
    nodes |= {"True": Constant(True), "False": Constant(False)}
    nodes |= {"lambda": Lambda("", PART), "not": Not(PART), "[]": Subscript(PART, PART)}
    nodes |= {str(member): Constant(member) for kind in ENUMS.values() for member in kind}
    nodes |= {f".{name}": Member(PART, name, called=False) for name in ATTRIBUTES}
    nodes |= {f".{name}()": Member(PART, name, called=True) for name in METHODS}
    nodes |= {name: Logic(name, (PART, PART)) for name in CONNECTIVES}
    nodes |= {name: Arithmetic(name, PART, PART) for name in OPERATORS}
    nodes |= {name: Comparison(PART, (name,), (PART,)) for name in COMPARISONS}
    kinds: Sequence[type[list[object]] | type[set[object]]] = (list, set)
    for kind in kinds:
        nodes |= {f"{kind.__name__}/{n}": Display(kind, (PART,) * n) for n in range(1, MAX_DISPLAY + 1)}
    for word in WORDS.values():
        least = sum(not parameter.optional for parameter in word.parameters)
        counts = range(least, len(word.parameters) + 1)
        nodes |= {f"{word.name}({count})": call(word, *[PART] * count) for count in counts}
    return nodes


@cache
def _tokens_by_node() -> Mapping[Node, str]:
    return {node: token for token, node in _nodes().items()}


@cache
def token_arities() -> Mapping[str, int]:
    """Every token, in a fixed order, with its arity."""
    return {token: sum(1 for _ in children(node)) for token, node in _nodes().items()}


def prefix_tokens(node: Node) -> list[str]:
    """The tokens of a canonical tree. Raises PrefixError for constructs without tokens, such as slices."""
    return list(_tokens(node))


def tree_from_tokens(tokens: Sequence[str]) -> Node:
    """The tree that the tokens encode. Raises PrefixError for unknown, missing or surplus tokens."""
    remaining = iter(tokens)
    node = _tree(remaining, 0)
    if surplus := len(list(remaining)):
        raise PrefixError(f"{surplus} tokens follow the end of the program")
    return node


def _tokens(node: Node) -> Iterator[str]:
    parts = list(children(node))
    if isinstance(node, Logic):
        for part in parts[:-1]:
            yield node.operator
            yield from _tokens(part)
        yield from _tokens(parts[-1])
        return
    token = _token(node)
    if token is None or token not in _nodes():
        raise PrefixError(f"there is no token for {source_of(node)}")
    yield token
    for part in parts:
        yield from _tokens(part)


def _token(node: Node) -> str | None:
    match node:
        case Constant(value=value):
            return f"#{value}" if type(value) is int else str(value)
        case Lambda():
            return "lambda"
        case _:
            return _tokens_by_node().get(with_children(node, lambda part: PART))


def _tree(tokens: Iterator[str], depth: int) -> Node:
    """Parses a subtree inside `depth` lambdas."""
    token = next(tokens, None)
    if token is None:
        raise PrefixError("the tokens end before the program does")
    if token not in _nodes():
        raise PrefixError(f"unknown token {token!r}")
    match _nodes()[token]:
        case Variable(name=name):
            if VARIABLES.index(name) >= depth:
                raise PrefixError(f"variable {token} is used inside only {depth} lambdas")
            return Variable(name)
        case Lambda():
            return Lambda(variable_name(depth), _tree(tokens, depth + 1))
        case node:
            tree = with_children(node, lambda part: _tree(tokens, depth))
    match tree:
        case Logic(operands=(first, Logic(operator=operator, operands=others))) if operator == token:
            return Logic(token, (first, *others))  # tokens nest a chain to the right
        case _:
            return tree
