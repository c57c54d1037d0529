"""Programs as token sequences in prefix (Polish) notation; each token has a fixed arity, so no brackets are needed.

Meant for canonical trees (`canonical_form`). The token set does not depend on a corpus: the language's words, one token
per number of arguments, variables by nesting depth, and integers up to MAX_NUMBER.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache

from lilgym_mp.programs import syntax
from lilgym_mp.programs.canonical import VARIABLES, variable_name
from lilgym_mp.programs.values import ENUMS
from lilgym_mp.programs.words import WORDS

MAX_NUMBER = 20
MAX_DISPLAY = 4  # elements of a list or set display
COMPARISONS = ("==", "!=", "<", "<=", ">", ">=", "in", "not in")
OPERATORS = ("+", "%")
CONNECTIVES = ("and", "or")


class PrefixError(ValueError):
    """A tree that cannot be encoded as tokens, or tokens that do not form a tree."""


@cache
def token_arities() -> Mapping[str, int]:
    """Every token, in a fixed order, with its arity."""
    arities: dict[str, int] = dict.fromkeys(syntax.SCENE_NAMES, 0)
    arities |= {_variable(depth): 0 for depth in range(len(VARIABLES))}
    arities |= {f"#{number}": 0 for number in range(MAX_NUMBER + 1)}
    arities |= {"True": 0, "False": 0, "lambda": 1, "not": 1, "[]": 2}
    arities |= {str(member): 0 for kind in ENUMS.values() for member in kind}
    arities |= {f".{name}": 1 for name in syntax.ATTRIBUTES} | {f".{name}()": 1 for name in syntax.METHODS}
    arities |= dict.fromkeys((*CONNECTIVES, *OPERATORS, *COMPARISONS), 2)
    arities |= {f"{kind}/{count}": count for kind in ("list", "set") for count in range(1, MAX_DISPLAY + 1)}
    for word in WORDS.values():
        least = sum(not parameter.optional for parameter in word.parameters)
        arities |= {f"{word.name}({count})": count for count in range(least, len(word.parameters) + 1)}
    return arities


def prefix_tokens(node: syntax.Node) -> list[str]:
    """The tokens of a canonical tree. Raises PrefixError for constructs without tokens, such as slices."""
    return list(_tokens(node))


def tree_from_tokens(tokens: Sequence[str]) -> syntax.Node:
    """The tree that the tokens encode. Raises PrefixError for unknown, missing or surplus tokens."""
    node, end = _tree(tokens, 0, 0)
    if end != len(tokens):
        raise PrefixError(f"{len(tokens) - end} tokens follow the end of the program")
    return node


def _tokens(node: syntax.Node) -> Iterator[str]:
    parts = list(syntax.children(node))
    if isinstance(node, syntax.Logic):
        for part in parts[:-1]:
            yield node.operator
            yield from _tokens(part)
        yield from _tokens(parts[-1])
        return
    token = _token(node)
    if token not in token_arities():
        raise PrefixError(f"there is no token for {token}")
    yield token
    for part in parts:
        yield from _tokens(part)


def _token(node: syntax.Node) -> str:
    """The token of a node; its children are the parts."""
    match node:
        case syntax.Constant(value=value):
            return f"#{value}" if type(value) is int else str(value)
        case syntax.SceneName(name=name):
            return name
        case syntax.Variable(name=name):
            return _variable(VARIABLES.index(name)) if name in VARIABLES else name
        case syntax.Lambda():
            return "lambda"
        case syntax.Call(word=word, arguments=arguments):
            given = [argument for argument in arguments if argument is not None]
            if None in arguments[: len(given)]:
                raise PrefixError(f"{word.name}: an argument before the last is omitted")
            return f"{word.name}({len(given)})"
        case syntax.Member(name=name, called=called):
            return f".{name}{'()' if called else ''}"
        case syntax.Not():
            return "not"
        case syntax.Comparison(operators=(operator,)) | syntax.Arithmetic(operator=operator):
            return operator
        case syntax.Subscript():
            return "[]"
        case syntax.Display(kind=kind, elements=elements):
            return f"{kind.__name__}/{len(elements)}"
        case _:
            raise PrefixError(f"{type(node).__name__} has no tokens")


def _tree(tokens: Sequence[str], at: int, depth: int) -> tuple[syntax.Node, int]:
    """Parses the subtree at index `at`, inside `depth` lambdas; returns it and the index after its last token."""
    if at >= len(tokens):
        raise PrefixError("the tokens end before the program does")
    token = tokens[at]
    arity = token_arities().get(token)
    if arity is None:
        raise PrefixError(f"unknown token {token!r}")
    inner = depth + (token == "lambda")
    parts: list[syntax.Node] = []
    at += 1
    for _ in range(arity):
        part, at = _tree(tokens, at, inner)
        parts.append(part)
    return _node(token, parts, depth), at


def _node(token: str, parts: Sequence[syntax.Node], depth: int) -> syntax.Node:
    match token:
        case "lambda":
            return syntax.Lambda(variable_name(depth), parts[0])
        case "not":
            return syntax.Not(parts[0])
        case "[]":
            return syntax.Subscript(parts[0], parts[1])
        case "True" | "False":
            return syntax.Constant(token == "True")
        case _ if token in syntax.SCENE_NAMES:
            return syntax.SceneName(token)
        case _ if token in CONNECTIVES:
            first, last = parts
            if isinstance(last, syntax.Logic) and last.operator == token:  # tokens nest a chain to the right
                return syntax.Logic(token, (first, *last.operands))
            return syntax.Logic(token, (first, last))
        case _ if token in OPERATORS:
            return syntax.Arithmetic(token, *parts)
        case _ if token in COMPARISONS:
            return syntax.Comparison(parts[0], (token,), (parts[1],))
        case _ if token.startswith("#"):
            return syntax.Constant(int(token[1:]))
        case _ if token.startswith("."):
            return syntax.Member(parts[0], token.removesuffix("()")[1:], called=token.endswith("()"))
        case _ if token.endswith(")"):
            return syntax.call(WORDS[token.split("(")[0]], *parts)
        case _ if "/" in token:
            return syntax.Display(list if token.startswith("list") else set, tuple(parts))
        case _ if "." in token:
            kind, member = token.split(".")
            return syntax.Constant(ENUMS[kind][member])
        case _:
            return _bound_variable(int(token[1:]), depth)


def _bound_variable(index: int, depth: int) -> syntax.Variable:
    if index >= depth:
        raise PrefixError(f"variable v{index} is used inside only {depth} lambdas")
    return syntax.Variable(variable_name(index))


def _variable(depth: int) -> str:
    return f"v{depth}"
