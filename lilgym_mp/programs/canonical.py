"""Rewrites equivalent programs to one canonical form.

Each rewrite rule preserves the value on every scene, or that there is none, within the limits of `costs`. A rule that
changes which subexpressions are evaluated is applied only where they cannot fail, and one that relies on a type only
where `static_types` proves it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import Enum

from lilgym_mp.programs import syntax
from lilgym_mp.programs.static_types import (
    BOOL,
    BOX,
    INT,
    ITEM,
    ITEMS,
    UNKNOWN,
    Scope,
    Type,
    element_of,
    function_may_fail,
    is_hashable,
    may_fail,
    type_of,
)
from lilgym_mp.programs.syntax import (
    MAX_INT,
    Call,
    Comparison,
    Constant,
    Lambda,
    Logic,
    Member,
    Node,
    Not,
    SceneName,
    Variable,
    as_lambda,
    walk,
    with_children,
)
from lilgym_mp.programs.values import ATTRIBUTE_TYPES, Color, Shape, Size
from lilgym_mp.programs.words import WORDS, Parameter
from lilgym_mp.scene import BOX_COUNT

VARIABLES = ("x", "y", "z", "u", "v", "w")  # names by nesting depth; deeper variables are numbered
ATTRIBUTE_TESTS: Mapping[Enum, str] = {
    member: f"is_{member.name.lower()}" for kind in (Color, Size, Shape) for member in kind
}
_ATTRIBUTE_TEST_ORDER = {name: index for index, name in enumerate(ATTRIBUTE_TESTS.values())}
_MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<=", "==": "==", "!=": "!="}
_OPPOSITE = {"==": "!=", "!=": "==", "in": "not in", "not in": "in"}
Argument = Node | None  # of a call; None if it is left out
MAX_REPEATED = 100  # nodes of the middle of a comparison chain, which is written twice when the chain is split
_COLLECTION_TYPES = ("collection", "collection of items", "item or collection of items")


def canonical_form(node: Node) -> Node:
    """The canonical tree of a whole program.

    Variables are first renamed by nesting depth, so that no rule has to deal with shadowing.
    """
    return _rewrite(named_by_depth(node, variable_name, {}, 0), {})


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
    match node:
        case Lambda():
            return _rewrite_lambda(node, scope, UNKNOWN)
        case Call():
            return _rewrite_arguments(node, scope)
        case _:
            return with_children(node, lambda part: _rewrite(part, scope))


def _rewrite_arguments(call: Call, scope: Scope) -> Call:
    """Rewrites arguments; the parameter of a lambda gets the element type of the collection it is applied to."""
    done: list[Argument] = []
    for parameter, argument in zip(call.word.parameters, call.arguments, strict=True):
        is_function = argument and parameter.type.name == "function"
        function = as_lambda(argument, variable_name(len(scope))) if argument and is_function else None
        if function is not None:
            done.append(_rewrite_lambda(function, scope, _element_type(done[0], scope)))
        else:
            done.append(argument and _rewrite(argument, scope))
    return Call(call.word, tuple(done))


def _rewrite_lambda(node: Lambda, scope: Scope, element: Type) -> Lambda:
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
        case Comparison(left=left, operators=operators, rights=rights) if (
            sum(1 for right in rights for _ in walk(right)) <= MAX_REPEATED
        ):
            lefts = (left, *rights)
            steps = zip(lefts, operators, rights, strict=False)
            return Logic("and", tuple(Comparison(one, (operator,), (other,)) for one, operator, other in steps))
        case _:
            return node


# Calls


def _simplify_call(node: Call, scope: Scope) -> Node:
    word = node.word
    name = word.name
    arguments = _without_defaults(node)
    if word.group == "logic" and word.operator:
        return _as_python_operator(word.operator, arguments, scope) or node
    if word.operator and _all_have_type(arguments, INT, scope):
        return Comparison(_required(arguments[0]), (word.operator,), (_required(arguments[1]),))
    if word.form == "filter_{}":
        value = arguments[1]
        if isinstance(value, Constant) and isinstance(value.value, ATTRIBUTE_TYPES[word.attribute]):
            return _filter_by_attribute(_required(arguments[0]), value.value, scope)
    if name == "filter_obj":
        arguments = _merged_filter(arguments, scope)
    elif name == "Any" and _is_infallible_test(node, scope):  # otherwise an item after the first success might fail
        return _call("exist", _call("filter_obj", *arguments))
    elif name in ("exist", "count") and isinstance(arguments[0], Call) and arguments[0].word.name == "set":
        collected = arguments[0].arguments[0]
        if collected is not None and is_hashable(_element_type(collected, scope)):
            arguments = (collected,)
    elif name == "len" and _is_plain_selection(_required(arguments[0]), scope):
        return _call("count", arguments[0])
    elif name == "all_same" and isinstance(arguments[0], Call) and arguments[0].word.form == "query_{}":
        queried = _required(arguments[0].arguments[0])
        if type_of(queried, scope) in (ITEMS, BOX):
            return _call(f"all_same_{arguments[0].word.attribute}", queried)
    simpler = (
        _simplify_box_items(parameter, argument, scope)
        for parameter, argument in zip(node.word.parameters, arguments, strict=True)
    )
    return Call(node.word, tuple(simpler))


def _without_defaults(node: Call) -> tuple[Argument, ...]:
    """The arguments, with None for those equal to the default."""
    return tuple(
        None
        if isinstance(argument, Constant) and parameter.optional and argument.value is parameter.default
        else argument
        for parameter, argument in zip(node.word.parameters, node.arguments, strict=True)
    )


def _simplify_box_items(parameter: Parameter, argument: Argument, scope: Scope) -> Argument:
    """Replaces `b.all_items_in_box()` by `b` where any collection is accepted."""
    match argument:
        case Member(of=box, name="all_items_in_box", called=True) if parameter.type.name in _COLLECTION_TYPES:
            return box if type_of(box, scope) == BOX else argument
        case _:
            return argument


def _as_python_operator(operator: str, arguments: Sequence[Argument], scope: Scope) -> Argument:
    """AND, OR, NOT as Python's operators. These short-circuit, so the skipped operands must not fail."""
    operands = tuple(map(_required, arguments))
    if not _all_have_type(operands, BOOL, scope) or any(may_fail(operand, scope) for operand in operands[1:]):
        return None
    return Not(operands[0]) if operator == "not" else Logic(operator, operands)


def _filter_by_attribute(collection: Node, value: object, scope: Scope) -> Node:
    name = variable_name(len(scope))
    return _call("filter_obj", collection, Lambda(name, _attribute_test(value, Variable(name))))


def _merged_filter(arguments: Sequence[Argument], scope: Scope) -> tuple[Argument, ...]:
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
    if isinstance(node, Logic | Not):
        return with_children(node, lambda part: _as_truth(part, scope))
    return _call("exist", node) if type_of(node, scope) == ITEMS else node


def _is_plain_selection(node: Node, scope: Scope) -> bool:
    """Whether the collection is known to be a list without duplicates."""
    match node:
        case SceneName() | Member(name="all_items_in_box", called=True):
            return True
        case Call(word=word, arguments=(collection, *_)) if word.name.startswith("filter_") and collection is not None:
            return _is_plain_selection(collection, scope)
        case _:
            return type_of(node, scope) == BOX


# Logic


def _simplify_logic(node: Logic, scope: Scope) -> Node:
    operands: list[Node] = []
    for operand in node.operands:
        if isinstance(operand, Logic) and operand.operator == node.operator:
            operands.extend(operand.operands)
        else:
            operands.append(operand)
    attribute_tests = {operand: key for operand in operands if (key := _attribute_test_key(operand))}
    others = [operand for operand in operands if operand not in attribute_tests]
    commute = _all_have_type(operands, BOOL, scope) and not any(may_fail(operand, scope) for operand in operands)
    if commute and (node.operator == "and" or not others):
        operands = [*sorted(attribute_tests, key=attribute_tests.__getitem__), *others]
    if len(operands) == 1:
        return operands[0]
    return Logic(node.operator, tuple(operands))


def _attribute_test_key(node: Node) -> tuple[int, bool, str] | None:
    """Sort key of a test of a variable's colour, size or shape, possibly negated; None for other nodes."""
    match node.operand if isinstance(node, Not) else node:
        case Call(word=word, arguments=(Variable(name=name), *_)) if word.name in _ATTRIBUTE_TEST_ORDER:
            return _ATTRIBUTE_TEST_ORDER[word.name], isinstance(node, Not), name
        case _:
            return None


def _negated(operand: Node, scope: Scope) -> Argument:
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
        if operator in ("==", "!=") and (test := _attribute_test_of(left, right.value, scope)):
            return test if operator == "==" else Not(test)
    elif operator in ("<", "<="):
        return Comparison(right, (_MIRRORED[operator],), (left,))
    return Comparison(left, (operator,), (right,))


def _compare_with_constant(left: Node, operator: str, bound: int, scope: Scope) -> Node:
    """Normalises the comparison of an int with a constant to ==, !=, >= or <=; `count(s) >= 1` becomes `exist(s)`."""
    if (operator == ">" and bound < MAX_INT) or operator == "<":
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
        case Call(word=word, arguments=(SceneName(name="all_boxes"), test)) as chosen if (
            word.name == "filter_obj" and _is_infallible_test(chosen, scope)
        ):
            return _call("All", SceneName("all_boxes"), test)
        case _:
            return Comparison(left, (operator,), (Constant(bound),))


# Parts of the rules


def _is_infallible_test(node: Call, scope: Scope) -> bool:
    """Whether the second argument is a lambda that returns a bool for every element of the first, never failing."""
    collection, function = map(_required, node.arguments)
    if not isinstance(function, Lambda) or function_may_fail(function, _element_type(collection, scope), scope):
        return False
    return type_of(function.body, {**scope, function.parameter: _element_type(collection, scope)}) == BOOL


def _element_type(collection: Argument, scope: Scope) -> Type:
    return UNKNOWN if collection is None else element_of(type_of(collection, scope))


def _attribute_test_of(member: Node, value: object, scope: Scope) -> Call | None:
    """The test whether a member is this value, if it is an item's colour, shape or size, which it could be."""
    match member:
        case Member(of=item, name=name) if type(value) is ATTRIBUTE_TYPES.get(name) and type_of(item, scope) == ITEM:
            return _attribute_test(value, item)
        case _:
            return None


def _all_have_type(nodes: Sequence[Argument], expected: Type, scope: Scope) -> bool:
    return all(node is not None and type_of(node, scope) == expected for node in nodes)


def _required(node: Argument) -> Node:
    assert node is not None
    return node


def _call(name: str, *arguments: Argument) -> Call:
    return syntax.call(WORDS[name], *arguments)


def _attribute_test(value: object, item: Node) -> Call:
    assert isinstance(value, Enum)
    return _call(ATTRIBUTE_TESTS[value], item)


def named_by_depth(node: Node, name_of: Callable[[int], str], names: Mapping[str, Variable], depth: int) -> Node:
    """Renames each variable by the nesting depth of its lambda; `names`: the new ones by those bound so far."""
    match node:
        case Variable(name=name):
            return names.get(name, node)
        case Lambda(parameter=parameter, body=body):
            name = name_of(depth)
            known = {**names, parameter: Variable(name)}
            return Lambda(name, named_by_depth(body, name_of, known, depth + 1))
        case _:
            return with_children(node, lambda part: named_by_depth(part, name_of, names, depth))
