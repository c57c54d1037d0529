"""Programs as token sequences in prefix (Polish) notation; each token has a fixed arity, so no brackets are needed.

Meant for canonical trees (`canonical_form`). The token set does not depend on a corpus: the language's words, one token
per number of arguments, variables by nesting depth, and integers up to MAX_NUMBER.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache

from lilgym_mp.programs.canonical import VARIABLES, variable_name
from lilgym_mp.programs.syntax import (
    ATTRIBUTES,
    METHODS,
    SCENE_NAMES,
    Arithmetic,
    Call,
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
)
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
    arities: dict[str, int] = dict.fromkeys(SCENE_NAMES, 0)
    arities |= {_variable(depth): 0 for depth in range(len(VARIABLES))}
    arities |= {f"#{number}": 0 for number in range(MAX_NUMBER + 1)}
    arities |= {"True": 0, "False": 0, "lambda": 1, "not": 1, "[]": 2}
    arities |= {str(member): 0 for kind in ENUMS.values() for member in kind}
    arities |= {f".{name}": 1 for name in ATTRIBUTES} | {f".{name}()": 1 for name in METHODS}
    arities |= dict.fromkeys((*CONNECTIVES, *OPERATORS, *COMPARISONS), 2)
    arities |= {f"{kind}/{count}": count for kind in ("list", "set") for count in range(1, MAX_DISPLAY + 1)}
    for word in WORDS.values():
        least = sum(not parameter.optional for parameter in word.parameters)
        arities |= {f"{word.name}({count})": count for count in range(least, len(word.parameters) + 1)}
    return arities


def prefix_tokens(node: Node) -> list[str]:
    """The tokens of a canonical tree. Raises PrefixError for constructs without tokens, such as slices."""
    return list(_tokens(node))


def tree_from_tokens(tokens: Sequence[str]) -> Node:
    """The tree that the tokens encode. Raises PrefixError for unknown, missing or surplus tokens."""
    node, end = _tree(tokens, 0, 0)
    if end != len(tokens):
        raise PrefixError(f"{len(tokens) - end} tokens follow the end of the program")
    return node


def _tokens(node: Node) -> Iterator[str]:
    match node:
        case Logic(operator=operator, operands=operands):
            for operand in operands[:-1]:
                yield operator
                yield from _tokens(operand)
            yield from _tokens(operands[-1])
        case _:
            token, parts = _token_and_parts(node)
            if token not in token_arities():
                raise PrefixError(f"there is no token for {token}")
            yield token
            for part in parts:
                yield from _tokens(part)


def _token_and_parts(node: Node) -> tuple[str, Sequence[Node]]:
    match node:
        case Constant(value=bool() as value):
            return str(value), ()
        case Constant(value=int() as value):
            return f"#{value}", ()
        case Constant(value=value):
            return str(value), ()
        case SceneName(name=name):
            return name, ()
        case Variable(name=name):
            return (_variable(VARIABLES.index(name)) if name in VARIABLES else name), ()
        case Lambda(body=body):
            return "lambda", (body,)
        case Call(word=word, arguments=arguments):
            given = [argument for argument in arguments if argument is not None]
            if None in arguments[: len(given)]:
                raise PrefixError(f"{word.name}: an argument before the last is omitted")
            return f"{word.name}({len(given)})", given
        case Member(of=of, name=name, called=called):
            return f".{name}{'()' if called else ''}", (of,)
        case Not(operand=operand):
            return "not", (operand,)
        case Comparison(left=left, operators=(operator,), rights=(right,)):
            return operator, (left, right)
        case Arithmetic(operator=operator, left=left, right=right):
            return operator, (left, right)
        case Subscript(of=of, index=index):
            return "[]", (of, index)
        case Display(kind=kind, elements=elements):
            return f"{kind.__name__}/{len(elements)}", elements
        case _:
            raise PrefixError(f"{type(node).__name__} has no tokens")


def _tree(tokens: Sequence[str], at: int, depth: int) -> tuple[Node, int]:
    """Parses the subtree at index `at`, inside `depth` lambdas; returns it and the index after its last token."""
    if at >= len(tokens):
        raise PrefixError("the tokens end before the program does")
    token = tokens[at]
    arity = token_arities().get(token)
    if arity is None:
        raise PrefixError(f"unknown token {token!r}")
    inner = depth + (token == "lambda")
    parts: list[Node] = []
    at += 1
    for _ in range(arity):
        part, at = _tree(tokens, at, inner)
        parts.append(part)
    return _node(token, parts, depth), at


def _node(token: str, parts: Sequence[Node], depth: int) -> Node:
    match token:
        case "lambda":
            return Lambda(variable_name(depth), parts[0])
        case "not":
            return Not(parts[0])
        case "[]":
            return Subscript(parts[0], parts[1])
        case "True" | "False":
            return Constant(token == "True")
        case _ if token in SCENE_NAMES:
            return SceneName(token)
        case _ if token in CONNECTIVES:
            first, last = parts
            if isinstance(last, Logic) and last.operator == token:  # tokens nest a chain to the right
                return Logic(token, (first, *last.operands))
            return Logic(token, (first, last))
        case _ if token in OPERATORS:
            return Arithmetic(token, *parts)
        case _ if token in COMPARISONS:
            return Comparison(parts[0], (token,), (parts[1],))
        case _ if token.startswith("#"):
            return Constant(int(token[1:]))
        case _ if token.startswith("."):
            return Member(parts[0], token.removesuffix("()")[1:], called=token.endswith("()"))
        case _ if token.endswith(")"):
            word = WORDS[token.split("(")[0]]
            rest: tuple[None, ...] = (None,) * (len(word.parameters) - len(parts))
            return Call(word, (*parts, *rest))
        case _ if "/" in token:
            return Display(list if token.startswith("list") else set, tuple(parts))
        case _ if "." in token:
            kind, member = token.split(".")
            return Constant(ENUMS[kind][member])
        case _:
            return _bound_variable(int(token[1:]), depth)


def _bound_variable(index: int, depth: int) -> Variable:
    if index >= depth:
        raise PrefixError(f"variable v{index} is used inside only {depth} lambdas")
    return Variable(variable_name(index))


def _variable(depth: int) -> str:
    return f"v{depth}"
