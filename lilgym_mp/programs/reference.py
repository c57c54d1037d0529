"""The reference evaluator: a closure-compiling interpreter that defines the semantics of programs.

Each step is charged to the evaluation budget before it runs. A value's size, nested elements included, is charged
before the value is copied, hashed, compared or sorted, so the cost of any program is bounded however it nests.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any, cast

from lilgym_mp.programs import costs, syntax
from lilgym_mp.programs.errors import ProgramRuntimeError, StepLimitError
from lilgym_mp.programs.values import BoxView, Color, ItemView, SceneView, Shape, Side, Size
from lilgym_mp.programs.words import FunctionValue, Word, describe
from lilgym_mp.scene import Scene
from lilgym_mp.scene.arrays import AnyDict

_SETS = (set, frozenset)
_CONTAINERS = frozenset({list, tuple, *_SETS})
_SCALARS = frozenset({ItemView, bool, int, Color, Shape, Size, Side, FunctionValue})


class Evaluation:
    """State of one evaluation: the scene and the remaining budget."""

    __slots__ = ("call_depth", "held", "item_count", "lambdas", "step_limit", "steps_left", "view", "words")

    def __init__(self, scene: Scene, step_limit: int | None = None) -> None:
        self.view = SceneView(scene)
        self.item_count = sum(len(box.items) for box in scene.boxes)
        self.step_limit = costs.STEP_LIMIT if step_limit is None else step_limit
        self.steps_left = self.step_limit
        self.held = 0  # elements, at all levels, of operands waiting for other operands
        self.call_depth = 0
        self.lambdas = 0  # created so far
        self.words: dict[str, FunctionValue] = {}  # words used as values

    def charge(self, steps: int) -> None:
        """Spends steps. Raises StepLimitError below zero."""
        self.steps_left -= steps
        if self.steps_left < 0:
            raise StepLimitError(f"the program needs more than {self.step_limit} steps on this scene")

    def measure(self, value: Any) -> int:
        """The number of elements of a value at all levels, itself included. Charges for one traversal."""
        if type(value) in _CONTAINERS:
            return self._measure(value, 1)
        return 1 + len(value) if isinstance(value, BoxView) else 1

    def _measure(self, value: Any, level: int) -> int:
        size = len(value)
        if size > costs.SIZE_LIMIT:
            raise ProgramRuntimeError(f"{describe(value)} elements; at most {costs.SIZE_LIMIT} are allowed")
        if level > costs.NESTING_LIMIT:
            raise ProgramRuntimeError(f"collections are nested more than {costs.NESTING_LIMIT} deep")
        self.charge(1 + size)
        count = 1 + size
        if not _CONTAINERS.isdisjoint(map(type, value)):
            count += sum([self._measure(part, level + 1) - 1 for part in value if type(part) in _CONTAINERS])
        if isinstance(value, _SETS):
            self.charge(costs.sort_steps(count, size))
        return count

    def hold(self, count: int) -> None:
        """Adds to the held elements. Raises ProgramRuntimeError beyond HELD_LIMIT."""
        self.held += count
        if self.held > costs.HELD_LIMIT:
            raise ProgramRuntimeError(f"the program holds more than {costs.HELD_LIMIT} elements at once")

    def operands(self, closures: Sequence[Closure], variables: Variables) -> tuple[list[Any], int]:
        """Evaluates the closures; returns their values and total element count, which the caller must release from
        `held`."""
        values: list[Any] = []
        total = 0
        for closure in closures:
            value = closure(self, variables)
            values.append(value)
            if type(value) in _SCALARS:  # the common case, without the cost of calling `hold`
                total += 1
                self.held += 1
                continue
            count = self.measure(value)
            self.hold(count)
            total += count
        return values, total

    def call_word(self, word: Word, args: Sequence[Any], element_count: int) -> Any:
        """Calls a word whose arguments have `element_count` elements at all levels."""
        self.charge(word.steps(element_count, self.item_count))
        if word.result_size is None:
            return word(*args)
        size = word.result_size(*word.coerce(tuple(args)))
        if size.subsets > costs.SIZE_LIMIT:
            raise ProgramRuntimeError(f"{word.name}: the result has more than {costs.SIZE_LIMIT} elements")
        created = size.element_count(element_count)
        self.hold(created)
        self.charge(costs.SUBSET_ELEMENT * created)
        self.held -= created
        return word(*args)

    def enter(self, steps: int) -> None:
        """Charges for a function call and increments `call_depth`."""
        self.charge(steps)
        self.call_depth += 1
        if self.call_depth > costs.CALL_LIMIT:
            raise ProgramRuntimeError(f"functions call each other more than {costs.CALL_LIMIT} deep")


Variables = AnyDict
Closure = Callable[[Evaluation, Variables], Any]


def build_closure(node: syntax.Node) -> Closure:
    """Compiles a node to a closure from the evaluation state and the enclosing variables to the node's value."""
    match node:
        case syntax.Constant(value=value):
            return lambda evaluation, variables: value
        case syntax.SceneName(name="all_boxes"):
            return lambda evaluation, variables: list(evaluation.view.boxes)
        case syntax.SceneName():
            return _all_items
        case syntax.Variable(name=name):
            return lambda evaluation, variables: variables[name]
        case syntax.WordName(word=word):
            return lambda evaluation, variables: _word_value(evaluation, word)
        case syntax.Lambda():
            return _lambda(node)
        case syntax.Call():
            return _call(node)
        case syntax.Member():
            return _member(node)
        case syntax.Logic():
            return _logic(node)
        case syntax.Not(operand=operand):
            closure = build_closure(operand)
            return lambda evaluation, variables: not closure(evaluation, variables)
        case syntax.Comparison():
            return _comparison(node)
        case syntax.Arithmetic():
            return _arithmetic(node)
        case syntax.Subscript() | syntax.Slice():
            return _subscript(node)
        case syntax.Display():
            return _display(node)


def evaluate(closure: Closure, evaluation: Evaluation) -> bool:
    """The value of a whole program. Raises ProgramRuntimeError if there is none or it is not a bool."""
    try:
        value = closure(evaluation, {})
    except RecursionError:
        raise ProgramRuntimeError("the program is too deeply nested to be evaluated here") from None
    if type(value) is not bool:
        raise ProgramRuntimeError(f"a program must return a bool, not {describe(value)}")
    return value


def _all_items(evaluation: Evaluation, variables: Variables) -> Any:
    evaluation.charge(evaluation.item_count)
    return evaluation.view.items()


def _word_value(evaluation: Evaluation, word: Word) -> FunctionValue:
    """A word used as a value, e.g. as the second argument of filter_obj; one object per evaluation."""

    def call(value: Any) -> Any:
        evaluation.enter(costs.LAMBDA)
        result = evaluation.call_word(word, (value,), evaluation.measure(value))
        evaluation.call_depth -= 1
        evaluation.measure(result)
        return result

    found = evaluation.words.get(word.name)
    if found is None:
        found = evaluation.words[word.name] = FunctionValue(call, (word.name,))
    return found


def _lambda(node: syntax.Lambda) -> Closure:
    parameter = node.parameter
    body = build_closure(node.body)
    steps = costs.LAMBDA + costs.NODE * syntax.own_size(node.body)

    def closure(evaluation: Evaluation, variables: Variables) -> Any:
        def call(value: Any) -> Any:
            evaluation.enter(steps)
            result = body(evaluation, {**variables, parameter: value})
            evaluation.call_depth -= 1
            evaluation.measure(result)
            return result

        evaluation.lambdas += 1
        return FunctionValue(call, ("", evaluation.lambdas))

    return closure


def _call(node: syntax.Call) -> Closure:
    word = node.word
    closures = [None if argument is None else build_closure(argument) for argument in node.arguments]
    defaults = [parameter.default for parameter in word.parameters]
    passed = len(closures)  # trailing defaults are left to the word
    while passed and closures[passed - 1] is None:
        passed -= 1
    operands = [
        _constant(default) if closure is None else closure
        for closure, default in zip(closures[:passed], defaults, strict=False)
    ]

    def call(evaluation: Evaluation, variables: Variables) -> Any:
        args, count = evaluation.operands(operands, variables)
        value = evaluation.call_word(word, args, count)
        evaluation.held -= count
        return value

    return call


def _constant(value: Any) -> Closure:
    return lambda evaluation, variables: value


def _member(node: syntax.Member) -> Closure:
    of = build_closure(node.of)
    name = node.name
    owner, owner_name = (BoxView, "a box") if name in syntax.METHODS else (ItemView, "an item")

    def read(evaluation: Evaluation, variables: Variables) -> Any:
        value = of(evaluation, variables)
        if type(value) is not owner:
            raise ProgramRuntimeError(f".{name}: only {owner_name} has it, not {describe(value)}")
        return getattr(value, name)

    def call(evaluation: Evaluation, variables: Variables) -> Any:
        evaluation.charge(1 + evaluation.item_count)
        return read(evaluation, variables)()

    return call if node.called else read


def _logic(node: syntax.Logic) -> Closure:
    closures = [build_closure(operand) for operand in node.operands]
    stop_at = node.operator == "or"

    def closure(evaluation: Evaluation, variables: Variables) -> Any:
        value: Any = None
        for operand in closures:
            value = operand(evaluation, variables)
            if bool(value) is stop_at:
                break
        return value

    return closure


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


def _comparison(node: syntax.Comparison) -> Closure:
    left_closure = build_closure(node.left)
    steps = [(name, build_closure(right)) for name, right in zip(node.operators, node.rights, strict=True)]

    def closure(evaluation: Evaluation, variables: Variables) -> Any:
        (left,), left_count = evaluation.operands((left_closure,), variables)
        truth = True
        for name, right_closure in steps:
            (right,), right_count = evaluation.operands((right_closure,), variables)
            truth = _operate(evaluation, name, _COMPARISONS[name], left, right, left_count + right_count)
            evaluation.held -= left_count
            left = right
            left_count = right_count
            if not truth:
                break
        evaluation.held -= left_count
        return truth

    return closure


def _operate(
    evaluation: Evaluation, name: str, operation: Callable[[Any, Any], Any], left: Any, right: Any, count: int
) -> Any:
    evaluation.charge(costs.OPERATION + count)
    try:
        return operation(left, right)
    except TypeError:
        raise ProgramRuntimeError(f"{name}: cannot be used with {describe(left)} and {describe(right)}") from None
    except ZeroDivisionError:
        raise ProgramRuntimeError(f"{name}: the right side is 0") from None


def _arithmetic(node: syntax.Arithmetic) -> Closure:
    closures = (build_closure(node.left), build_closure(node.right))
    name = node.operator
    operation = {"+": operator.add, "%": operator.mod}[node.operator]

    def closure(evaluation: Evaluation, variables: Variables) -> Any:
        (left, right), count = evaluation.operands(closures, variables)
        value = _operate(evaluation, name, operation, left, right, count)
        evaluation.held -= count
        return value

    return closure


def _subscript(node: syntax.Subscript | syntax.Slice) -> Closure:
    of = build_closure(node.of)
    if isinstance(node, syntax.Subscript):
        parts = [build_closure(node.index)]
    else:
        parts = [part and build_closure(part) for part in (node.start, node.stop, node.step)]

    def closure(evaluation: Evaluation, variables: Variables) -> Any:
        (value,), count = evaluation.operands((of,), variables)
        indices = [part and part(evaluation, variables) for part in parts]
        evaluation.held -= count
        if type(value) is BoxView:
            value = value.all_items_in_box()
        if not isinstance(value, list | tuple):
            raise ProgramRuntimeError(f"[ ]: only a list can be indexed, not {describe(value)}")
        for index in indices:
            if index is not None and type(index) is not int:
                raise ProgramRuntimeError(f"[ ]: an index must be an int, not {describe(index)}")
        sequence = cast("list[Any]", value)
        evaluation.charge(costs.OPERATION + len(sequence))
        if isinstance(node, syntax.Slice):
            if indices[2] == 0:
                raise ProgramRuntimeError("[ ]: the step of a slice cannot be 0")
            return sequence[slice(*indices)]
        index = cast("int", indices[0])
        if index >= len(sequence):
            raise ProgramRuntimeError(f"[{index}]: out of range for {describe(sequence)}")
        return sequence[index]

    return closure


def _display(node: syntax.Display) -> Closure:
    closures = [build_closure(element) for element in node.elements]
    kind = node.kind

    def closure(evaluation: Evaluation, variables: Variables) -> Any:
        values, count = evaluation.operands(closures, variables)
        evaluation.charge(costs.OPERATION + count)
        evaluation.held -= count
        try:
            return kind(values)
        except TypeError:
            raise ProgramRuntimeError("{ }: a list or a set cannot be an element of a set") from None

    return closure
