"""Code generation: syntax tree -> intermediate representation, in which a program is operations on bitmasks.

A collection of items becomes one bitmask per box, a test of an item is vectorised over its box, and loops over boxes
are unrolled. A subexpression that depends on one box only (usually most of the program) becomes a *kernel*: a function
of a box, memoised in `box.memo`, so that after an environment step only the changed box is re-evaluated.

Generated code returns the value of the reference evaluator or raises FallbackError. It raises whenever the reference
evaluator would fail, and sometimes when it would not. Unsupported constructs raise Unsupported at compile time.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable
from enum import Enum
from typing import NamedTuple, cast

from lilgym_mp.envs.fast import box_functions, ir, printing
from lilgym_mp.envs.fast.ir import Bool, Code, Items, Scope, StaticList, Value, operate, unsupported
from lilgym_mp.envs.fast.word_lowering import lowering_of
from lilgym_mp.programs import costs
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
    Subscript,
    Variable,
    WordName,
    as_lambda,
    children,
    free_variables,
    own_size,
    walk,
)
from lilgym_mp.programs.values import Color, Shape, Side, Size
from lilgym_mp.programs.words import Word
from lilgym_mp.scene import Scene

MAX_KERNEL_SIZE = 40_000  # nodes of the code of all kernels of one program together
MAX_TUPLES = 100  # combinations of static elements, which are unrolled
MAX_NODES = 5_000  # nodes of the syntax tree lowered for one program


def generate_code(tree: Node) -> Code | None:
    """The code of a program's truth value, or None when it is unsupported."""
    try:
        value = Generator(Context(), kernel=False).lower(tree, {})
        return value.code if isinstance(value, Bool) else None
    except (ir.Unsupported, RecursionError, MemoryError, SyntaxError):
        return None


def generate_function(tree: Node) -> Callable[[Scene], bool] | None:
    """The generated function of a program, or None when it is unsupported. It may raise FallbackError."""
    code = generate_code(tree)
    try:
        return code and printing.scene_function(code)
    except (ir.Unsupported, RecursionError, MemoryError, SyntaxError):
        return None


class _KernelUse(NamedTuple):
    """A kernel in one program."""

    kernel: ir.Kernel
    total: bool
    steps: int  # upper bound on the evaluation steps of a call


class Context:
    """State of compiling one program: the budget for generated code, kernels, and an upper bound on evaluation steps.

    No code is generated for a program that could exceed STEP_LIMIT on boxes of MAX_BOX_ITEMS items, because generated
    code does not count steps and so would not fail there.
    """

    def __init__(self) -> None:
        self.nodes_left = MAX_NODES
        self.size_left = MAX_KERNEL_SIZE
        self.steps_left = costs.STEP_LIMIT
        self.kernels: dict[tuple[str, int, object], _KernelUse] = {}
        self.lambdas: dict[int, Lambda] = {}  # by id of the node; kept, as kernels are known by the id of their body


class Generator:
    """Generates one function: of the boxes b0, b1, b2 of a scene, or a kernel of one box b."""

    def __init__(self, context: Context, *, kernel: bool) -> None:
        self.context = context
        self.kernel = kernel
        self.max_runs: int = 1  # upper bound on how often the code being generated runs per evaluation
        self.variables = 0  # number of loop variables created

    def charge(self, steps: int) -> None:
        """Counts a node and its steps. Raises Unsupported where the program could exceed the limits."""
        self.context.nodes_left -= 1
        self.context.steps_left -= self.max_runs * steps
        if self.context.nodes_left < 0 or self.context.steps_left < 0:
            unsupported("too much work")

    def charge_call(self, word: Word, *values: Value) -> None:
        """Charges a call of a word for as many elements as its arguments can have."""
        measuring = sum(map(ir.max_measure_steps, values))
        self.charge(measuring + word.steps(sum(map(ir.max_elements, values)), ir.MAX_ITEMS))

    def charge_lambda(self, body: Node) -> None:
        """Charges one call of a function with this body."""
        self.charge(costs.LAMBDA + costs.NODE * own_size(body))

    def charge_operator(self, *values: Value) -> None:
        """Charges an operator for all elements of its operands."""
        self.charge(costs.OPERATION + sum(map(ir.max_measure_steps, values)) + sum(map(ir.max_elements, values)))

    # Kernels and vectorised words

    def kernel_call(
        self, box: str, key: tuple[str, int, object], lower_body: Callable[[Generator], Bool | ir.BoxItems]
    ) -> tuple[Code, bool]:
        """A call of the kernel generated by `lower_body`, and whether it is total.

        `key` identifies the kernel within the program: the lambda's parameter and body, and what is computed from them.
        """
        use = self.context.kernels.get(key)
        if use is None:
            inner = Generator(self.context, kernel=True)
            before = self.context.steps_left
            value = lower_body(inner)
            steps = before - self.context.steps_left
            self.context.steps_left = before
            code = value.code if isinstance(value, Bool) else value.mask
            self.context.size_left -= code.size
            if self.context.size_left < 0:
                unsupported("too long")
            use = self.context.kernels[key] = _KernelUse(printing.kernel(code), value.total, steps)
        self.charge(use.steps)
        return ir.BoxCall(box, "kernel", use.kernel.function, use.kernel), use.total

    def can_be_kernel(self, function: Lambda) -> bool:
        """Whether the function reads nothing but its parameter, so that its code can be shared."""
        body = function.body
        return not (self.kernel or free_variables(body) - {function.parameter} or any(map(_is_of_scene, walk(body))))

    # Expressions

    def condition(self, node: Node, scope: Scope, *, strict: bool = False) -> Bool:
        """The truthiness of the node's value; with `strict`, the value itself, which must be a bool."""
        if strict:
            value = self.lower(node, scope)
            if not isinstance(value, Bool):
                unsupported("not a bool")
            return value
        if isinstance(node, Logic):
            truths = [self.condition(operand, scope) for operand in node.operands]
            return Bool(operate(node.operator, *(truth.code for truth in truths)), ir.all_total(truths))
        value = self.lower(node, scope)
        self.charge(ir.max_measure_steps(value))
        return ir.as_truth(value)

    def lower(self, node: Node, scope: Scope) -> Value:
        """Raises Unsupported, also when the code, which may repeat that of the node's parts, gets too long."""
        self.charge(0)
        match node:
            case Constant(value=bool() as value):
                return ir.TRUE if value else ir.FALSE
            case Constant(value=int() as value):
                return ir.Int(ir.Number(value))
            case Constant(value=Color() | Shape() | Size() as value):
                return ir.AttributeValue(ir.Number(value.value), enum=type(value))
            case SceneName(name="all_boxes"):
                return ir.static_list(map(ir.BoxRef, ir.BOXES))
            case SceneName():
                self.charge(ir.MAX_ITEMS)
                return Items(tuple(ir.BoxItems(box, None) for box in ir.BOXES), ordered=True)
            case Variable(name=name):
                return scope[name]
            case Logic(operands=operands):
                truths = [self.condition(operand, scope, strict=True) for operand in operands]
                return Bool(operate(node.operator, *(truth.code for truth in truths)), ir.all_total(truths))
            case Not(operand=operand):
                return ir.negate(self.condition(operand, scope))
            case Comparison():
                return self.comparison(node, scope)
            case Arithmetic():
                return self.arithmetic(node, scope)
            case Subscript(of=of, index=Constant(value=int() as index)) if type(index) is int:
                collection = self.lower(of, scope)
                self.charge_operator(collection)
                if not isinstance(collection, StaticList) or not collection.unconditional:
                    unsupported("subscript")
                if index >= len(collection.elements):
                    unsupported("an index out of range")
                if len(collection.elements) > 1:
                    ir.settled(collection)
                return collection.elements[index]
            case Member():
                return self.member(node, scope)
            case Display(kind=kind, elements=elements):
                values = [self.lower(element, scope) for element in elements]
                self.charge_operator(*values)
                if not all(isinstance(value, ir.BoxRef | ir.AttributeValue) for value in values):
                    unsupported("display")
                return ir.static_list(values) if kind is list else ir.attribute_set(values)
            case Call():
                return self.call(node, scope)
            case _:
                unsupported(type(node).__name__)

    def member(self, node: Member, scope: Scope) -> Value:
        """Code for an attribute or method of an item or a box."""
        of = self.lower(node.of, scope)
        self.charge(1 + ir.MAX_ITEMS)
        if isinstance(of, ir.BoxRef) and node.called:
            if node.name == "is_tower":
                return Bool(ir.BoxCall(of.box, "is_tower", box_functions.is_tower))
            return Items((ir.BoxItems(of.box, None),), ordered=True)
        if isinstance(of, ir.ItemRef):
            if node.name == "box" and not of.total:
                unsupported("box of an item that may not exist")
            if node.name == "box":
                return ir.BoxRef(of.box)
            if node.name in ir.ATTRIBUTE_TYPES:
                return ir.attribute_of(of, node.name)
        unsupported("member")

    def comparison(self, node: Comparison, scope: Scope) -> Bool:
        """Code for a comparison; of more than two values only if all are numbers or truths."""
        values = [self.lower(part, scope) for part in (node.left, *node.rights)]
        self.charge_operator(*values, *values)
        total = ir.all_total(values)
        operators = " ".join(node.operators)
        if all(isinstance(value, ir.Int | Bool) for value in values) and "in" not in operators:
            return Bool(operate(operators, *(cast("ir.Int", value).code for value in values)), total)
        if len(values) != 2:
            unsupported("chain")
        left, right = values
        match node.operators[0]:
            case "==":
                return ir.equality(left, right)
            case "!=":
                return ir.negate(ir.equality(left, right))
            case "in":
                return ir.membership(left, right)
            case "not in":
                return ir.negate(ir.membership(left, right))
            case _:
                unsupported("order")

    def arithmetic(self, node: Arithmetic, scope: Scope) -> Value:
        """Code for integers; a remainder needs a constant divisor other than 0."""
        left = self.lower(node.left, scope)
        right = self.lower(node.right, scope)
        self.charge_operator(left, right)
        if isinstance(left, ir.Int) and isinstance(right, ir.Int):
            if node.operator == "%" and (node.right == Constant(0) or not isinstance(node.right, Constant)):
                unsupported("remainder")
            return ir.Int(operate(node.operator, left.code, right.code), ir.all_total((left, right)))
        unsupported("arithmetic")

    # Calls

    def call(self, node: Call, scope: Scope) -> Value:
        """Code for a call of a word."""
        word = node.word
        if word.is_item_test:
            return self.test(node, scope)
        if len(word.parameters) == 1 and word.parameters[0].type.mapped and word.depends_on == "box":
            return self.relation(node, scope)
        if word.operator:
            return self.binary(node, scope)
        if word.name == "all_same_attribute":
            return self.all_same_attribute(node, scope)
        if word.name in ("filter_obj", "All", "Any"):
            return self.quantifier(node, scope)
        lower_word = self.combinations if word.name == "combinations" else lowering_of(word)
        if lower_word is None or None in node.arguments:
            unsupported(word.name)
        values = [ir.as_collection(self.lower(argument, scope)) for argument in node.arguments if argument is not None]
        self.charge_call(word, *values)
        return lower_word(*values)

    def test(self, node: Call, scope: Scope) -> Bool:
        """Code for a test of one item: the item's bit in the mask of all that pass."""
        item = self.lower(cast("Node", node.arguments[0]), scope)
        if not isinstance(item, ir.ItemRef):
            unsupported("test of something other than an item")
        return Bool(ir.has_bit(self.test_mask(node, item.box), item.code), item.total)

    def test_mask(self, node: Call, box: str) -> Code:
        """Code for the bits of a box's items that pass a test."""
        self.charge_call(node.word, *[ir.FALSE] * len(node.arguments))
        constants: list[Enum] = []
        for parameter, argument in zip(node.word.parameters[1:], node.arguments[1:], strict=True):
            side = Constant(parameter.default) if argument is None else argument
            if not isinstance(side, Constant) or not isinstance(side.value, Side):
                unsupported("side")
            constants.append(side.value)
        name = "_".join((node.word.name, *(value.name for value in constants)))
        return ir.BoxCall(box, name, box_functions.vectorised_test(node.word, tuple(constants)))

    def relation(self, node: Call, scope: Scope) -> Items:
        """Code for the items related to an item or to any of several, box by box."""
        of = ir.as_collection(self.lower(cast("Node", node.arguments[0]), scope))
        self.charge_call(node.word, of)
        if not isinstance(of, ir.ItemRef | Items):
            unsupported("relation")
        parts: list[ir.BoxItems] = []
        for part in (of,) if isinstance(of, ir.ItemRef) else sorted(of.parts, key=lambda part: part.box):
            rows = ir.BoxCall(part.box, node.word.name, box_functions.vectorised_relation(node.word))
            if isinstance(part, ir.ItemRef):
                related = operate("row", rows, part.code)
            else:
                related = operate("union", rows, part.mask)
            parts.append(ir.BoxItems(part.box, related, part.total))
        return Items(tuple(parts), ordered=False)

    def binary(self, node: Call, scope: Scope) -> Bool:
        """AND, OR, NOT and the comparisons of numbers."""
        values = [self.lower(argument, scope) for argument in node.arguments if argument is not None]
        self.charge_call(node.word, *values)
        operand_type = Bool if node.word.group == "logic" else ir.Int
        operator = node.word.operator
        if not all(isinstance(value, operand_type) for value in values):
            unsupported("operand of the wrong type")
        if operator == "not":
            return ir.negate(cast("Bool", values[0]))
        if operator in ("and", "or") and not values[1].total:
            operator = {"and": "&", "or": "|"}[operator]
        return Bool(operate(operator, *(cast("ir.Int", value).code for value in values)), ir.all_total(values))

    def function(self, node: Node | None) -> Lambda:
        """The lambda that the node is, or stands for."""
        found = self.context.lambdas.get(id(node)) or as_lambda(cast("Node", node), "x")
        if found is None:
            unsupported("function")
        return self.context.lambdas.setdefault(id(node), found)

    def quantifier(self, node: Call, scope: Scope) -> Value:
        """filter_obj, All and Any."""
        collection = ir.as_collection(self.lower(cast("Node", node.arguments[0]), scope))
        self.charge_call(node.word, collection, ir.FALSE)
        function = self.function(node.arguments[1])
        name = node.word.name
        strict = name != "filter_obj"
        if isinstance(collection, ir.Combinations) and name != "All":
            found = self.filter_combinations(function, collection, scope, strict=strict)
            return found if name == "filter_obj" else ir.existence(found)
        if isinstance(collection, StaticList):
            found = self.filter_static(function, collection, scope, strict=strict)
            return found if name == "filter_obj" else self.quantify_static(name, collection, found)
        if not isinstance(collection, Items):
            unsupported("collection")
        parts = [self.filter_part(function, part, scope, strict=strict) for part in collection.parts]
        found = Items(tuple(parts), ordered=True)
        if name == "filter_obj":
            return found
        if name == "Any":
            return ir.existence(found)
        some = ir.existence(collection)
        same = [operate("==", part.mask, kept.mask) for part, kept in zip(collection.parts, parts, strict=True)]
        return Bool(operate("and", some.code, *same), collection.total and found.total)

    def quantify_static(self, name: str, collection: StaticList, found: StaticList) -> Bool:
        """Code for `Any` or `All` over elements that are known beforehand."""
        if not collection.elements or not (collection.unconditional or (collection.total and found.total)):
            unsupported("quantifier that may fail")
        conditions = [condition.code for condition in found.conditions]
        if name == "Any":
            return Bool(operate("or", *conditions), found.total)
        if collection.unconditional:
            return Bool(operate("and", *conditions), found.total)
        same = [
            operate("or", ir.negate(before).code, after)
            for before, after in zip(collection.conditions, conditions, strict=True)
        ]
        return Bool(operate("and", ir.existence(collection).code, *same), found.total)

    def combinations(self, s: Value, k: Value) -> StaticList | ir.Combinations:
        """Code for subsets: of items for sizes 2 and 3, else of elements that are known beforehand."""
        if not isinstance(k, ir.Int) or not isinstance(k.code, ir.Number):
            unsupported("size")
        size = k.code.value
        if isinstance(s, Items) and size in (2, 3):
            count = math.comb(ir.MAX_ITEMS, size)
            if len({part.box for part in s.parts}) != len(s.parts) or count > costs.SIZE_LIMIT:
                unsupported("combinations")
            self.charge(costs.SUBSET_ELEMENT * (1 + 2 * size) * count)  # at most 2 elements an item: `ResultSize`
            items = operate("+", *(part.count for part in s.parts))
            return ir.Combinations(s.parts, size, operate("comb", items, k.code), s.total)
        if not isinstance(s, StaticList) or not s.unconditional:
            unsupported("combinations")
        count = math.comb(len(ir.settled(s).elements), size)
        if count > MAX_TUPLES:
            unsupported("combinations of many")
        self.charge(costs.SUBSET_ELEMENT * (1 + size) * (1 + count) * ir.max_elements(s))
        return ir.static_list(map(ir.static_list, itertools.combinations(s.elements, size)))

    def filter_combinations(
        self, function: Lambda, collection: ir.Combinations, scope: Scope, *, strict: bool
    ) -> ir.Combinations:
        """Code for the number of subsets of items that meet a condition."""
        if collection.filtered:
            unsupported("combinations filtered twice")
        counts: list[Code] = []
        total = collection.total
        for parts in itertools.combinations_with_replacement(collection.parts, collection.size):
            items: list[ir.ItemRef] = []
            loops: list[tuple[tuple[str, ...], Code]] = []
            sizes = Counter(parts)
            for part, size in sizes.items():
                names = tuple(f"i{self.variables + index + 1}" for index in range(size))
                self.variables += size
                items.extend(ir.ItemRef(ir.LoopIndex(name), box=part.box) for name in names)
                loops.append((names, part.mask))
            choices = math.prod(math.comb(box_functions.MAX_BOX_ITEMS, size) for size in sizes.values())
            max_runs = self.max_runs
            self.max_runs = self.max_runs * choices
            self.charge_lambda(function.body)
            chosen: Scope = {**scope, function.parameter: ir.static_list(items)}
            condition = self.condition(function.body, chosen, strict=strict)
            self.max_runs = max_runs
            total = total and condition.total
            counts.append(ir.TupleCount(tuple(loops), condition.code))
        return ir.Combinations(collection.parts, collection.size, operate("+", *counts), total, filtered=True)

    def all_same_attribute(self, node: Call, scope: Scope) -> Bool:
        """Whether some element is present, and those that are have equal values, two by two."""
        collection = self.lower(cast("Node", node.arguments[0]), scope)
        function = self.function(node.arguments[1])
        self.charge_call(node.word, collection, ir.FALSE)
        if not isinstance(collection, StaticList):
            unsupported("all_same_attribute")
        terms: list[tuple[Code, ir.Int | Bool]] = []
        for element, condition in zip(ir.settled(collection).elements, collection.conditions, strict=True):
            self.charge_lambda(function.body)
            value = self.lower(function.body, {**scope, function.parameter: element})
            if not isinstance(value, ir.Int | Bool) or not value.total:
                unsupported("all_same_attribute of other values")
            terms.append((ir.negate(condition).code, value))
        same = [
            operate("or", absent, other_absent, operate("==", value.code, other.code))
            for (absent, value), (other_absent, other) in itertools.combinations(terms, 2)
        ]
        if len({type(value) for _, value in terms}) > 1:
            unsupported("values of two types")
        return ir.conjunction((ir.existence(collection).code, *same), total=collection.total)

    def filter_static(self, function: Lambda, collection: StaticList, scope: Scope, *, strict: bool) -> StaticList:
        """Code for the condition of each element that is known beforehand."""
        conditions: list[Bool] = []
        for element, before in zip(ir.settled(collection).elements, collection.conditions, strict=True):
            condition = self.element_condition(function, element, scope, strict=strict)
            if before != ir.TRUE:
                condition = Bool(operate("and", before.code, condition.code), before.total and condition.total)
            conditions.append(condition)
        return StaticList(collection.elements, tuple(conditions))

    def element_condition(self, function: Lambda, element: Value, scope: Scope, *, strict: bool) -> Bool:
        """Code for the condition of one element; that of a box is a kernel where possible."""
        parameter = function.parameter
        body = function.body
        self.charge_lambda(body)
        if not isinstance(element, ir.BoxRef) or not self.can_be_kernel(function):
            return self.condition(body, {**scope, parameter: element}, strict=strict)
        local: Scope = {parameter: ir.BoxRef(ir.LOCAL_BOX)}
        key = (parameter, id(body), ("box", strict))  # which the tree or the context keeps
        return Bool(*self.kernel_call(element.box, key, lambda inner: inner.condition(body, local, strict=strict)))

    def filter_part(self, function: Lambda, part: ir.BoxItems, scope: Scope, *, strict: bool) -> ir.BoxItems:
        """The items of a part for which the body is true, computed by a kernel where possible."""
        if not self.can_be_kernel(function):
            return self.filter_inline(function, part, scope, strict=strict)
        whole = ir.BoxItems(ir.LOCAL_BOX, None)
        chosen, total = self.kernel_call(
            part.box,
            (function.parameter, id(function.body), ("items", strict)),
            lambda inner: inner.filter_inline(function, whole, {}, strict=strict),
        )
        if part.chosen is not None:
            chosen = operate("&", part.chosen, chosen)
        return ir.BoxItems(part.box, chosen, part.total and total)

    def filter_inline(self, function: Lambda, part: ir.BoxItems, scope: Scope, *, strict: bool) -> ir.BoxItems:
        """Code for a loop over a box's items that keeps those that meet a condition."""
        self.variables += 1
        index = f"i{self.variables}"
        item = ir.ItemRef(ir.LoopIndex(index), box=part.box)
        bound: Scope = {**scope, function.parameter: item}
        max_runs = self.max_runs
        self.max_runs = self.max_runs * box_functions.MAX_BOX_ITEMS
        self.charge_lambda(function.body)
        masks, rest = self.split(function, item, bound, strict=strict)
        for mask in masks:
            part = ir.narrow(part, mask)
        if rest is None:
            self.max_runs = max_runs
            return part
        condition = self.condition(rest, bound, strict=strict)
        self.max_runs = max_runs
        return ir.BoxItems(part.box, ir.Where(index, part.mask, condition.code), part.total and condition.total)

    def split(
        self, function: Lambda, item: ir.ItemRef, bound: Scope, *, strict: bool
    ) -> tuple[list[ir.ItemMask], Node | None]:
        """Splits the body of a filter into masks and the remaining condition to be evaluated item by item."""

        def mask_of(node: Node) -> ir.ItemMask | None:
            return self.item_mask(function.parameter, node, item, bound)

        body = function.body
        whole = mask_of(body)
        if whole is not None:
            return [whole], None
        match body:
            case Logic(operator="and", operands=operands) if not strict:
                masks = [mask for mask in itertools.takewhile(bool, map(mask_of, operands)) if mask]
                rest = operands[len(masks) :]
                return masks, rest[0] if len(rest) == 1 else Logic("and", rest)
            case Call(word=Word(operator="and"), arguments=(first, second)) if first and second:
                for tested, rest in ((first, second), (second, first)):
                    mask = mask_of(tested)
                    if mask is not None and self.condition(rest, bound, strict=True).total:
                        return [mask], rest if strict else Not(Not(rest))
            case _:
                pass
        return [], body

    def item_mask(self, parameter: str, node: Node, item: ir.ItemRef, bound: Scope) -> ir.ItemMask | None:
        """A condition on an item vectorised over its box; None when that is not possible."""
        self.charge(costs.CALL + 8)  # the cost of AND, OR and NOT of bools
        match node:
            case Call(word=word, arguments=(Variable(name=name), *_)) if name == parameter and word.is_item_test:
                return ir.ItemMask(self.test_mask(node, item.box))
            case Not(operand=operand) | Call(word=Word(operator="not"), arguments=(operand,)) if operand is not None:
                inner = self.item_mask(parameter, operand, item, bound)
                return inner and ir.ItemMask(operate("~", inner.code), in_range=False, total=inner.total)
            case Logic(operator=operator) | Call(word=Word(operator="and" | "or" as operator)):
                return self.combined_mask(parameter, operator, children(node), item, bound)
            case _:
                return self.constant_mask(node, item, bound)

    def combined_mask(
        self, parameter: str, operator: str, operands: Iterable[Node], item: ir.ItemRef, bound: Scope
    ) -> ir.ItemMask | None:
        """Code for the mask of AND or OR of item tests; None if an operand has no mask."""
        found = [self.item_mask(parameter, operand, item, bound) for operand in operands]
        masks = [mask for mask in found if mask]
        if len(masks) < len(found):
            return None
        in_range = any(m.in_range for m in masks) if operator == "and" else all(m.in_range for m in masks)
        code = operate("&" if operator == "and" else "|", *(mask.code for mask in masks))
        return ir.ItemMask(code, in_range=in_range, total=ir.all_total(masks))

    def constant_mask(self, node: Node, item: ir.ItemRef, bound: Scope) -> ir.ItemMask | None:
        """A condition independent of the item, such as one on its box, broadcast to all items of the box."""
        try:
            value = self.condition(node, bound, strict=True)
        except ir.Unsupported:
            return None
        if item.code.indices & value.code.indices:
            return None
        return ir.ItemMask(operate("negative", value.code), in_range=False, total=value.total)


def _is_of_scene(node: Node) -> bool:
    """Whether the node itself depends on more than one box."""
    return isinstance(node, SceneName) or (isinstance(node, Call | WordName) and node.word.depends_on == "scene")
