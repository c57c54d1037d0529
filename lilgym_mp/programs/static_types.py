"""Static types of expressions, and which expressions may fail.

An expression either fails or has a value of its `type_of`. Unless it `may_fail`, it has a value on every scene,
within the limits of `costs`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

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
    Not,
    SceneName,
    Slice,
    Subscript,
    Variable,
    WordName,
    as_lambda,
    children,
)
from lilgym_mp.programs.words import Parameter, Word
from lilgym_mp.scene import BOX_COUNT


@dataclass(frozen=True)
class Many:
    """A list, tuple or set of elements of one type. A box, also usable as the list of its items, is a BOX."""

    element: Type


Type = str | Many  # a str as in signatures of words: "bool", "item", "Color" ...
BOOL = "bool"
INT = "int"
ITEM = "item"
BOX = "box"
UNKNOWN = "value"
ITEMS = Many(ITEM)
BOXES = Many(BOX)
Scope = Mapping[str, Type]  # by variable

_MEMBERS: Mapping[str, Type] = {"box": BOX, "color": "Color", "shape": "Shape", "size": "Size"}
_COLLECTIONS = ("collection", "collection of collections")  # parameters whose elements a word may return
_METHODS: Mapping[str, Type] = {"is_tower": BOOL, "all_items_in_box": ITEMS}


def type_of(node: Node, scope: Scope) -> Type:
    """The type of a node's value, given those of the variables; UNKNOWN where it cannot be told beforehand."""
    match node:
        case Constant(value=value):
            return type(value).__name__
        case SceneName(name=name):
            return ITEMS if name == "all_items" else BOXES
        case Variable(name=name):
            return scope.get(name, UNKNOWN)
        case Lambda() | WordName():
            return "function"
        case Not() | Comparison():
            return BOOL
        case Logic(operands=operands):
            return _common(type_of(operand, scope) for operand in operands)
        case Member(name=name, called=called):
            return (_METHODS if called else _MEMBERS).get(name, UNKNOWN)
        case Arithmetic(left=left, right=right):
            sides = _common((type_of(left, scope), type_of(right, scope)))
            return sides if sides == INT or isinstance(sides, Many) else UNKNOWN
        case Subscript(of=of):
            return element_of(type_of(of, scope))
        case Slice(of=of):
            return Many(element_of(type_of(of, scope)))
        case Display(elements=elements):
            return Many(_common(type_of(element, scope) for element in elements))
        case Call(word=word, arguments=arguments):
            return _result_type(word, [_argument_type(argument, scope) for argument in arguments])


def element_of(collection: Type) -> Type:
    """The type of a collection's elements; a box is a collection of items."""
    if isinstance(collection, Many):
        return collection.element
    return ITEM if collection == BOX else UNKNOWN


def is_well_typed(tree: Node) -> bool:
    """Whether a program is of type bool, and its words and operators have operands of types that they accept."""
    return type_of(tree, {}) == BOOL and not may_fail(tree, {}, by_type=True)


def may_fail(node: Node, scope: Scope, *, by_type: bool = False) -> bool:
    """Whether evaluating the node might raise an error on some scene.

    With `by_type`, only because of operands' types, which for `==` and `!=` must be equal.
    """
    match node:
        case Call(word=word, arguments=arguments):
            return _call_may_fail(word, arguments, scope, by_type=by_type)
        case Lambda():
            return False  # until it is called
        case Subscript(of=SceneName(name="all_boxes"), index=Constant(value=int() as index)):
            return type(index) is bool or index >= BOX_COUNT
        case Subscript() | Slice() if not by_type:
            return True
        case _ if any(may_fail(child, scope, by_type=by_type) for child in children(node)):
            return True
        case Subscript(of=of) | Slice(of=of):
            return not _accepts("collection", type_of(of, scope))
        case Member(of=of, name=name):
            return type_of(of, scope) != (BOX if name in _METHODS else ITEM)
        case Comparison(left=left, operators=operators, rights=rights):
            types = [type_of(part, scope) for part in (left, *rights)]
            if by_type and {*operators} & {"==", "!="} and len({*types}) > 1 and not {*types} <= {INT, BOOL}:
                return True
            return any(map(_comparison_may_fail, operators, types[:-1], types[1:]))
        case Arithmetic() if by_type:
            return type_of(node, scope) == UNKNOWN
        case Arithmetic(operator=operator, left=left, right=right):
            ints = type_of(left, scope) == type_of(right, scope) == INT
            return not ints or (operator == "%" and (not isinstance(right, Constant) or right.value == 0))
        case Display(kind=kind, elements=elements):
            return kind is set and not all(is_hashable(type_of(element, scope)) for element in elements)
        case _:
            return False


def function_may_fail(function: Node, element: Type, scope: Scope, *, by_type: bool = False) -> bool:
    """Whether calling a lambda or word with a value of type `element` might raise an error."""
    called = as_lambda(function, "")
    return called is None or may_fail(called.body, {**scope, called.parameter: element}, by_type=by_type)


def _suits(word: Word, function: Node, element: Type, scope: Scope) -> bool:
    """Whether a word has a use for what a function returns for values of type `element`."""
    called = as_lambda(function, "")
    if called is None:
        return False
    inner = {**scope, called.parameter: element}
    is_strict = word.name in ("All", "Any")  # they want True, not what is truthy
    return type_of(called.body, inner) == BOOL if is_strict else _has_truth(called.body, inner)


def _has_truth(node: Node, scope: Scope) -> bool:
    """Whether a condition is true or false by the types of its parts, which may differ."""
    if isinstance(node, Logic):
        return all(_has_truth(operand, scope) for operand in node.operands)
    return type_of(node, scope) not in ("function", "Side", UNKNOWN)


def is_hashable(given: Type) -> bool:
    """Whether a set may hold values of the type."""
    return isinstance(given, str) and given != UNKNOWN


def _common(types: Iterable[Type]) -> Type:
    """The type that all have, UNKNOWN if they differ."""
    distinct = set(types)
    return distinct.pop() if len(distinct) == 1 else UNKNOWN


def _argument_type(argument: Node | None, scope: Scope) -> Type:
    return UNKNOWN if argument is None else type_of(argument, scope)


def _result_type(word: Word, arguments: Sequence[Type]) -> Type:
    """The type that the word's signature states. A value in a result of this package's words is an element of their
    collections."""
    pairs = zip(word.parameters, arguments, strict=True)
    elements = [_elements(parameter, given) for parameter, given in pairs if parameter.type.name in _COLLECTIONS]
    return _declared(word.result, UNKNOWN if word.is_extension else _common(elements))


def _elements(parameter: Parameter, given: Type) -> Type:
    """The type of the elements of what is given for a collection, or a collection of collections."""
    element = element_of(given)
    return element_of(element) if parameter.type.name == "collection of collections" else element


@cache
def _declared(result: str, value: Type) -> Type:
    found = re.fullmatch(r"(?:list|set|tuple)\[(.+?)(?:, \.\.\.)?\]", result)
    if found:
        return Many(_declared(found[1], value))
    return value if result == UNKNOWN else result


def _call_may_fail(word: Word, arguments: Sequence[Node | None], scope: Scope, *, by_type: bool) -> bool:
    required = [parameter for parameter in word.parameters if not parameter.optional]
    if None in arguments[: len(required)] or (not by_type and (word.is_extension or word.fails_on == "some values")):
        return True
    types = [_argument_type(argument, scope) for argument in arguments]
    for parameter, argument, given in zip(word.parameters, arguments, types, strict=True):
        if argument is None:
            continue
        if parameter.type.name == "function":
            element = element_of(types[0])
            if function_may_fail(argument, element, scope, by_type=by_type):
                return True
            if by_type and not _suits(word, argument, element, scope):
                return True
        elif may_fail(argument, scope, by_type=by_type) or not _accepts(parameter.type.name, given):
            return True
    return word.fails_on == "unhashable elements" and not all(
        argument is None or is_hashable(_elements(parameter, given))
        for parameter, argument, given in zip(word.parameters, arguments, types, strict=True)
    )


def _accepts(wanted: str, given: Type) -> bool:
    """Whether a parameter, its type named as in signatures, accepts every value of a type."""
    one, _, other = wanted.partition(" or ")
    if other:
        return _accepts(one, given) or _accepts(other, given)
    if wanted.startswith("collection"):
        element = wanted.removeprefix("collection of ").removesuffix("s") if " of " in wanted else UNKNOWN
        return (isinstance(given, Many) or given == BOX) and _accepts(element, element_of(given))
    return wanted in (UNKNOWN, given)


def _comparison_may_fail(operator: str, left: Type, right: Type) -> bool:
    if operator in ("==", "!="):
        return False
    if operator in ("in", "not in"):
        return not _accepts("collection", right) or not is_hashable(left)
    return not {left, right} <= {INT, BOOL}
