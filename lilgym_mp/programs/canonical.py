"""One form for programs that say the same thing in different ways.

Each rule below keeps a program's truth in every scene. Rules that change which parts are evaluated are used only
where those parts cannot raise an error.
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

VARIABLES = ("x", "y", "z", "u", "v", "w")  # by depth of nesting; deeper ones are numbered
LOOK_TESTS: Mapping[Enum, str] = {
    **{color: f"is_{color.name.lower()}" for color in Color},
    **{size: f"is_{size.name.lower()}" for size in Size},
    **{shape: f"is_{shape.name.lower()}" for shape in Shape},
}
_ITEM_TYPE_ORDER = {name: place for place, name in enumerate(LOOK_TESTS.values())}
_MEMBER_TYPES = {"color": Color, "shape": Shape, "size": Size}
_FILTERS = {"filter_color": Color, "filter_shape": Shape, "filter_size": Size}
_QUERIES = {f"query_{name}": f"all_same_{name}" for name in _MEMBER_TYPES}
_COMPARISONS = {"le": "<=", "ge": ">=", "lt": "<", "gt": ">", "equal_int": "=="}
_MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<=", "==": "==", "!=": "!="}
_OPPOSITE = {"==": "!=", "!=": "==", "in": "not in", "not in": "in"}
_CONNECTIVES = {"AND": "and", "OR": "or"}
_COLLECTION_KINDS = ("collection", "collection of items", "item or collection of items")

# What an expression gives, as far as it is known; a collection is written with its elements: "items" holds "item".
BOOL, INT, ITEM, BOX, ITEMS, BOXES, OTHER = "bool", "int", "item", "box", "items", "boxes", "other"
_ELEMENTS = {ITEMS: ITEM, BOXES: BOX, BOX: ITEM}
Scope = Mapping[str, str]  # by variable


def canonical_form(node: Node) -> Node:
    """The canonical tree of a whole program: equal in truth on every scene.

    Variables are named by depth first, so that no lambda hides another's variable in what follows.
    """
    return _rewritten(_named_by_depth(node, {}, 0), {})


def variable_name(depth: int) -> str:
    """The name of the variable of a lambda inside `depth` others."""
    return VARIABLES[depth] if depth < len(VARIABLES) else f"{VARIABLES[-1]}{depth}"


def _rewritten(node: Node, scope: Scope) -> Node:
    """The node with canonical parts, rules applied until none fits."""
    node = _with_canonical_parts(node, scope)
    while (simpler := _simplified(node, scope)) != node:
        node = _with_canonical_parts(simpler, scope)
    return node


def _with_canonical_parts(node: Node, scope: Scope) -> Node:
    def inner(part: Node) -> Node:
        return _rewritten(part, scope)

    match node:
        case Lambda():
            return _rewritten_lambda(node, scope, OTHER)
        case Call(word=word, arguments=arguments):
            return Call(word, _rewritten_arguments(word, arguments, scope))
        case _:
            return _with_parts(node, inner)


def _rewritten_arguments(word: Word, arguments: Sequence[Node | None], scope: Scope) -> tuple[Node | None, ...]:
    """Arguments, functions in the knowledge of what they are applied to."""
    done: list[Node | None] = []
    for parameter, argument in zip(word.parameters, arguments, strict=True):
        if argument is None:
            done.append(None)
        elif parameter.type.name == "function":
            done.append(_rewritten_function(argument, scope, _element(done[0], scope)))
        else:
            done.append(_rewritten(argument, scope))
    return tuple(done)


def _rewritten_function(node: Node, scope: Scope, element: str) -> Node:
    if isinstance(node, WordName) and all(parameter.optional for parameter in node.word.parameters[1:]):
        name = variable_name(len(scope))
        rest: tuple[None, ...] = (None,) * (len(node.word.parameters) - 1)
        node = Lambda(name, Call(node.word, (Variable(name), *rest)))
    return _rewritten_lambda(node, scope, element) if isinstance(node, Lambda) else _rewritten(node, scope)


def _rewritten_lambda(node: Lambda, scope: Scope, element: str) -> Lambda:
    return Lambda(node.parameter, _rewritten(node.body, {**scope, node.parameter: element}))


def _simplified(node: Node, scope: Scope) -> Node:
    """The node after one rule, or as it is."""
    match node:
        case Call():
            return _simplified_call(node, scope)
        case Logic():
            return _simplified_logic(node, scope)
        case Not(operand=operand):
            return _negated(operand, scope) or node
        case Comparison(left=left, operators=(operator,), rights=(right,)):
            return _simplified_comparison(left, operator, right, scope)
        case Comparison(left=left, operators=operators, rights=rights):
            lefts = (left, *rights)
            steps = zip(lefts, operators, rights, strict=False)
            return Logic("and", tuple(Comparison(one, (operator,), (other,)) for one, operator, other in steps))
        case _:
            return node


# Calls


def _simplified_call(node: Call, scope: Scope) -> Node:
    name, arguments = node.word.name, _without_defaults(node)
    if name in _CONNECTIVES or name == "NOT":
        return _connected(name, arguments, scope) or node
    if name in _COMPARISONS and _all_of(arguments, INT, scope):
        return Comparison(_given(arguments[0]), (_COMPARISONS[name],), (_given(arguments[1]),))
    if name in ("equal", "equal_color", "equal_shape", "equal_size"):
        return _equality(node, arguments, scope)
    if name in _FILTERS and isinstance(arguments[1], Constant) and _is_look(arguments[1].value):
        return _filtered(_given(arguments[0]), arguments[1].value, scope)
    if name == "filter_obj":
        arguments = _merged_filter(arguments, scope)
    elif name == "Any" and isinstance(arguments[1], Lambda) and _body_kind(node, scope) == BOOL:
        return _call("exist", _call("filter_obj", *arguments))
    elif name in ("exist", "count") and isinstance(arguments[0], Call) and arguments[0].word.name == "set":
        arguments = arguments[0].arguments
    elif name == "len" and _is_plain_selection(_given(arguments[0])):
        return _call("count", arguments[0])
    elif name == "all_same" and isinstance(arguments[0], Call) and arguments[0].word.name in _QUERIES:
        queried = _given(arguments[0].arguments[0])
        if kind_of(queried, scope) in (ITEMS, BOX):
            return _call(_QUERIES[arguments[0].word.name], queried)
    return Call(node.word, tuple(map(_box_itself, node.word.parameters, arguments)))


def _without_defaults(node: Call) -> tuple[Node | None, ...]:
    """The arguments, None for what is the default anyway."""
    return tuple(
        None
        if isinstance(argument, Constant) and parameter.optional and argument.value is parameter.default
        else argument
        for parameter, argument in zip(node.word.parameters, node.arguments, strict=True)
    )


def _box_itself(parameter: Parameter, argument: Node | None) -> Node | None:
    """A box where its list of items is given for a collection: the same elements in the same order."""
    match argument:
        case Member(of=box, name="all_items_in_box", called=True) if parameter.type.name in _COLLECTION_KINDS:
            return box
        case _:
            return argument


def _connected(name: str, arguments: Sequence[Node | None], scope: Scope) -> Node | None:
    """Python's connectives for the words of logic; they skip operands, so those must not raise."""
    operands = tuple(map(_given, arguments))
    if not _all_of(operands, BOOL, scope) or any(may_raise(operand, scope) for operand in operands[1:]):
        return None
    return Not(operands[0]) if name == "NOT" else Logic(_CONNECTIVES[name], operands)


def _equality(node: Call, arguments: Sequence[Node | None], scope: Scope) -> Node:
    left, right = map(_given, arguments)
    kinds = {kind_of(left, scope), kind_of(right, scope)}
    if kinds == {INT} or (_is_member(left, scope) and isinstance(right, Constant)):
        return Comparison(left, ("==",), (right,))
    if isinstance(left, Constant) and not isinstance(right, Constant):
        return Call(node.word, (right, left))
    return Call(node.word, tuple(arguments))


def _filtered(collection: Node, value: object, scope: Scope) -> Node:
    name = variable_name(len(scope))
    return _call("filter_obj", collection, Lambda(name, _look_test(value, Variable(name))))


def _merged_filter(arguments: Sequence[Node | None], scope: Scope) -> tuple[Node | None, ...]:
    """A filter of a filter as one filter by both."""
    collection, function = arguments
    if not isinstance(function, Lambda):
        return collection, function
    body = _as_truth(function.body, {**scope, function.parameter: _element(collection, scope)})
    match collection:
        case Call(word=word, arguments=(inner, Lambda(body=first))) if word.name == "filter_obj":
            return inner, Lambda(function.parameter, Logic("and", (first, body)))
        case _:
            return collection, Lambda(function.parameter, body)


def _as_truth(node: Node, scope: Scope) -> Node:
    """A condition that is a collection of items, which holds when that is not empty, as such a question."""
    match node:
        case Logic(operands=operands):
            return replace(node, operands=tuple(_as_truth(operand, scope) for operand in operands))
        case Not(operand=operand):
            return Not(_as_truth(operand, scope))
        case _:
            return _call("exist", node) if kind_of(node, scope) == ITEMS else node


def _is_plain_selection(node: Node) -> bool:
    """Whether the collection is a list of items or boxes without repetitions."""
    match node:
        case SceneName() | Member(name="all_items_in_box", called=True):
            return True
        case Call(word=word, arguments=(collection, *_)) if word.name.startswith("filter_") and collection is not None:
            return _is_plain_selection(collection)
        case _:
            return False


# Logic


def _simplified_logic(node: Logic, scope: Scope) -> Node:
    operands: list[Node] = []
    for operand in node.operands:
        if isinstance(operand, Logic) and operand.operator == node.operator:
            operands.extend(operand.operands)
        else:
            operands.append(operand)
    looks = [operand for operand in operands if _is_look_test(operand)]
    others = [operand for operand in operands if not _is_look_test(operand)]
    if node.operator == "and" and not any(may_raise(operand, scope) for operand in others):
        looks = sorted(dict.fromkeys(looks), key=_look_place)
        operands = [*looks, *others]
    elif all(map(_is_look_test, operands)):
        operands = sorted(dict.fromkeys(operands), key=_look_place)
    if len(operands) == 1:
        return operands[0]
    return Logic(node.operator, tuple(operands))


def _is_look_test(node: Node) -> bool:
    """Whether it asks a variable's colour, size or shape."""
    inner = node.operand if isinstance(node, Not) else node
    return isinstance(inner, Call) and inner.word.name in _ITEM_TYPE_ORDER and isinstance(inner.arguments[0], Variable)


def _look_place(node: Node) -> tuple[int, bool, str]:
    inner = node.operand if isinstance(node, Not) else node
    assert isinstance(inner, Call)
    return _ITEM_TYPE_ORDER[inner.word.name], isinstance(node, Not), str(inner.arguments[0])


def _negated(operand: Node, scope: Scope) -> Node | None:
    """What `not operand` simplifies to."""
    match operand:
        case Not(operand=inner) if kind_of(inner, scope) == BOOL:
            return inner
        case Comparison(operators=(operator,)) if operator in _OPPOSITE:
            return replace(operand, operators=(_OPPOSITE[operator],))
        case _:
            return None


# Comparisons


def _simplified_comparison(left: Node, operator: str, right: Node, scope: Scope) -> Node:
    if isinstance(left, Constant) and not isinstance(right, Constant) and operator in _MIRRORED:
        return Comparison(right, (_MIRRORED[operator],), (left,))
    if isinstance(right, Constant):
        if type(right.value) is int and kind_of(left, scope) == INT:
            return _bounded(left, operator, right.value, scope)
        if operator in ("==", "!=") and isinstance(right.value, Enum) and _is_member(left, scope):
            assert isinstance(left, Member)
            if isinstance(right.value, _MEMBER_TYPES[left.name]):
                test = _look_test(right.value, left.of)
                return test if operator == "==" else Not(test)
    elif operator in ("<", "<="):
        return Comparison(right, (_MIRRORED[operator],), (left,))
    return Comparison(left, (operator,), (right,))


def _bounded(left: Node, operator: str, bound: int, scope: Scope) -> Node:
    """A whole number against a constant: ==, !=, >= or <=; a count of at least one is existence."""
    if operator in (">", "<"):
        operator, bound = (">=", bound + 1) if operator == ">" else ("<=", bound - 1)
    if isinstance(left, Call) and left.word.name == "count":
        if (operator, bound) in ((">=", 1), ("!=", 0)):
            return _call("exist", left.arguments[0])
        if (operator, bound) in (("<=", 0), ("==", 0)):
            return Not(_call("exist", left.arguments[0]))
        if operator in ("==", ">=") and bound == BOX_COUNT:
            return _of_all_boxes(left, operator, bound, scope)
    if bound < 0:  # the language has no negative numbers: n <= -1 stays n < 0
        return Comparison(left, ("<",), (Constant(bound + 1),))
    return Comparison(left, (operator,), (Constant(bound),))


def _of_all_boxes(left: Call, operator: str, bound: int, scope: Scope) -> Node:
    """That a condition holds of as many boxes as there are."""
    match left.arguments[0]:
        case Call(word=word, arguments=(SceneName(name="all_boxes"), Lambda() as test)) as chosen if (
            word.name == "filter_obj" and _body_kind(chosen, scope) == BOOL
        ):
            return _call("All", SceneName("all_boxes"), test)
        case _:
            return Comparison(left, (operator,), (Constant(bound),))


# What expressions give


def kind_of(node: Node, scope: Scope) -> str:
    """What the node gives, "other" where that is not known."""
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
            return BOOL if _all_of(operands, BOOL, scope) else OTHER
        case Member(name="is_tower", called=True):
            return BOOL
        case Member(name="all_items_in_box", called=True):
            return ITEMS
        case Member(of=of, name="box"):
            return BOX if kind_of(of, scope) == ITEM else OTHER
        case Arithmetic(left=left, right=right):
            return INT if _all_of((left, right), INT, scope) else OTHER
        case Subscript(of=of):
            return _ELEMENTS.get(kind_of(of, scope), OTHER)
        case Call(word=word, arguments=arguments):
            return _result_kind(word, arguments, scope)
        case _:
            return OTHER


def _result_kind(word: Word, arguments: Sequence[Node | None], scope: Scope) -> str:
    if word.result in (BOOL, INT):
        return word.result
    if word.name.startswith(("filter_", "set", "union", "intersect")) and arguments and arguments[0] is not None:
        kind = kind_of(arguments[0], scope)
        return ITEMS if kind == BOX else kind
    if word.group == "related items":
        return ITEMS
    if word.name in ("unique", "min") and arguments[0] is not None:
        return _ELEMENTS.get(kind_of(arguments[0], scope), OTHER)
    return OTHER


def may_raise(node: Node, scope: Scope) -> bool:
    """Whether evaluating the node might raise an error on some scene, as far as can be told."""
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
            inner = {**scope, function.parameter: _element(first, scope)}
            return may_raise(first, scope) or may_raise(function.body, inner)
        case _:
            return any(may_raise(child, scope) for child in children(node))


def _body_kind(node: Call, scope: Scope) -> str:
    """What the function that is the second argument gives for the elements of the first."""
    collection, function = node.arguments[0], node.arguments[1]
    assert isinstance(function, Lambda)
    return kind_of(function.body, {**scope, function.parameter: _element(collection, scope)})


def _element(collection: Node | None, scope: Scope) -> str:
    """What the collection holds."""
    return OTHER if collection is None else _ELEMENTS.get(kind_of(collection, scope), OTHER)


def _is_member(node: Node, scope: Scope) -> bool:
    """Whether it reads an item's colour, shape or size."""
    return isinstance(node, Member) and node.name in _MEMBER_TYPES and kind_of(node.of, scope) == ITEM


def _all_of(nodes: Sequence[Node | None], kind: str, scope: Scope) -> bool:
    return all(node is not None and kind_of(node, scope) == kind for node in nodes)


def _given(node: Node | None) -> Node:
    assert node is not None
    return node


def _call(name: str, *arguments: Node | None) -> Call:
    word = WORDS[name]
    rest: tuple[None, ...] = (None,) * (len(word.parameters) - len(arguments))
    return Call(word, (*arguments, *rest))


def _is_look(value: object) -> bool:
    return isinstance(value, Enum) and value in LOOK_TESTS


def _look_test(value: object, item: Node) -> Call:
    assert isinstance(value, Enum)
    return _call(LOOK_TESTS[value], item)


# Names of variables


def _with_parts(node: Node, changed: Callable[[Node], Node]) -> Node:
    """The node with `changed` of each of its parts; calls and lambdas, whose parts differ in kind, as they are."""
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
    """The node with its variables named by how many lambdas are around theirs."""

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
            return _with_parts(node, inner)
