"""The fast form of a program: Python source over bit masks, generated from the checked tree.

A collection of items in scene order is a mask for each box that may hold some; a test of one item is a mask;
boxes are unrolled. The part of a program that speaks of one box only (most of a program, mostly) becomes a
function of its own, a *kernel*, whose value is kept in `box.memo`: after a step of play only the box that
changed is looked at again.

The fast form gives the reference form's value or raises FallbackError, and raises it wherever the reference
form would fail (and sometimes where it would not). What is not covered here raises Unsupported at compile time.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, NamedTuple, cast
from weakref import WeakValueDictionary

from lilgym_mp.programs import box_functions, costs
from lilgym_mp.programs.ir import (
    ATTRIBUTE_TYPES,
    BOXES,
    ITEM_FIELDS,
    LOCAL_BOX,
    MOST_ITEMS,
    Attribute,
    AttributeList,
    Attributes,
    Choices,
    Code,
    ItemMask,
    Items,
    Number,
    OneBox,
    OneItem,
    Part,
    Scope,
    Static,
    TheOnly,
    Truth,
    Unsupported,
    all_total,
    as_collection,
    as_truth,
    each_value,
    equality,
    existence,
    most_elements,
    narrowed,
    negated,
    steps_to_weigh,
    text_length,
    uncovered,
)
from lilgym_mp.programs.runtime import NAMES
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
    Subscript,
    Variable,
    WordName,
    children,
    own_size,
)
from lilgym_mp.programs.values import Color, Shape, Side, Size
from lilgym_mp.programs.word_lowering import ATTRIBUTE_WORDS, BINARY_WORDS, VALUE_WORDS
from lilgym_mp.programs.words import Word
from lilgym_mp.scene import BOX_COUNT, Box, Scene

MAX_TEXT = 20_000  # characters of generated source
MAX_ALL_TEXT = 2_000_000  # characters of all parts of it, whose texts hold each other's
MAX_NODES = 5_000  # nodes generated for one program


class Expression(NamedTuple):
    """A generated expression of the boxes b0, b1, b2 or, a kernel's, of the box b."""

    text: str
    hoisted: Mapping[str, str]  # by name: the expression that it stands for
    names: dict[str, Any]  # functions of a box, by the names that the expressions call them by

    def lines(self, indent: str) -> str:
        return "".join(f"{indent}{name} = {text}\n" for name, text in self.hoisted.items())


def generate_expression(tree: Node) -> Expression | None:
    """A program's truth as an expression, None where there is none."""
    try:
        generator = _Generator(_Work(), kernel=False)
        value = generator.code(tree, {})
        return generator.expression(value.text) if isinstance(value, Truth) else None
    except (Unsupported, RecursionError, MemoryError, SyntaxError):
        return None


def generate_function(tree: Node) -> Callable[[Scene], bool] | None:
    """The fast form of a program, None where it has none. It raises FallbackError when it cannot tell."""
    expression = generate_expression(tree)
    try:
        return expression and _compiled(_scene_source(expression), expression.names, "truth")
    except (Unsupported, RecursionError, MemoryError, SyntaxError):
        return None


def _scene_source(expression: Expression) -> str:
    text = expression.text
    if " for " not in text:
        text = re.sub(r"(kernel\d+)\((b\d)\)", r"(v if (v := \2.memo.get(\1_key)) is not None else \1(\2))", text)
    boxes = ", ".join(BOXES)
    return f"def truth(scene):\n    {boxes} = scene.boxes\n{expression.lines('    ')}    return bool({text})\n"


def _shared_kernel(expression: Expression) -> Kernel:
    """The kernel with that expression; programs share it."""
    lines = expression.lines("        ")
    key = f"program kernel {lines}{expression.text}"
    kernel = _KERNELS.get(key)
    if kernel is None:
        source = (
            f"def kernel({LOCAL_BOX}):\n    value = {LOCAL_BOX}.memo.get(key)\n    if value is None:\n"
            f"        check_size({LOCAL_BOX})\n{lines}"
            f"        value = {LOCAL_BOX}.memo[key] = {expression.text}\n    return value\n"
        )
        expression.names["key"] = key
        kernel = _KERNELS[key] = Kernel(key, _compiled(source, expression.names, "kernel"), expression)
    return kernel


def _compiled(source: str, names: dict[str, Any], name: str) -> Callable[[Any], Any]:
    """The function that generated source defines. The source holds no text of the program's author."""
    if len(source) > MAX_TEXT:
        uncovered("too long")
    exec(compile(source, f"<{name} of a program>", "exec"), names)
    return names[name]


class _Traits(NamedTuple):
    """What a node says, whatever is around it."""

    node: Node  # kept, so that no other node takes its identity
    uses_scene: bool  # speaks of more than the values of its variables
    free: frozenset[str]  # variables that it takes from around it
    size: int  # `own_size`


class _Work:
    """What one program costs: nodes and text generated, and a bound on the steps its reference form is charged.

    A program that might exceed STEP_LIMIT on boxes of MAX_BOX_ITEMS has no fast form: it would not fail there.
    """

    def __init__(self) -> None:
        self.nodes_left = MAX_NODES
        self.text_left = MAX_ALL_TEXT
        self.steps_left = costs.STEP_LIMIT
        self.kernels: dict[tuple[str, int, object], tuple[str, bool, int]] = {}
        self._traits: dict[int, _Traits] = {}

    def traits(self, node: Node) -> _Traits:
        known = self._traits.get(id(node))
        if known is None:
            parts = [self.traits(child) for child in children(node)]
            uses_scene = isinstance(node, SceneName) or (
                isinstance(node, Call | WordName) and node.word.depends_on == "scene"
            )
            free = frozenset({node.name}) if isinstance(node, Variable) else frozenset[str]()
            free = free.union(*(part.free for part in parts))
            if isinstance(node, Lambda):
                free -= {node.parameter}
            whole = uses_scene or any(part.uses_scene for part in parts)
            known = self._traits[id(node)] = _Traits(node, whole, free, own_size(node))
        return known


class _Generator:
    """Writes one generated function: of a scene's boxes b0, b1, b2, or, a kernel, of one box b."""

    def __init__(self, work: _Work, *, kernel: bool) -> None:
        self.work = work
        self.kernel = kernel
        self.names: dict[str, Any] = dict(NAMES)
        self.hoisted: dict[str, str] = {}
        self.times: int = 1  # how often, at most, what is generated now is evaluated
        self.loops = 0
        self.count = 0

    def charge(self, steps: int) -> None:
        self.work.nodes_left -= 1
        self.work.steps_left -= self.times * steps
        if self.work.nodes_left < 0 or self.work.steps_left < 0:
            uncovered("too much work")

    def charge_call(self, word: Word, *values: Code) -> None:
        weighing = sum(map(steps_to_weigh, values))
        self.charge(weighing + word.steps(sum(map(most_elements, values)), MOST_ITEMS))

    def charge_function(self, body: Node, calls: int = 1) -> None:
        """Charges calls of a lambda."""
        self.charge(calls * (costs.LAMBDA + costs.NODE * self.work.traits(body).size))

    def charge_values(self, *values: Code) -> None:
        """Charges an operator."""
        self.charge(costs.OPERATION + sum(map(steps_to_weigh, values)) + sum(map(most_elements, values)))

    # Kernels and lifted words

    def in_kernel(
        self, box: str, key: tuple[str, int, object], write: Callable[[_Generator], Truth | Part]
    ) -> tuple[str, bool]:
        """The call, for a box, of the kernel that `write` generates for any box; and whether it is total.

        `key` tells kernels apart: the lambda's parameter and body, and what is made of them.
        """
        known = self.work.kernels.get(key)
        if known is None:
            inner = _Generator(self.work, kernel=True)
            before = self.work.steps_left
            value = write(inner)
            steps, self.work.steps_left = before - self.work.steps_left, before
            text = value.text if isinstance(value, Truth) else value.mask
            kernel = _shared_kernel(inner.expression(text))
            name = f"kernel{len(self.work.kernels)}"
            self.names |= {name: kernel.function, f"{name}_key": kernel.key, f"{name}_kept": kernel}
            known = self.work.kernels[key] = (name, value.total, steps)
        name, total, steps = known
        self.charge(steps)
        return f"{name}({box})", total

    def lifted(self, name: str, function: Any, box: str) -> str:
        """The lifted word for a box; computed before a loop rather than in it."""
        self.names[name] = function
        text = f"{name}({box})"
        if not self.loops:
            return text
        return self.hoisted.setdefault(text, f"{name}_{box}")

    def expression(self, text: str) -> Expression:
        return Expression(text, {name: hoisted for hoisted, name in self.hoisted.items()}, self.names)

    def is_closed(self, parameter: str, body: Node) -> bool:
        traits = self.work.traits(body)
        return not self.kernel and traits.free <= {parameter} and not traits.uses_scene

    # Expressions

    def truth(self, node: Node, scope: Scope) -> Truth:
        """Whether the node's value is true or not empty."""
        match node:
            case Logic(operator=operator, operands=operands):
                truths = [self.truth(operand, scope) for operand in operands]
                return Truth("(" + f" {operator} ".join(t.text for t in truths) + ")", all_total(truths))
            case Member(of=of, name=name, called=False) if name in METHODS:
                owner = self.code(of, scope)
                return Truth("True") if isinstance(owner, OneBox) else uncovered()
            case _:
                value = self.code(node, scope)
                self.charge(steps_to_weigh(value))
                return as_truth(value)

    def strict_truth(self, node: Node, scope: Scope) -> Truth:
        """The value of a node that is known to be a bool."""
        value = self.code(node, scope)
        return value if isinstance(value, Truth) else uncovered("not a bool")

    def code(self, node: Node, scope: Scope) -> Code:
        """Lowers a node. Raises Unsupported when the text gets too long: it can contain a part's text many times."""
        self.charge(0)
        value = self.written(node, scope)
        length = text_length(value, MAX_TEXT)
        self.work.text_left -= length
        if length > MAX_TEXT or self.work.text_left < 0:
            uncovered("too long")
        return value

    def written(self, node: Node, scope: Scope) -> Code:
        match node:
            case Constant(value=bool() as value):
                return Truth(str(value))
            case Constant(value=int() as value):
                return Number(str(value))
            case Constant(value=Color() | Shape() | Size() as value):
                return Attribute(type(value), str(value.value))
            case SceneName(name="all_boxes"):
                return Static(tuple(map(OneBox, BOXES)), (Truth("True"),) * BOX_COUNT)
            case SceneName():
                self.charge(MOST_ITEMS)
                return Items(tuple(Part(box, None) for box in BOXES), ordered=True)
            case Variable(name=name):
                return scope[name]
            case Logic(operands=operands):
                truths = [self.strict_truth(operand, scope) for operand in operands]
                return Truth("(" + f" {node.operator} ".join(t.text for t in truths) + ")", all_total(truths))
            case Not(operand=operand):
                inner = self.truth(operand, scope)
                return Truth(f"(not {inner.text})", inner.total)
            case Comparison():
                return self.comparison(node, scope)
            case Arithmetic():
                return self.arithmetic(node, scope)
            case Subscript(of=of, index=Constant(value=int() as index)):
                held = self.code(of, scope)
                self.charge_values(held)
                if isinstance(held, Static) and held.certain and index < len(held.elements):
                    return held.elements[index]
                uncovered("subscript")
            case Member():
                return self.member(node, scope)
            case Display(kind=kind, elements=elements) if kind is set or kind is list:
                return self.display(kind is set, [self.code(element, scope) for element in elements])
            case Call():
                return self.call(node, scope)
            case _:
                uncovered(type(node).__name__)

    def display(self, is_set: bool, values: list[Code]) -> Code:
        if values and all(isinstance(value, OneBox) for value in values) and not is_set:
            return Static(tuple(values), (Truth("True"),) * len(values))
        self.charge_values(*values)
        kinds = {value.kind for value in values if isinstance(value, Attribute)}
        if len(kinds) != 1 or len(values) > MOST_ITEMS or not all(isinstance(value, Attribute) for value in values):
            uncovered("display")
        texts = [cast("Attribute", value).text for value in values]
        total = all_total(values)
        if not is_set:
            return AttributeList(kinds.pop(), f"[{', '.join(texts)}]", total)
        return Attributes(kinds.pop(), "(" + " | ".join(f"1 << {text}" for text in texts) + ")", total)

    def member(self, node: Member, scope: Scope) -> Code:
        of = self.code(node.of, scope)
        self.charge(1 + MOST_ITEMS)
        if isinstance(of, OneBox) and node.called:
            if node.name == "is_tower":
                return Truth(self.lifted("is_tower", box_functions.is_tower, of.box))
            return Items((Part(of.box, None),), ordered=True)
        if isinstance(of, OneItem):
            if node.name == "box":
                return OneBox(of.box) if of.total else uncovered("box of an uncertain item")
            if node.name in ATTRIBUTE_TYPES:
                return self.attribute_of(of, node.name)
        uncovered("member")

    def attribute_of(self, item: OneItem, name: str) -> Attribute:
        return Attribute(ATTRIBUTE_TYPES[name], f"{item.box}.items[{item.text}][{ITEM_FIELDS[name]}]", item.total)

    def comparison(self, node: Comparison, scope: Scope) -> Truth:
        values = [self.code(part, scope) for part in (node.left, *node.rights)]
        self.charge_values(*values, *values)
        total = all_total(values)
        if all(isinstance(value, Number | Truth) for value in values) and "in" not in " ".join(node.operators):
            texts = [cast("Number", value).text for value in values]
            pairs = zip(node.operators, texts[1:], strict=True)
            return Truth(f"({texts[0]} {' '.join(f'{operator} {text}' for operator, text in pairs)})", total)
        if len(values) != 2:
            uncovered("chain")
        left, right = values
        match node.operators[0]:
            case "==":
                return equality(left, right)
            case "!=":
                return negated(equality(left, right))
            case "in":
                return self.membership(left, right)
            case "not in":
                return negated(self.membership(left, right))
            case _:
                uncovered("order")

    def membership(self, value: Code, held: Code) -> Truth:
        held = as_collection(held)
        total = all_total((value, held))
        if isinstance(value, Attribute) and isinstance(held, Attributes) and value.kind is held.kind:
            return Truth(f"({held.text} >> {value.text} & 1)", total)
        if isinstance(value, OneItem) and isinstance(held, Items) and len(held.parts) == 1:
            part = held.parts[0]
            if part.box == value.box:
                return Truth(f"({part.mask} >> {value.text} & 1)", total)
        uncovered("membership")

    def arithmetic(self, node: Arithmetic, scope: Scope) -> Code:
        left, right = self.code(node.left, scope), self.code(node.right, scope)
        self.charge_values(left, right)
        if isinstance(left, Number) and isinstance(right, Number):
            if node.operator == "%" and (node.right == Constant(0) or not isinstance(node.right, Constant)):
                uncovered("remainder")
            return Number(f"({left.text} {node.operator} {right.text})", all_total((left, right)))
        if node.operator == "+" and isinstance(left, Items) and isinstance(right, Items):
            boxes = [part.box for part in (*left.parts, *right.parts)]
            if left.ordered and right.ordered and len(set(boxes)) == len(boxes):
                return Items(left.parts + right.parts, ordered=True)
        uncovered("arithmetic")

    # Calls

    def call(self, node: Call, scope: Scope) -> Code:
        word = node.word
        if _is_test(word):
            return self.test(node, scope)
        if _is_relation(word):
            return self.relation(node, scope)
        if word.name in BINARY_WORDS:
            return self.binary(node, scope)
        if word.name == "all_same_attribute":
            return self.all_same_attribute(node, scope)
        if word.name in ("filter_obj", "All", "Any"):
            return self.quantified(node, scope)
        write = ATTRIBUTE_WORDS.get(word.name) or VALUE_WORDS.get(word.name)
        if write is None or None in node.arguments:
            uncovered(word.name)
        values = [as_collection(self.code(argument, scope)) for argument in node.arguments if argument is not None]
        self.charge_call(word, *values)
        return write(self, *values)

    def test(self, node: Call, scope: Scope) -> Truth:
        item = self.code(cast("Node", node.arguments[0]), scope)
        if isinstance(item, TheOnly):
            parts = item.of.parts
            tests = [self.test_mask(node, part.box) for part in parts]
            masks = [part.mask for part in parts]
            return Truth(f"only_meets(({', '.join(masks)}), ({', '.join(tests)}))", total=False)
        if not isinstance(item, OneItem):
            uncovered("test of what is not an item")
        return Truth(f"({self.test_mask(node, item.box)} >> {item.text} & 1)", item.total)

    def test_mask(self, node: Call, box: str) -> str:
        self.charge_call(node.word, *[Number("0")] * len(node.arguments))
        constants: list[Enum] = []
        for parameter, argument in zip(node.word.parameters[1:], node.arguments[1:], strict=True):
            side = Constant(parameter.default) if argument is None else argument
            if not isinstance(side, Constant) or not isinstance(side.value, Side):
                uncovered("side")
            constants.append(side.value)
        name = "_".join((node.word.name, *(value.name for value in constants)))
        return self.lifted(name, box_functions.vectorised_test(node.word, tuple(constants)), box)

    def relation(self, node: Call, scope: Scope) -> Items:
        of = as_collection(self.code(cast("Node", node.arguments[0]), scope))
        self.charge_call(node.word, of)
        if isinstance(of, OneItem):
            rows = self.lifted(node.word.name, box_functions.vectorised_relation(node.word), of.box)
            return Items((Part(of.box, f"{rows}[{of.text}]", of.total),), ordered=False)
        if not isinstance(of, Items):
            uncovered("relation")
        parts: list[Part] = []
        for part in sorted(of.parts, key=lambda part: part.box):
            rows = self.lifted(node.word.name, box_functions.vectorised_relation(node.word), part.box)
            parts.append(Part(part.box, f"united({rows}, {part.mask})", part.total))
        return Items(tuple(parts), ordered=False)

    def binary(self, node: Call, scope: Scope) -> Truth:
        """AND, OR, NOT and the comparisons of numbers."""
        values = [self.code(argument, scope) for argument in node.arguments if argument is not None]
        self.charge_call(node.word, *values)
        kind, operator = BINARY_WORDS[node.word.name]
        if not all(isinstance(value, kind) for value in values):
            uncovered("a type error")
        texts = [cast("Number", value).text for value in values]
        if operator == "not":
            return Truth(f"(not {texts[0]})", values[0].total)
        if operator in ("and", "or") and not values[1].total:
            operator = {"and": "&", "or": "|"}[operator]
        return Truth(f"({texts[0]} {operator} {texts[1]})", all_total(values))

    def quantified(self, node: Call, scope: Scope) -> Code:
        """filter_obj, All and Any."""
        held = as_collection(self.code(cast("Node", node.arguments[0]), scope))
        self.charge_call(node.word, held, Number("0"))
        parameter, body = _as_lambda(cast("Node", node.arguments[1]))
        name = node.word.name
        strict = name != "filter_obj"
        if isinstance(held, Attributes):
            held = each_value(held)
        if isinstance(held, Choices):
            found = self.choices_where(parameter, body, held, scope, strict=strict)
            return found if name == "filter_obj" else self.choices_quantified(name, held, found)
        if isinstance(held, Static):
            found = self.static_where(parameter, body, held, scope, strict=strict)
            return found if name == "filter_obj" else self.static_quantified(name, held, found)
        if not isinstance(held, Items):
            uncovered("collection")
        parts = [self.where(parameter, body, part, scope, strict=strict) for part in held.parts]
        found = Items(tuple(parts), ordered=True)
        if name == "filter_obj":
            return found
        if name == "Any":
            return existence(found)
        some = existence(held)
        same = [f"({part.mask} == {kept.mask})" for part, kept in zip(held.parts, parts, strict=True)]
        return Truth(f"({some.text} and {' and '.join(same)})", held.total and found.total)

    def static_quantified(self, name: str, held: Static, found: Static) -> Truth:
        if not held.elements or not (held.certain or (held.total and found.total)):
            uncovered("quantifier that may fail")
        kept = [truth.text for truth in found.conditions]
        if name == "Any":
            return Truth(f"({' or '.join(kept)})", found.total)
        if held.certain:
            return Truth(f"({' and '.join(kept)})", found.total)
        same = [f"(not {before.text} or {after})" for before, after in zip(held.conditions, kept, strict=True)]
        return Truth(f"({existence(held).text} and {' and '.join(same)})", found.total)

    def choices_quantified(self, name: str, held: Choices, found: Choices) -> Truth:
        if name == "Any":
            return existence(found)
        return Truth(f"({held.number} == {found.number} != 0)", held.total and found.total)

    def choices_where(self, parameter: str, body: Node, held: Choices, scope: Scope, *, strict: bool) -> Choices:
        if held.filtered:
            uncovered("choices filtered twice")
        texts: list[str] = []
        total = held.total
        for parts in itertools.combinations_with_replacement(held.parts, held.size):
            items: list[OneItem] = []
            loops: list[str] = []
            for box, same in itertools.groupby(parts, key=lambda part: part.box):
                group = list(same)
                names = [f"i{self.count + index + 1}" for index in range(len(group))]
                self.count += len(group)
                items.extend(OneItem(box, name) for name in names)
                loops.append(f"for {', '.join(names)}, in choices(bits({group[0].mask}), {len(group)})")
            chosen: Scope = {**scope, parameter: Static(tuple(items), (Truth("True"),) * len(items))}
            self.loops += 1
            sizes = Counter(part.box for part in parts).values()
            ways = math.prod(math.comb(box_functions.MAX_BOX_ITEMS, size) for size in sizes)
            times, self.times = self.times, self.times * ways
            self.charge_function(body)
            condition = self.strict_truth(body, chosen) if strict else self.truth(body, chosen)
            self.loops, self.times = self.loops - 1, times
            total = total and condition.total
            texts.append(f"sum([1 {' '.join(loops)} if {condition.text}])")
        return Choices(held.parts, held.size, f"({' + '.join(texts)})", total, filtered=True)

    def all_same_attribute(self, node: Call, scope: Scope) -> Truth:
        held = self.code(cast("Node", node.arguments[0]), scope)
        parameter, body = _as_lambda(cast("Node", node.arguments[1]))
        self.charge_call(node.word, held, Number("0"))
        if isinstance(held, Attributes):
            held = each_value(held)
        if not isinstance(held, Static):
            uncovered("all_same_attribute")
        self.charge_function(body, len(held.elements))
        values = [self.code(body, {**scope, parameter: element}) for element in held.elements]
        if not all(isinstance(value, Number) for value in values) and not all(isinstance(v, Truth) for v in values):
            uncovered("all_same_attribute of other values")
        sets = [
            f"({{{cast('Number', value).text} + 0}} if {condition.text} else none)"
            for value, condition in zip(values, held.conditions, strict=True)
        ]
        return Truth(f"(len({' | '.join(sets)}) == 1)", held.total and all_total(values))

    def static_where(self, parameter: str, body: Node, held: Static, scope: Scope, *, strict: bool) -> Static:
        conditions: list[Truth] = []
        for element, before in zip(held.elements, held.conditions, strict=True):
            condition = self.static_condition(parameter, body, element, scope, strict=strict)
            if before.text != "True":
                condition = Truth(f"({before.text} and {condition.text})", before.total and condition.total)
            conditions.append(condition)
        return Static(held.elements, tuple(conditions))

    def static_condition(self, parameter: str, body: Node, element: Code, scope: Scope, *, strict: bool) -> Truth:
        self.charge_function(body)

        def write(generator: _Generator, bound: Scope) -> Truth:
            return generator.strict_truth(body, bound) if strict else generator.truth(body, bound)

        if not isinstance(element, OneBox) or not self.is_closed(parameter, body):
            return write(self, {**scope, parameter: element})
        key = (parameter, id(body), ("box", strict))  # the tree outlives the generator
        return Truth(*self.in_kernel(element.box, key, lambda inner: write(inner, {parameter: OneBox(LOCAL_BOX)})))

    def where(self, parameter: str, body: Node, part: Part, scope: Scope, *, strict: bool) -> Part:
        """The items of a part for which the body is true."""
        if not self.is_closed(parameter, body):
            return self.where_here(parameter, body, part, scope, strict=strict)
        whole = Part(LOCAL_BOX, None)
        text, total = self.in_kernel(
            part.box,
            (parameter, id(body), ("items", strict)),
            lambda inner: inner.where_here(parameter, body, whole, {}, strict=strict),
        )
        return Part(part.box, text if part.text is None else f"({part.text} & {text})", part.total and total)

    def where_here(self, parameter: str, body: Node, part: Part, scope: Scope, *, strict: bool) -> Part:
        self.count += 1
        index = f"i{self.count}"
        bound: Scope = {**scope, parameter: OneItem(part.box, index)}
        times, self.times = self.times, self.times * box_functions.MAX_BOX_ITEMS
        self.charge_function(body)
        masks, rest = self.split(parameter, body, index, bound, strict=strict)
        for mask in masks:
            part = narrowed(part, mask)
        if rest is None:
            self.times = times
            return part
        self.loops += 1
        condition = self.strict_truth(rest, bound) if strict else self.truth(rest, bound)
        self.loops, self.times = self.loops - 1, times
        text = f"sum([1 << {index} for {index} in bits({part.mask}) if {condition.text}])"
        return Part(part.box, text, part.total and condition.total)

    def split(
        self, parameter: str, body: Node, index: str, bound: Scope, *, strict: bool
    ) -> tuple[list[ItemMask], Node | None]:
        """The body as masks, and what of it must be tried item by item."""
        whole = self.mask(parameter, body, index, bound)
        if whole is not None:
            return [whole], None
        if isinstance(body, Logic) and body.operator == "and" and not strict:
            masks: list[ItemMask] = []
            for position, operand in enumerate(body.operands):
                mask = self.mask(parameter, operand, index, bound)
                if mask is None:
                    rest = body.operands[position:]
                    return masks, rest[0] if len(rest) == 1 else Logic("and", rest)
                masks.append(mask)
        if isinstance(body, Call) and body.word.name == "AND":
            first, second = cast("tuple[Node, Node]", body.arguments)
            mask = self.mask(parameter, first, index, bound)
            if mask is not None and self.tried(second, bound).total:
                return [mask], second if strict else Not(Not(second))
            mask = self.mask(parameter, second, index, bound)
            if mask is not None and self.tried(first, bound).total:
                return [mask], first if strict else Not(Not(first))
        return [], body

    def tried(self, node: Node, bound: Scope) -> Truth:
        self.loops += 1
        truth = self.strict_truth(node, bound)
        self.loops -= 1
        return truth

    def mask(self, parameter: str, node: Node, index: str, bound: Scope) -> ItemMask | None:
        """The node, a truth about an item, for all items of its box at once; None when it cannot be."""
        box = cast("OneItem", bound[parameter]).box
        self.charge(costs.CALL + 8)  # as much as AND, OR and NOT of bools
        match node:
            case Call(word=word, arguments=(Variable(name=name), *_)) if name == parameter and _is_test(word):
                return ItemMask(self.test_mask(node, box))
            case Not(operand=operand) | Call(word=Word(name="NOT"), arguments=(operand,)) if operand is not None:
                inner = self.mask(parameter, operand, index, bound)
                return inner and ItemMask(f"~{inner.text}", within=False, total=inner.total)
            case Logic(operator=operator, operands=operands):
                return self.joined_mask(parameter, operator, operands, index, bound)
            case Call(word=Word(name="AND" | "OR" as name), arguments=operands):
                return self.joined_mask(parameter, name.lower(), cast("tuple[Node, ...]", operands), index, bound)
            case _:
                return self.constant_mask(node, index, bound)

    def joined_mask(
        self, parameter: str, operator: str, operands: tuple[Node, ...], index: str, bound: Scope
    ) -> ItemMask | None:
        masks: list[ItemMask] = []
        for operand in operands:
            mask = self.mask(parameter, operand, index, bound)
            if mask is None:
                return None
            masks.append(mask)
        within = any(m.within for m in masks) if operator == "and" else all(m.within for m in masks)
        sign = " & " if operator == "and" else " | "
        return ItemMask("(" + sign.join(mask.text for mask in masks) + ")", within=within, total=all_total(masks))

    def constant_mask(self, node: Node, index: str, bound: Scope) -> ItemMask | None:
        """A truth that is the same for all items of the box, such as one about the box."""
        try:
            value = self.tried(node, bound)
        except Unsupported:
            return None
        if re.search(rf"\b{index}\b", value.text):
            return None
        return ItemMask(f"-({value.text})", within=False, total=value.total)


def _is_test(word: Word) -> bool:
    """A truth about an item, with sides at most as further arguments."""
    kinds = [parameter.type.name for parameter in word.parameters]
    return kinds[:1] == ["item"] and set(kinds[1:]) <= {"Side"} and word.result == "bool" and word.depends_on != "scene"


def _is_relation(word: Word) -> bool:
    return len(word.parameters) == 1 and word.parameters[0].type.mapped and word.depends_on == "box"


def _as_lambda(node: Node) -> tuple[str, Node]:
    if isinstance(node, Lambda):
        return node.parameter, node.body
    if not isinstance(node, WordName) or any(not parameter.optional for parameter in node.word.parameters[1:]):
        uncovered("function")
    return "x", Call(node.word, (Variable("x"), *(None for _ in node.word.parameters[1:])))


class Kernel:
    """A kernel's function of a box, the key of its value in `box.memo`, and the expression that it is made of."""

    __slots__ = ("__weakref__", "expression", "function", "key")

    def __init__(self, key: str, function: Callable[[Box], Any], expression: Expression) -> None:
        self.key = key
        self.function = function
        self.expression = expression


_KERNELS: WeakValueDictionary[str, Kernel] = WeakValueDictionary()  # by source: programs share them
