"""Rewrites equivalent programs to one canonical form.

Each rewrite rule preserves the truth value on every scene. A rule that changes which subexpressions are evaluated is
applied only when they cannot raise an error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import Enum

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
    children,
)
from lilgym_mp.programs.values import Color, Shape, Size
from lilgym_mp.programs.words import WORDS, Parameter, Word
from lilgym_mp.scene import BOX_COUNT

VARIABLES = ("x", "y", "z", "u", "v", "w")  # names by nesting depth; deeper variables are numbered
ATTRIBUTE_TESTS: Mapping[Enum, str] = {
    **{color: f"is_{color.name.lower()}" for color in Color},
    **{size: f"is_{size.name.lower()}" for size in Size},
    **{shape: f"is_{shape.name.lower()}" for shape in Shape},
}
_ATTRIBUTE_TEST_ORDER = {name: index for index, name in enumerate(ATTRIBUTE_TESTS.values())}
_MEMBER_TYPES = {"color": Color, "shape": Shape, "size": Size}
_FILTERS = {"filter_color": Color, "filter_shape": Shape, "filter_size": Size}
_QUERIES = {f"query_{name}": f"all_same_{name}" for name in _MEMBER_TYPES}
_COMPARISONS = {"le": "<=", "ge": ">=", "lt": "<", "gt": ">", "equal_int": "=="}
_MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<=", "==": "==", "!=": "!="}
_OPPOSITE = {"==": "!=", "!=": "==", "in": "not in", "not in": "in"}
_CONNECTIVES = {"AND": "and", "OR": "or"}
_COLLECTION_TYPES = ("collection", "collection of items", "item or collection of items")

# Static types of expressions
BOOL, INT, ITEM, BOX, ITEMS, BOXES, OTHER = "bool", "int", "item", "box", "items", "boxes", "other"
_ELEMENT_TYPES = {ITEMS: ITEM, BOXES: BOX, BOX: ITEM}
Scope = Mapping[str, str]  # by variable


def canonical_form(node: Node) -> Node:
    """The canonical tree of a whole program.

    Variables are first renamed by nesting depth, so that no rule has to deal with shadowing.
    """
    return _rewrite(_named_by_depth(node, {}, 0), {})


def variable_name(depth: int) -> str:
    """The name of the parameter of a lambda nested inside `depth` others."""
    return VARIABLES[depth] if depth < len(VARIABLES) else f"{VARIABLES[-1]}{depth}"


def _rewrite(node: Node, scope: Scope) -> Node:
    """Canonicalises the children, then applies rules until a fixed point is reached."""
    node = _rewrite_children(node, scope)
    while (simpler := _simplify(node, scope)) != node:
        node = _rewrite_children(simpler, scope)
    return node


def _rewrite_children(node: Node, scope: Scope) -> Node:
    def inner(part: Node) -> Node:
        return _rewrite(part, scope)

    match node:
        case Lambda():
            return _rewrite_lambda(node, scope, OTHER)
        case Call(word=word, arguments=arguments):
            return Call(word, _rewrite_arguments(word, arguments, scope))
        case _:
            return _map_children(node, inner)


def _rewrite_arguments(word: Word, arguments: Sequence[Node | None], scope: Scope) -> tuple[Node | None, ...]:
    """Rewrites arguments; the parameter of a lambda gets the element type of the collection it is applied to."""
    done: list[Node | None] = []
    for parameter, argument in zip(word.parameters, arguments, strict=True):
        if argument is None:
            done.append(None)
        elif parameter.type.name == "function":
            done.append(_rewrite_function(argument, scope, _element_type(done[0], scope)))
        else:
            done.append(_rewrite(argument, scope))
    return tuple(done)


def _rewrite_function(node: Node, scope: Scope, element: str) -> Node:
    if isinstance(node, WordName) and all(parameter.optional for parameter in node.word.parameters[1:]):
        name = variable_name(len(scope))
        rest: tuple[None, ...] = (None,) * (len(node.word.parameters) - 1)
        node = Lambda(name, Call(node.word, (Variable(name), *rest)))
    return _rewrite_lambda(node, scope, element) if isinstance(node, Lambda) else _rewrite(node, scope)


def _rewrite_lambda(node: Lambda, scope: Scope, element: str) -> Lambda:
    return Lambda(node.parameter, _rewrite(node.body, {**scope, node.parameter: element}))


def _simplify(node: Node, scope: Scope) -> Node:
    """Applies one rule, or returns the node unchanged."""
    match node:
        case Call():
            return _simplify_call(node, scope)
        case Logic():
            return _simplify_logic(node, scope)
        case Not(operand=operand):
            return _negated(operand, scope) or node
        case Comparison(left=left, operators=(operator,), rights=(right,)):
            return _simplify_comparison(left, operator, right, scope)
        case Comparison(left=left, operators=operators, rights=rights):
            lefts = (left, *rights)
            steps = zip(lefts, operators, rights, strict=False)
            return Logic("and", tuple(Comparison(one, (operator,), (other,)) for one, operator, other in steps))
        case _:
            return node


# Calls


def _simplify_call(node: Call, scope: Scope) -> Node:
    name, arguments = node.word.name, _without_defaults(node)
    if name in _CONNECTIVES or name == "NOT":
        return _as_python_operator(name, arguments, scope) or node
    if name in _COMPARISONS and _all_have_type(arguments, INT, scope):
        return Comparison(_required(arguments[0]), (_COMPARISONS[name],), (_required(arguments[1]),))
    if name in ("equal", "equal_color", "equal_shape", "equal_size"):
        return _simplify_equality(node, arguments, scope)
    if name in _FILTERS and isinstance(arguments[1], Constant) and _is_attribute_value(arguments[1].value):
        return _filter_by_attribute(_required(arguments[0]), arguments[1].value, scope)
    if name == "filter_obj":
        arguments = _merged_filter(arguments, scope)
    elif name == "Any" and isinstance(arguments[1], Lambda) and _body_type(node, scope) == BOOL:
        return _call("exist", _call("filter_obj", *arguments))
    elif name in ("exist", "count") and isinstance(arguments[0], Call) and arguments[0].word.name == "set":
        arguments = arguments[0].arguments
    elif name == "len" and _is_plain_selection(_required(arguments[0])):
        return _call("count", arguments[0])
    elif name == "all_same" and isinstance(arguments[0], Call) and arguments[0].word.name in _QUERIES:
        queried = _required(arguments[0].arguments[0])
        if type_of(queried, scope) in (ITEMS, BOX):
            return _call(_QUERIES[arguments[0].word.name], queried)
    return Call(node.word, tuple(map(_simplify_box_items, node.word.parameters, arguments)))


def _without_defaults(node: Call) -> tuple[Node | None, ...]:
    """The arguments, with None for those equal to the default."""
    return tuple(
        None
        if isinstance(argument, Constant) and parameter.optional and argument.value is parameter.default
        else argument
        for parameter, argument in zip(node.word.parameters, node.arguments, strict=True)
    )


def _simplify_box_items(parameter: Parameter, argument: Node | None) -> Node | None:
    """Replaces `b.all_items_in_box()` by `b` where any collection is accepted."""
    match argument:
        case Member(of=box, name="all_items_in_box", called=True) if parameter.type.name in _COLLECTION_TYPES:
            return box
        case _:
            return argument


def _as_python_operator(name: str, arguments: Sequence[Node | None], scope: Scope) -> Node | None:
    """AND, OR, NOT as Python's operators. These short-circuit, so the skipped operands must not raise."""
    operands = tuple(map(_required, arguments))
    if not _all_have_type(operands, BOOL, scope) or any(may_raise(operand, scope) for operand in operands[1:]):
        return None
    return Not(operands[0]) if name == "NOT" else Logic(_CONNECTIVES[name], operands)


def _simplify_equality(node: Call, arguments: Sequence[Node | None], scope: Scope) -> Node:
    left, right = map(_required, arguments)
    types = {type_of(left, scope), type_of(right, scope)}
    if types == {INT} or (_is_attribute(left, scope) and isinstance(right, Constant)):
        return Comparison(left, ("==",), (right,))
    if isinstance(left, Constant) and not isinstance(right, Constant):
        return Call(node.word, (right, left))
    return Call(node.word, tuple(arguments))


def _filter_by_attribute(collection: Node, value: object, scope: Scope) -> Node:
    name = variable_name(len(scope))
    return _call("filter_obj", collection, Lambda(name, _attribute_test(value, Variable(name))))


def _merged_filter(arguments: Sequence[Node | None], scope: Scope) -> tuple[Node | None, ...]:
    """Merges nested filters into one filter by the conjunction."""
    collection, function = arguments
    if not isinstance(function, Lambda):
        return collection, function
    body = _as_truth(function.body, {**scope, function.parameter: _element_type(collection, scope)})
    match collection:
        case Call(word=word, arguments=(inner, Lambda(body=first))) if word.name == "filter_obj":
            return inner, Lambda(function.parameter, Logic("and", (first, body)))
        case _:
            return collection, Lambda(function.parameter, body)


def _as_truth(node: Node, scope: Scope) -> Node:
    """Makes the truthiness of a collection of items explicit as `exist`."""
    match node:
        case Logic(operands=operands):
            return replace(node, operands=tuple(_as_truth(operand, scope) for operand in operands))
        case Not(operand=operand):
            return Not(_as_truth(operand, scope))
        case _:
            return _call("exist", node) if type_of(node, scope) == ITEMS else node


def _is_plain_selection(node: Node) -> bool:
    """Whether the collection is known to be a list without duplicates."""
    match node:
        case SceneName() | Member(name="all_items_in_box", called=True):
            return True
        case Call(word=word, arguments=(collection, *_)) if word.name.startswith("filter_") and collection is not None:
            return _is_plain_selection(collection)
        case _:
            return False


# Logic


def _simplify_logic(node: Logic, scope: Scope) -> Node:
    operands: list[Node] = []
    for operand in node.operands:
        if isinstance(operand, Logic) and operand.operator == node.operator:
            operands.extend(operand.operands)
        else:
            operands.append(operand)
    attribute_tests = [operand for operand in operands if _is_attribute_test(operand)]
    others = [operand for operand in operands if not _is_attribute_test(operand)]
    if node.operator == "and" and not any(may_raise(operand, scope) for operand in others):
        attribute_tests = sorted(dict.fromkeys(attribute_tests), key=_attribute_test_key)
        operands = [*attribute_tests, *others]
    elif all(map(_is_attribute_test, operands)):
        operands = sorted(dict.fromkeys(operands), key=_attribute_test_key)
    if len(operands) == 1:
        return operands[0]
    return Logic(node.operator, tuple(operands))


def _is_attribute_test(node: Node) -> bool:
    """Whether the node tests the colour, size or shape of a variable, possibly negated."""
    inner = node.operand if isinstance(node, Not) else node
    return (
        isinstance(inner, Call)
        and inner.word.name in _ATTRIBUTE_TEST_ORDER
        and isinstance(inner.arguments[0], Variable)
    )


def _attribute_test_key(node: Node) -> tuple[int, bool, str]:
    inner = node.operand if isinstance(node, Not) else node
    assert isinstance(inner, Call)
    return _ATTRIBUTE_TEST_ORDER[inner.word.name], isinstance(node, Not), str(inner.arguments[0])


def _negated(operand: Node, scope: Scope) -> Node | None:
    """The simplification of `not operand`, or None."""
    match operand:
        case Not(operand=inner) if type_of(inner, scope) == BOOL:
            return inner
        case Comparison(operators=(operator,)) if operator in _OPPOSITE:
            return replace(operand, operators=(_OPPOSITE[operator],))
        case _:
            return None


# Comparisons


def _simplify_comparison(left: Node, operator: str, right: Node, scope: Scope) -> Node:
    if isinstance(left, Constant) and not isinstance(right, Constant) and operator in _MIRRORED:
        return Comparison(right, (_MIRRORED[operator],), (left,))
    if isinstance(right, Constant):
        if type(right.value) is int and type_of(left, scope) == INT:
            return _compare_with_constant(left, operator, right.value, scope)
        if operator in ("==", "!=") and isinstance(right.value, Enum) and _is_attribute(left, scope):
            assert isinstance(left, Member)
            if isinstance(right.value, _MEMBER_TYPES[left.name]):
                test = _attribute_test(right.value, left.of)
                return test if operator == "==" else Not(test)
    elif operator in ("<", "<="):
        return Comparison(right, (_MIRRORED[operator],), (left,))
    return Comparison(left, (operator,), (right,))


def _compare_with_constant(left: Node, operator: str, bound: int, scope: Scope) -> Node:
    """Normalises the comparison of an int with a constant to ==, !=, >= or <=; `count(s) >= 1` becomes `exist(s)`."""
    if operator in (">", "<"):
        operator, bound = (">=", bound + 1) if operator == ">" else ("<=", bound - 1)
    if isinstance(left, Call) and left.word.name == "count":
        if (operator, bound) in ((">=", 1), ("!=", 0)):
            return _call("exist", left.arguments[0])
        if (operator, bound) in (("<=", 0), ("==", 0)):
            return Not(_call("exist", left.arguments[0]))
        if operator in ("==", ">=") and bound == BOX_COUNT:
            return _all_boxes_satisfy(left, operator, bound, scope)
    if bound < 0:  # the language has no negative numbers: n <= -1 stays n < 0
        return Comparison(left, ("<",), (Constant(bound + 1),))
    return Comparison(left, (operator,), (Constant(bound),))


def _all_boxes_satisfy(left: Call, operator: str, bound: int, scope: Scope) -> Node:
    """`All` for a condition satisfied by as many boxes as there are."""
    match left.arguments[0]:
        case Call(word=word, arguments=(SceneName(name="all_boxes"), Lambda() as test)) as chosen if (
            word.name == "filter_obj" and _body_type(chosen, scope) == BOOL
        ):
            return _call("All", SceneName("all_boxes"), test)
        case _:
            return Comparison(left, (operator,), (Constant(bound),))


# Static types


def type_of(node: Node, scope: Scope) -> str:
    """The static type of a node, OTHER if unknown."""
    match node:
        case Constant(value=bool()) | Not() | Comparison():
            return BOOL
        case Constant(value=int()):
            return INT
        case SceneName(name=name):
            return ITEMS if name == "all_items" else BOXES
        case Variable(name=name):
            return scope.get(name, OTHER)
        case Logic(operands=operands):
            return BOOL if _all_have_type(operands, BOOL, scope) else OTHER
        case Member(name="is_tower", called=True):
            return BOOL
        case Member(name="all_items_in_box", called=True):
            return ITEMS
        case Member(of=of, name="box"):
            return BOX if type_of(of, scope) == ITEM else OTHER
        case Arithmetic(left=left, right=right):
            return INT if _all_have_type((left, right), INT, scope) else OTHER
        case Subscript(of=of):
            return _ELEMENT_TYPES.get(type_of(of, scope), OTHER)
        case Call(word=word, arguments=arguments):
            return _result_type(word, arguments, scope)
        case _:
            return OTHER


def _result_type(word: Word, arguments: Sequence[Node | None], scope: Scope) -> str:
    if word.result in (BOOL, INT):
        return word.result
    if word.name.startswith(("filter_", "set", "union", "intersect")) and arguments and arguments[0] is not None:
        collection = type_of(arguments[0], scope)
        return ITEMS if collection == BOX else collection
    if word.group == "related items":
        return ITEMS
    if word.name in ("unique", "min") and arguments[0] is not None:
        return _ELEMENT_TYPES.get(type_of(arguments[0], scope), OTHER)
    return OTHER


def may_raise(node: Node, scope: Scope) -> bool:
    """Conservative check: whether evaluating the node might raise an error on some scene."""
    match node:
        case Call(word=word) if word.name in ("unique", "min", "select", "combinations", "union_all", "intersect_all"):
            return True
        case Subscript(of=SceneName(name="all_boxes"), index=Constant(value=int() as index)) if 0 <= index < BOX_COUNT:
            return False
        case Subscript() | Slice() | Arithmetic():
            return True
        case Variable(name=name):
            return scope.get(name, OTHER) == OTHER
        case Lambda(body=body, parameter=parameter):
            return may_raise(body, {**scope, parameter: scope.get(parameter, OTHER)})
        case Call(word=word, arguments=(first, Lambda() as function, *_)) if first is not None:
            inner = {**scope, function.parameter: _element_type(first, scope)}
            return may_raise(first, scope) or may_raise(function.body, inner)
        case _:
            return any(may_raise(child, scope) for child in children(node))


def _body_type(node: Call, scope: Scope) -> str:
    """The return type of the second argument, a lambda, applied to the elements of the first."""
    collection, function = node.arguments[0], node.arguments[1]
    assert isinstance(function, Lambda)
    return type_of(function.body, {**scope, function.parameter: _element_type(collection, scope)})


def _element_type(collection: Node | None, scope: Scope) -> str:
    """The element type of the collection."""
    return OTHER if collection is None else _ELEMENT_TYPES.get(type_of(collection, scope), OTHER)


def _is_attribute(node: Node, scope: Scope) -> bool:
    """Whether the node is an attribute (colour, shape or size) of an item."""
    return isinstance(node, Member) and node.name in _MEMBER_TYPES and type_of(node.of, scope) == ITEM


def _all_have_type(nodes: Sequence[Node | None], expected: str, scope: Scope) -> bool:
    return all(node is not None and type_of(node, scope) == expected for node in nodes)


def _required(node: Node | None) -> Node:
    assert node is not None
    return node


def _call(name: str, *arguments: Node | None) -> Call:
    word = WORDS[name]
    rest: tuple[None, ...] = (None,) * (len(word.parameters) - len(arguments))
    return Call(word, (*arguments, *rest))


def _is_attribute_value(value: object) -> bool:
    return isinstance(value, Enum) and value in ATTRIBUTE_TESTS


def _attribute_test(value: object, item: Node) -> Call:
    assert isinstance(value, Enum)
    return _call(ATTRIBUTE_TESTS[value], item)


# Names of variables


def _map_children(node: Node, changed: Callable[[Node], Node]) -> Node:
    """Maps `changed` over the children; calls and lambdas, which callers treat separately, are returned unchanged."""
    match node:
        case Member(of=of):
            return replace(node, of=changed(of))
        case Logic(operands=operands):
            return replace(node, operands=tuple(map(changed, operands)))
        case Not(operand=operand):
            return Not(changed(operand))
        case Comparison(left=left, rights=rights):
            return replace(node, left=changed(left), rights=tuple(map(changed, rights)))
        case Arithmetic(left=left, right=right):
            return replace(node, left=changed(left), right=changed(right))
        case Subscript(of=of, index=index):
            return Subscript(changed(of), changed(index))
        case Slice(of=of, start=start, stop=stop, step=step):
            return Slice(changed(of), *(None if part is None else changed(part) for part in (start, stop, step)))
        case Display(elements=elements):
            return replace(node, elements=tuple(map(changed, elements)))
        case _:
            return node


def _named_by_depth(node: Node, names: Mapping[str, Variable], depth: int) -> Node:
    """Renames each variable by the nesting depth of its lambda."""

    def inner(part: Node) -> Node:
        return _named_by_depth(part, names, depth)

    match node:
        case Variable(name=name):
            return names.get(name, node)
        case Lambda(parameter=parameter, body=body):
            name = variable_name(depth)
            return Lambda(name, _named_by_depth(body, {**names, parameter: Variable(name)}, depth + 1))
        case Call(word=word, arguments=arguments):
            return Call(word, tuple(None if part is None else inner(part) for part in arguments))
        case _:
            return _map_children(node, inner)
