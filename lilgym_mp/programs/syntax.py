"""Parses program text to a syntax tree, by an allow-list over Python's syntax tree (docs/spec.md, "Programs").

First a lexer checks all characters and tokens, so that Python's parser only sees a bounded number of names, integers,
brackets and operators of the language. Then every node of Python's tree must be of an allowed type. Anything else
raises ProgramError with position and reason.
"""

from __future__ import annotations

import ast
import difflib
import keyword
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NoReturn, cast, get_args

from lilgym_mp.programs import functions as _functions
from lilgym_mp.programs.errors import ProgramError
from lilgym_mp.programs.values import ENUMS
from lilgym_mp.programs.words import WORDS, Word, known_words

MAX_LENGTH = 5_000  # characters; the longest official program has 816
MAX_BRACKETS = 60  # nesting depth of brackets
MAX_DEPTH = 60  # nesting depth of expressions; the deepest official program has 18
MAX_INT = 1_000_000

SCENE_NAMES = ("all_boxes", "all_items")
METHODS = ("all_items_in_box", "is_tower")  # members of a box
ATTRIBUTES = ("box", "color", "shape", "size")  # members of an item
OPERATORS: dict[type[ast.cmpop] | type[ast.operator], str] = {
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.In: "in",
    ast.NotIn: "not in",
    ast.Add: "+",
    ast.Mod: "%",
}
CLOSING = {")": "(", "]": "[", "}": "{"}
_KEYWORDS = {"lambda", "and", "or", "not", "in", "True", "False"}
_TOKEN = re.compile(
    r"(?P<blank>[ \t]+)|(?P<name>[A-Za-z_][A-Za-z_0-9]*)|(?P<int>[0-9]+)|(?P<operator>==|!=|<=|>=|[<>+%.,:()\[\]{}=])"
)
_REFUSED = re.compile(r"\*\*|//|<<|>>|->|:=|\*|/|-|[\"'`]+|@|\||&|\^|~|\\|!|#|;|\?|\$|\s|.", re.DOTALL)
ONLY_OPERATORS = "the only operators are + % and comparisons"
_WHY = {
    **dict.fromkeys("\"'", "strings are not part of the language"),
    **dict.fromkeys((*"*/-|&^~", "<<", ">>"), ONLY_OPERATORS),
    **dict.fromkeys("\n\r", "a program is one line"),
    "#": "comments are not part of the language",
    ":=": "assignments are not part of the language",
    "\0": "a null character",
}
assert _functions


@dataclass(frozen=True, slots=True)
class Constant:
    """An int, a bool, or a member of Color, Shape, Size or Side."""

    value: object


@dataclass(frozen=True, slots=True)
class SceneName:
    """`all_items` or `all_boxes`."""

    name: str


@dataclass(frozen=True, slots=True)
class Variable:
    """The parameter of an enclosing lambda."""

    name: str


@dataclass(frozen=True, slots=True)
class WordName:
    """A word that is passed as a function instead of being called."""

    word: Word


@dataclass(frozen=True, slots=True)
class Lambda:
    """A function of one parameter."""

    parameter: str
    body: Node


@dataclass(frozen=True, slots=True)
class Call:
    """A call of a word, with one argument per parameter; None means the default."""

    word: Word
    arguments: tuple[Node | None, ...]


@dataclass(frozen=True, slots=True)
class Member:
    """`of.name`, or `of.name()` if `called`."""

    of: Node
    name: str
    called: bool


@dataclass(frozen=True, slots=True)
class Logic:
    """Python's short-circuiting `and` / `or`."""

    operator: str
    operands: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Not:
    """`not operand`."""

    operand: Node


@dataclass(frozen=True, slots=True)
class Comparison:
    """A comparison chain: `left`, then each operator followed by the corresponding element of `rights`."""

    left: Node
    operators: tuple[str, ...]
    rights: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """`left operator right` on numbers."""

    operator: str
    left: Node
    right: Node


@dataclass(frozen=True, slots=True)
class Subscript:
    """`of[index]`."""

    of: Node
    index: Node


@dataclass(frozen=True, slots=True)
class Slice:
    """`of[start:stop:step]`; None where a part is left out."""

    of: Node
    start: Node | None
    stop: Node | None
    step: Node | None


@dataclass(frozen=True, slots=True)
class Display:
    """A list or set display: `[a, b]` or `{a, b}`."""

    kind: type[list[object]] | type[set[object]]
    elements: tuple[Node, ...]


Node = (
    Constant
    | SceneName
    | Variable
    | WordName
    | Lambda
    | Call
    | Member
    | Logic
    | Not
    | Comparison
    | Arithmetic
    | Subscript
    | Slice
    | Display
)
_NODES = frozenset(get_args(Node))


def parse(source: str) -> Node:
    """The syntax tree of a program. Raises ProgramError for any text that is not a valid program."""
    text = _checked_text(source)
    shift = len(source) - len(source.lstrip(" \t"))
    try:
        tree = ast.parse(text, mode="eval")
        return _Checker(source, text, shift).checked(tree.body, frozenset(), 0)
    except SyntaxError as fault:
        _refuse_syntax(source, shift, fault)
    except (MemoryError, RecursionError):
        raise ProgramError(source, shift, "", "the expression is too deeply nested") from None


def children(node: Node) -> Iterator[Node]:
    """The direct children of a node."""
    for name in node.__match_args__:
        part: Any = getattr(node, name)
        if type(part) in _NODES:
            yield part
        elif type(part) is tuple:
            for each in cast("tuple[Any, ...]", part):
                if type(each) in _NODES:
                    yield each


def with_children(node: Node, changed: Callable[[Node], Node]) -> Node:
    """The node with each direct child replaced by what `changed` returns for it."""

    def replaced(part: Any) -> Any:
        if type(part) is tuple:
            return tuple([changed(each) if type(each) in _NODES else each for each in cast("tuple[Any, ...]", part)])
        return changed(part) if type(part) in _NODES else part

    return type(node)(*[replaced(getattr(node, name)) for name in node.__match_args__])


def call(word: Word, *arguments: Node | None) -> Call:
    """A call of the word with the first arguments given, and defaults for the others."""
    return Call(word, (*arguments, *(None for _ in word.parameters[len(arguments) :])))


def as_lambda(node: Node, parameter: str) -> Lambda | None:
    """A lambda, or a word that can be called with one argument as a lambda of `parameter`; None for other nodes."""
    if isinstance(node, WordName) and all(other.optional for other in node.word.parameters[1:]):
        return Lambda(parameter, call(node.word, Variable(parameter)))
    return node if isinstance(node, Lambda) else None


def walk(node: Node) -> Iterator[Node]:
    """The node and all its descendants, in pre-order."""
    yield node
    for child in children(node):
        yield from walk(child)


def word_names(node: Node) -> set[str]:
    """The names of all words that the tree uses."""
    return {part.word.name for part in walk(node) if isinstance(part, Call | WordName)}


def free_variables(node: Node) -> frozenset[str]:
    """The variables in the node that no lambda inside it binds."""
    found = frozenset({node.name}) if isinstance(node, Variable) else frozenset[str]()
    found = found.union(*map(free_variables, children(node)))
    return found - {node.parameter} if isinstance(node, Lambda) else found


def own_size(node: Node) -> int:
    """The number of nodes of an expression, excluding lambda bodies, whose evaluation is charged per call."""
    return 1 + sum(own_size(child) for child in children(node) if not isinstance(node, Lambda))


def _checked_text(source: str) -> str:
    """The text without surrounding blanks, after checking every token."""
    if len(source) > MAX_LENGTH:
        raise ProgramError(source, 0, "", f"a program has at most {MAX_LENGTH} characters, not {len(source)}")
    if not source.strip(" \t"):
        raise ProgramError(source, 0, "", "the program is empty")
    open_brackets: list[tuple[str, int]] = []
    at = 0
    while at < len(source):
        token = _TOKEN.match(source, at)
        if token is None or source.startswith(":=", at):
            _refuse_character(source, at)
        text = token[0]
        if token.lastgroup == "name":
            _check_name(source, at, text)
        elif token.lastgroup == "int":
            _check_int(source, at, text)
        elif text in "([{":
            open_brackets.append((text, at))
            if len(open_brackets) > MAX_BRACKETS:
                raise ProgramError(source, at, text, f"brackets are nested more than {MAX_BRACKETS} deep")
        elif text in CLOSING and (not open_brackets or open_brackets.pop()[0] != CLOSING[text]):
            raise ProgramError(source, at, text, "this bracket was never opened")
        at = token.end()
    if open_brackets:
        bracket, where = open_brackets[-1]
        raise ProgramError(source, where, bracket, "this bracket is never closed")
    return source.strip(" \t")


def _check_name(source: str, at: int, name: str) -> None:
    if name.startswith("_") or name.endswith("__"):
        raise ProgramError(source, at, name, "names that start with an underscore are not part of the language")
    if keyword.iskeyword(name) and name not in _KEYWORDS:
        raise ProgramError(source, at, name, f"{name!r} is not part of the language")


def _check_int(source: str, at: int, digits: str) -> None:
    if source[at + len(digits) : at + len(digits) + 1].isalpha():
        raise ProgramError(source, at, digits, "a number must be followed by a blank, a bracket or an operator")
    if source[at + len(digits) : at + len(digits) + 1] == "." or source[max(0, at - 1) : at] == ".":
        raise ProgramError(source, at, digits, "only integers are allowed")
    if len(digits) > 1 and digits[0] == "0":
        raise ProgramError(source, at, digits, "a number cannot start with 0")
    if len(digits) > len(str(MAX_INT)) or int(digits) > MAX_INT:
        raise ProgramError(source, at, digits, f"numbers are at most {MAX_INT}")


def _refuse_character(source: str, at: int) -> NoReturn:
    found = _REFUSED.match(source, at)
    piece = found[0] if found else source[at]
    reason = _WHY.get(piece[:2]) or _WHY.get(piece[0])
    if reason is None and not piece.isascii():
        reason = "only ASCII characters are part of the language"
    raise ProgramError(source, at, piece, reason or f"{piece!r} is not part of the language")


def _refuse_syntax(source: str, shift: int, fault: SyntaxError) -> NoReturn:
    at = min(shift + max(0, (fault.offset or 1) - 1), len(source))
    piece = re.match(r"\w+|.?", source[at:])
    raise ProgramError(source, at, piece[0] if piece else "", "this is not a Python expression") from None


class _Checker:
    def __init__(self, source: str, text: str, shift: int) -> None:
        self.source = source
        self.text = text
        self.shift = shift

    def refuse(self, node: ast.expr | ast.keyword | ast.arg, reason: str) -> NoReturn:
        start = node.col_offset  # byte offsets, but the text is ASCII
        end = node.end_col_offset or node.col_offset
        raise ProgramError(self.source, self.shift + start, self.text[start:end], reason)

    def checked(self, node: ast.expr, variables: frozenset[str], depth: int) -> Node:
        """Converts a node of Python's tree; `variables` are the parameters of the enclosing lambdas."""
        if depth > MAX_DEPTH:
            self.refuse(node, f"expressions are nested more than {MAX_DEPTH} deep")

        def inner(child: ast.expr) -> Node:
            return self.checked(child, variables, depth + 1)

        match node:
            case ast.Constant(value=bool() | int() as value):
                return Constant(value)
            case ast.Name():
                return self._name(node, variables)
            case ast.Lambda():
                return self._lambda(node, variables, depth)
            case ast.Call(func=ast.Attribute() as method):
                return self._method_call(node, method, variables, depth)
            case ast.Call():
                return self._call(node, variables, depth)
            case ast.Attribute():
                return self._member(node, variables, depth)
            case ast.BoolOp(op=operator, values=values):
                return Logic("and" if isinstance(operator, ast.And) else "or", tuple(map(inner, values)))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return Not(inner(operand))
            case ast.BinOp(op=ast.Add() | ast.Mod() as operator, left=left, right=right):
                return Arithmetic(OPERATORS[type(operator)], inner(left), inner(right))
            case ast.Compare(left=left, ops=operators, comparators=rights):
                names = tuple(OPERATORS[type(operator)] for operator in operators)
                return Comparison(inner(left), names, tuple(map(inner, rights)))
            case ast.Subscript(value=of, slice=ast.Slice(lower=lower, upper=upper, step=step)):
                start, stop, stride = (part and inner(part) for part in (lower, upper, step))
                return Slice(inner(of), start, stop, stride)
            case ast.Subscript(value=of, slice=ast.Tuple()):
                self.refuse(node, "only one index is allowed")
            case ast.Subscript(value=of, slice=index):
                return Subscript(inner(of), inner(index))
            case ast.List(elts=elements):
                return Display(list, tuple(map(inner, elements)))
            case ast.Set(elts=elements):
                return Display(set, tuple(map(inner, elements)))
            case ast.Dict():
                self.refuse(node, "dictionaries are not part of the language; the empty set is set()")
            case ast.Tuple():
                self.refuse(node, "tuples are not part of the language; write a list: [a, b]")
            case ast.UnaryOp() | ast.BinOp():
                self.refuse(node, ONLY_OPERATORS)
            case _:
                self.refuse(node, f"{type(node).__name__} is not part of the language")

    def _name(self, node: ast.Name, variables: frozenset[str]) -> Node:
        name = node.id
        if name in variables:
            return Variable(name)
        if name in SCENE_NAMES:
            return SceneName(name)
        if name in known_words(name):
            return WordName(WORDS[name])
        if name in ENUMS:
            members = ", ".join(map(str, ENUMS[name]))
            self.refuse(node, f"{name} needs a member: {members}")
        self.refuse(node, "unknown name" + _suggestion(name, [*variables, *SCENE_NAMES, *WORDS, *ENUMS]))

    def _lambda(self, node: ast.Lambda, variables: frozenset[str], depth: int) -> Node:
        given = node.args
        others = (given.posonlyargs, given.kwonlyargs, given.defaults, given.kw_defaults)
        if len(given.args) != 1 or any(others) or given.vararg or given.kwarg:
            self.refuse(node, "a lambda must have exactly one parameter, without a default: lambda x: ...")
        parameter = given.args[0]
        if parameter.arg in WORDS or parameter.arg in SCENE_NAMES or parameter.arg in ENUMS:
            self.refuse(parameter, f"{parameter.arg} is a word of the language; rename the parameter")
        return Lambda(parameter.arg, self.checked(node.body, variables | {parameter.arg}, depth + 1))

    def _call(self, node: ast.Call, variables: frozenset[str], depth: int) -> Node:
        if not isinstance(node.func, ast.Name):
            self.refuse(node.func, "only words of the language can be called")
        name = node.func.id
        if name in variables or name in SCENE_NAMES or name in ENUMS:
            self.refuse(node.func, f"{name} is not a function")
        if name not in known_words(name):
            self.refuse(node.func, "unknown function" + _suggestion(name, list(WORDS)))
        called = WORDS[name]
        keywords = {entry.arg: entry.value for entry in node.keywords if entry.arg is not None}
        if len(keywords) != len(node.keywords):
            self.refuse(node, "an argument is given twice")
        try:
            arguments = called.bind(node.args, keywords)
        except TypeError as fault:
            self.refuse(node, f"{fault}; the function is {called.signature}")
        return Call(called, tuple(part and self.checked(part, variables, depth + 1) for part in arguments))

    def _method_call(self, node: ast.Call, method: ast.Attribute, variables: frozenset[str], depth: int) -> Node:
        if method.attr in ATTRIBUTES:
            self.refuse(node, f".{method.attr} is not a method; write it without ()")
        member = self._member(method, variables, depth)
        if not isinstance(member, Member):
            self.refuse(node, "this value is not a function")
        if node.args or node.keywords:
            self.refuse(node, f".{method.attr}() takes no arguments")
        return Member(member.of, member.name, called=True)

    def _member(self, node: ast.Attribute, variables: frozenset[str], depth: int) -> Node:
        if isinstance(node.value, ast.Name) and node.value.id in ENUMS and node.value.id not in variables:
            members = ENUMS[node.value.id].__members__
            if node.attr not in members:
                self.refuse(node, f"unknown {node.value.id} {node.attr!r}; choose from {', '.join(members)}")
            return Constant(members[node.attr])
        if isinstance(node.value, ast.Name):
            self._name(node.value, variables)
        if node.attr not in METHODS and node.attr not in ATTRIBUTES:
            self.refuse(node, f"unknown member{_suggestion(node.attr, [*METHODS, *ATTRIBUTES])}")
        return Member(self.checked(node.value, variables, depth + 1), node.attr, called=False)


def _suggestion(name: str, choices: list[str]) -> str:
    lowered = {choice.lower(): choice for choice in choices}
    close = difflib.get_close_matches(name.lower(), list(lowered), n=3)
    if close:
        return f" {name!r}; did you mean {' or '.join(lowered[choice] for choice in close)}?"
    return f" {name!r}" + (f"; choose from {', '.join(choices)}" if len(choices) < 10 else "")
