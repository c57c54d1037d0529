"""The reference form of a program: closures over readable words. It defines what a program means.

Every step is charged to a budget before it is taken, and every value is counted, elements of elements included, before
it is copied, hashed, compared or brought into order, so that no program, whatever it nests, works without bound.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any, cast

from lilgym_mp.programs import costs
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
    own_size,
)
from lilgym_mp.programs.views import BoxView, Color, ItemView, SceneView, Shape, Side, Size
from lilgym_mp.programs.words import FunctionValue, Word, described
from lilgym_mp.scene import Scene

_SETS = (set, frozenset)
_HOLDERS = frozenset({list, tuple, *_SETS})  # types of what is counted as more than one element within another
_SINGLE = frozenset({ItemView, bool, int, Color, Shape, Size, Side, FunctionValue})


class Run:
    """One evaluation: the scene, how much work is left, and how much is held."""

    __slots__ = ("calls", "held", "item_count", "lambdas", "steps_left", "view", "words")

    def __init__(self, scene: Scene) -> None:
        self.view = SceneView(scene)
        self.item_count = sum(len(box.items) for box in scene.boxes)
        self.steps_left = costs.STEP_LIMIT
        self.held = 0  # elements, at all levels, of values that wait for others
        self.calls = 0  # of functions, within each other
        self.lambdas = 0  # made so far
        self.words: dict[str, FunctionValue] = {}  # that are used as values

    def charge(self, steps: int) -> None:
        self.steps_left -= steps
        if self.steps_left < 0:
            raise ProgramRuntimeError(f"the program needs more than {costs.STEP_LIMIT} steps on this scene")

    def weighed(self, value: Any) -> int:
        """The elements of a value at all levels, itself included. Charges for going through it once."""
        if type(value) in _HOLDERS:
            return self._weighed(value, 1)
        return 1 + len(value) if isinstance(value, BoxView) else 1

    def _weighed(self, value: Any, level: int) -> int:
        size = len(value)
        if size > costs.SIZE_LIMIT:
            raise ProgramRuntimeError(f"{described(value)} elements; there may be {costs.SIZE_LIMIT}")
        if level > costs.NESTING_LIMIT:
            raise ProgramRuntimeError(f"collections are nested more than {costs.NESTING_LIMIT} deep")
        self.charge(1 + size)
        weight = 1 + size
        if not _HOLDERS.isdisjoint(map(type, value)):
            weight += sum([self._weighed(part, level + 1) - 1 for part in value if type(part) in _HOLDERS])
        if isinstance(value, _SETS):
            self.charge(costs.sorting(weight, size))
        return weight

    def hold(self, weight: int) -> None:
        """Counts elements as held. Raises ProgramRuntimeError when they are too many."""
        self.held += weight
        if self.held > costs.HELD_LIMIT:
            raise ProgramRuntimeError(f"the program holds more than {costs.HELD_LIMIT} elements at once")

    def operands(self, forms: Sequence[Form], variables: Variables) -> tuple[list[Any], int]:
        """The values of some forms, and their elements, which are held until they are let go of."""
        values: list[Any] = []
        weight = 0
        for form in forms:
            value = form(self, variables)
            values.append(value)
            if type(value) in _SINGLE:  # most are: `hold` takes a call
                weight += 1
                self.held += 1
                continue
            elements = self.weighed(value)
            self.hold(elements)
            weight += elements
        return values, weight

    def called(self, word: Word, args: Sequence[Any], weight: int) -> Any:
        """The value of a call of a word, whose arguments have so many elements."""
        self.charge(word.steps(weight, self.item_count))
        if word.growth is None:
            return word(*args)
        growth = word.growth(*word.taken(tuple(args)))
        if growth.elements > costs.SIZE_LIMIT:
            raise ProgramRuntimeError(f"{word.name}: the result has more than {costs.SIZE_LIMIT} elements")
        made = growth.weight(weight)
        self.hold(made)
        self.charge(costs.MADE * made)
        self.held -= made
        return word(*args)

    def enter(self, steps: int) -> None:
        """Charges a call of a function, which `calls` counts as open."""
        self.charge(steps)
        self.calls += 1
        if self.calls > costs.CALL_LIMIT:
            raise ProgramRuntimeError(f"functions call each other more than {costs.CALL_LIMIT} deep")


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
            return _all_items
        case Variable(name=name):
            return lambda run, variables: variables[name]
        case WordName(word=word):
            return lambda run, variables: _word_value(run, word)
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
    return evaluate_counted(form, scene)[0]


def evaluate_counted(form: Form, scene: Scene) -> tuple[bool, int]:
    """`evaluate`, and the steps that it took."""
    run = Run(scene)
    try:
        value = form(run, {})
    except RecursionError:
        raise ProgramRuntimeError("the program is too deeply nested to be run here") from None
    if type(value) is not bool:
        raise ProgramRuntimeError(f"a program gives a bool, not {described(value)}")
    return value, costs.STEP_LIMIT - run.steps_left


def _all_items(run: Run, variables: Variables) -> Any:
    run.charge(run.item_count)
    return run.view.items()


def _word_value(run: Run, word: Word) -> FunctionValue:
    """The word as a value, such as the second argument of filter_obj; the same one throughout a run."""

    def call(value: Any) -> Any:
        run.enter(costs.LAMBDA)
        result = run.called(word, (value,), run.weighed(value))
        run.calls -= 1
        run.weighed(result)
        return result

    found = run.words.get(word.name)
    if found is None:
        found = run.words[word.name] = FunctionValue(call, (word.name,))
    return found


def _lambda(node: Lambda) -> Form:
    parameter, body = node.parameter, reference_form(node.body)
    steps = costs.LAMBDA + costs.NODE * own_size(node.body)

    def form(run: Run, variables: Variables) -> Any:
        def call(value: Any) -> Any:
            run.enter(steps)
            result = body(run, {**variables, parameter: value})
            run.calls -= 1
            run.weighed(result)
            return result

        run.lambdas += 1
        return FunctionValue(call, ("", run.lambdas))

    return form


def _call(node: Call) -> Form:
    word = node.word
    forms = [None if argument is None else reference_form(argument) for argument in node.arguments]
    defaults = [parameter.default for parameter in word.parameters]
    given = len(forms)
    while given and forms[given - 1] is None:
        given -= 1
    given_forms = [
        _constant(default) if form is None else form for form, default in zip(forms[:given], defaults, strict=False)
    ]

    def call(run: Run, variables: Variables) -> Any:
        args, weight = run.operands(given_forms, variables)
        value = run.called(word, args, weight)
        run.held -= weight
        return value

    return call


def _constant(value: Any) -> Form:
    return lambda run, variables: value


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
        (left,), left_weight = run.operands((left_form,), variables)
        truth = True
        for name, right_form in steps:
            (right,), right_weight = run.operands((right_form,), variables)
            truth = _operate(run, name, _COMPARISONS[name], left, right, left_weight + right_weight)
            run.held -= left_weight
            left, left_weight = right, right_weight
            if not truth:
                break
        run.held -= left_weight
        return truth

    return form


def _operate(run: Run, name: str, operation: Callable[[Any, Any], Any], left: Any, right: Any, weight: int) -> Any:
    run.charge(costs.OPERATION + weight)
    try:
        return operation(left, right)
    except TypeError:
        raise ProgramRuntimeError(f"{name}: cannot be used with {described(left)} and {described(right)}") from None
    except ZeroDivisionError:
        raise ProgramRuntimeError(f"{name}: the right side is 0") from None


def _arithmetic(node: Arithmetic) -> Form:
    forms = reference_form(node.left), reference_form(node.right)
    name, operation = node.operator, {"+": operator.add, "%": operator.mod}[node.operator]

    def form(run: Run, variables: Variables) -> Any:
        (left, right), weight = run.operands(forms, variables)
        value = _operate(run, name, operation, left, right, weight)
        run.held -= weight
        return value

    return form


def _subscript(node: Subscript | Slice) -> Form:
    of = reference_form(node.of)
    if isinstance(node, Subscript):
        parts = [reference_form(node.index)]
    else:
        parts = [part and reference_form(part) for part in (node.start, node.stop, node.step)]

    def form(run: Run, variables: Variables) -> Any:
        (value,), weight = run.operands((of,), variables)
        numbers = [part and part(run, variables) for part in parts]
        run.held -= weight
        if type(value) is BoxView:
            value = value.all_items_in_box()
        if not isinstance(value, list | tuple):
            raise ProgramRuntimeError(f"[ ]: only a list has positions, not {described(value)}")
        for number in numbers:
            if number is not None and type(number) is not int:
                raise ProgramRuntimeError(f"[ ]: a position is a number, not {described(number)}")
        held = cast("list[Any]", value)
        run.charge(costs.OPERATION + len(held))
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
        values, weight = run.operands(forms, variables)
        run.charge(costs.OPERATION + weight)
        run.held -= weight
        try:
            return kind(values)
        except TypeError:
            raise ProgramRuntimeError("{ }: a list or a set cannot be an element of a set") from None

    return form
