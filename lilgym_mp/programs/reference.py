"""The reference form of a program: closures over readable words. It defines what a program means.

Every step is charged to a budget, so that no program, whatever it nests, works without bound.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, cast

from lilgym_mp.programs.errors import ProgramRuntimeError
from lilgym_mp.programs.syntax import (
    METHODS,
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
)
from lilgym_mp.programs.views import BoxView, ItemView, SceneView
from lilgym_mp.programs.words import Word, described, elements, is_collection
from lilgym_mp.scene import Scene

STEP_LIMIT = 10_000_000  # elements looked at in one evaluation; official programs need some thousands
SIZE_LIMIT = 100_000  # elements of one collection


class Run:
    """One evaluation: the scene, and how much work is left."""

    __slots__ = ("item_count", "steps_left", "view")

    def __init__(self, scene: Scene) -> None:
        self.view = SceneView(scene)
        self.item_count = sum(len(box.items) for box in scene.boxes)
        self.steps_left = STEP_LIMIT

    def charge(self, steps: int) -> None:
        self.steps_left -= steps
        if self.steps_left < 0:
            raise ProgramRuntimeError(f"the program needs more than {STEP_LIMIT} steps on this scene")

    def charge_call(self, word: Word, args: tuple[Any, ...]) -> None:
        self.charge(word.steps(map(_size, args), self.item_count))
        if word.size is not None:
            size = word.size(*word.taken(args))
            if size > SIZE_LIMIT:
                raise ProgramRuntimeError(f"{word.name}: the result has more than {SIZE_LIMIT} elements")
            self.charge(size)


Variables = dict[str, Any]
Form = Callable[[Run, Variables], Any]


def reference_form(node: Node) -> Form:
    """The closure that gives the node's value, from a run and the values of the variables around it."""
    match node:
        case Constant(value=value):
            return lambda run, variables: value
        case SceneName(name="all_boxes"):
            return lambda run, variables: list(run.view.boxes)
        case SceneName():
            return lambda run, variables: run.view.items()
        case Variable(name=name):
            return lambda run, variables: variables[name]
        case WordName(word=word):
            return lambda run, variables: _charged(run, word)
        case Lambda():
            return _lambda(node)
        case Call():
            return _call(node)
        case Member():
            return _member(node)
        case Logic():
            return _logic(node)
        case Not(operand=operand):
            form = reference_form(operand)
            return lambda run, variables: not form(run, variables)
        case Comparison():
            return _comparison(node)
        case Arithmetic():
            return _arithmetic(node)
        case Subscript() | Slice():
            return _subscript(node)
        case Display():
            return _display(node)


def evaluate(form: Form, scene: Scene) -> bool:
    """The value of a whole program on a scene.

    Raises ProgramRuntimeError, also for a value that is not a bool.
    """
    try:
        value = form(Run(scene), {})
    except RecursionError:
        raise ProgramRuntimeError("the program is too deeply nested to be run here") from None
    if type(value) is not bool:
        raise ProgramRuntimeError(f"a program gives a bool, not {described(value)}")
    return value


def _charged(run: Run, word: Word) -> Any:
    """The word as a value, such as the second argument of filter_obj."""

    def call(value: Any) -> Any:
        run.charge_call(word, (value,))
        return word(value)

    return call


def _lambda(node: Lambda) -> Form:
    parameter, body = node.parameter, reference_form(node.body)

    def form(run: Run, variables: Variables) -> Any:
        def call(value: Any) -> Any:
            run.charge(1)
            return body(run, {**variables, parameter: value})

        return call

    return form


def _call(node: Call) -> Form:
    word = node.word
    forms = [None if argument is None else reference_form(argument) for argument in node.arguments]
    defaults = [parameter.default for parameter in word.parameters]
    given = len(forms)
    while given and forms[given - 1] is None:
        given -= 1
    pairs = list(zip(forms[:given], defaults, strict=False))

    def call(run: Run, variables: Variables) -> Any:
        args = tuple(default if form is None else form(run, variables) for form, default in pairs)
        run.charge_call(word, args)
        return word(*args)

    return call


def _member(node: Member) -> Form:
    of, name = reference_form(node.of), node.name
    owner, owner_name = (BoxView, "a box") if name in METHODS else (ItemView, "an item")

    def read(run: Run, variables: Variables) -> Any:
        value = of(run, variables)
        if type(value) is not owner:
            raise ProgramRuntimeError(f".{name}: only {owner_name} has it, not {described(value)}")
        return getattr(value, name)

    def call(run: Run, variables: Variables) -> Any:
        run.charge(1 + run.item_count)
        return read(run, variables)()

    return call if node.called else read


def _logic(node: Logic) -> Form:
    forms = [reference_form(operand) for operand in node.operands]
    stop_at = node.operator == "or"

    def form(run: Run, variables: Variables) -> Any:
        value: Any = None
        for operand in forms:
            value = operand(run, variables)
            if bool(value) is stop_at:
                break
        return value

    return form


_COMPARISONS: dict[str, Callable[[Any, Any], Any]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "in": lambda value, collection: value in collection,
    "not in": lambda value, collection: value not in collection,
}


def _comparison(node: Comparison) -> Form:
    left_form = reference_form(node.left)
    steps = [(name, reference_form(right)) for name, right in zip(node.operators, node.rights, strict=True)]

    def form(run: Run, variables: Variables) -> Any:
        left = left_form(run, variables)
        truth = True
        for name, right_form in steps:
            right = right_form(run, variables)
            truth = _operate(run, name, _COMPARISONS[name], left, right)
            if not truth:
                break
            left = right
        return truth

    return form


def _operate(run: Run, name: str, operation: Callable[[Any, Any], Any], left: Any, right: Any) -> Any:
    run.charge(1 + _size(left) + _size(right))
    try:
        return operation(left, right)
    except TypeError:
        raise ProgramRuntimeError(f"{name}: cannot be used with {described(left)} and {described(right)}") from None
    except ZeroDivisionError:
        raise ProgramRuntimeError(f"{name}: the right side is 0") from None


def _arithmetic(node: Arithmetic) -> Form:
    left_form, right_form = reference_form(node.left), reference_form(node.right)
    name, operation = node.operator, {"+": operator.add, "%": operator.mod}[node.operator]

    def form(run: Run, variables: Variables) -> Any:
        left, right = left_form(run, variables), right_form(run, variables)
        if _size(left) + _size(right) > SIZE_LIMIT:
            raise ProgramRuntimeError(f"{name}: the result has more than {SIZE_LIMIT} elements")
        return _operate(run, name, operation, left, right)

    return form


def _subscript(node: Subscript | Slice) -> Form:
    of = reference_form(node.of)
    if isinstance(node, Subscript):
        parts = [reference_form(node.index)]
    else:
        parts = [part and reference_form(part) for part in (node.start, node.stop, node.step)]

    def form(run: Run, variables: Variables) -> Any:
        value = of(run, variables)
        numbers = [part and part(run, variables) for part in parts]
        if not isinstance(value, list | tuple):
            raise ProgramRuntimeError(f"[ ]: only a list has positions, not {described(value)}")
        for number in numbers:
            if number is not None and type(number) is not int:
                raise ProgramRuntimeError(f"[ ]: a position is a number, not {described(number)}")
        held = cast("list[Any]", value)
        run.charge(1 + len(held))
        if isinstance(node, Slice):
            if numbers[2] == 0:
                raise ProgramRuntimeError("[ ]: the step of a slice is not 0")
            return held[slice(*numbers)]
        index = cast("int", numbers[0])
        if index >= len(held):
            raise ProgramRuntimeError(f"[{index}]: out of range for {described(held)}")
        return held[index]

    return form


def _display(node: Display) -> Form:
    forms = [reference_form(element) for element in node.elements]
    kind = node.kind

    def form(run: Run, variables: Variables) -> Any:
        values = [element(run, variables) for element in forms]
        try:
            return kind(values)
        except TypeError:
            raise ProgramRuntimeError("{ }: a list or a set cannot be an element of a set") from None

    return form


def _size(value: Any) -> int:
    return len(elements(value)) if is_collection(value) else 1
