"""Code generation: syntax tree -> intermediate representation, in which a program is operations on bitmasks.

A collection of items becomes one bitmask per box, a test of an item is vectorised over its box, and loops over boxes
are unrolled. A subexpression that depends on one box only (usually most of the program) becomes a *kernel*: a function
of a box, memoised in `box.memo`, so that after an environment step only the changed box is re-evaluated.

Generated code returns the value of the reference evaluator or, for large boxes, raises FallbackError. Constructs that
may fail or are rare in programs of statements are not supported: they raise Unsupported at compile time.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from typing import NamedTuple, cast

from lilgym_mp.envs.fast import box_functions, printing
from lilgym_mp.envs.fast.ir import (
    BOXES,
    FALSE,
    LOCAL_BOX,
    MAX_ITEMS,
    TRUE,
    AttributeValue,
    Bool,
    BoxCall,
    Boxes,
    BoxItems,
    BoxRef,
    Code,
    Int,
    ItemMask,
    ItemRef,
    Items,
    Kernel,
    LoopIndex,
    Number,
    Scope,
    Unsupported,
    Value,
    Where,
    as_collection,
    as_truth,
    codes_of,
    max_elements,
    max_measure_steps,
    narrow,
    negate,
    operate,
    unsupported,
)
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
MAX_NODES = 5_000  # nodes of the syntax tree lowered for one program


def generate_code(tree: Node) -> Code | None:
    """The code of a program's truth value, or None when it is unsupported."""
    try:
        value = Generator(Context(), kernel=False).lower(tree, {})
        return value.code if isinstance(value, Bool) else None
    except (Unsupported, RecursionError, MemoryError, SyntaxError):
        return None


def generate_function(tree: Node) -> Callable[[Scene], bool] | None:
    """The generated function of a program, or None when it is unsupported. It may raise FallbackError."""
    code = generate_code(tree)
    try:
        return code and printing.scene_function(code)
    except (Unsupported, RecursionError, MemoryError, SyntaxError):
        return None


class _KernelUse(NamedTuple):
    """A kernel in one program."""

    kernel: Kernel
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
        measuring = sum(map(max_measure_steps, values))
        self.charge(measuring + word.steps(sum(map(max_elements, values)), MAX_ITEMS))

    def charge_lambda(self, body: Node) -> None:
        """Charges one call of a function with this body."""
        self.charge(costs.LAMBDA + costs.NODE * own_size(body))

    def charge_operator(self, *values: Value) -> None:
        """Charges an operator for all elements of its operands."""
        self.charge(costs.OPERATION + sum(map(max_measure_steps, values)) + sum(map(max_elements, values)))

    # Kernels and vectorised words

    def kernel_call(self, box: str, key: tuple[str, int, object], lower_body: Callable[[Generator], Code]) -> Code:
        """A call of the kernel generated by `lower_body`.

        `key` identifies the kernel within the program: the lambda's parameter and body, and what is computed from them.
        """
        use = self.context.kernels.get(key)
        if use is None:
            inner = Generator(self.context, kernel=True)
            before = self.context.steps_left
            code = lower_body(inner)
            steps = before - self.context.steps_left
            self.context.steps_left = before
            self.context.size_left -= code.size
            if self.context.size_left < 0:
                unsupported("too long")
            use = self.context.kernels[key] = _KernelUse(printing.kernel(code), steps)
        self.charge(use.steps)
        return BoxCall(box, "kernel", use.kernel.function, use.kernel)

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
            return self.logic(node, scope, strict=False)
        value = self.lower(node, scope)
        self.charge(max_measure_steps(value))
        return as_truth(value)

    def logic(self, node: Logic, scope: Scope, *, strict: bool) -> Bool:
        """Code for `and` or `or` of the operands' conditions."""
        truths = [self.condition(operand, scope, strict=strict).code for operand in node.operands]
        return Bool(operate(node.operator, *truths))

    def lower(self, node: Node, scope: Scope) -> Value:
        """Raises Unsupported, also when the code, which may repeat that of the node's parts, gets too long."""
        self.charge(0)
        match node:
            case Constant(value=bool() as value):
                return TRUE if value else FALSE
            case Constant(value=int() as value):
                return Int(Number(value))
            case Constant(value=Color() | Shape() | Size() as value):
                return AttributeValue(value)
            case SceneName(name="all_boxes"):
                return Boxes()
            case SceneName():
                self.charge(MAX_ITEMS)
                return Items(tuple(BoxItems(box, None) for box in BOXES))
            case Variable(name=name):
                return scope[name]
            case Logic():
                return self.logic(node, scope, strict=True)
            case Not(operand=operand):
                return negate(self.condition(operand, scope))
            case Comparison():
                return self.comparison(node, scope)
            case Arithmetic():
                return self.arithmetic(node, scope)
            case Subscript(of=of, index=Constant(value=int() as index)) if type(index) is int:
                collection = self.lower(of, scope)
                self.charge_operator(collection)
                if collection != Boxes() or index >= len(BOXES):
                    unsupported("subscript")
                return BoxRef(BOXES[index])
            case Member():
                return self.member(node, scope)
            case Display(kind=kind, elements=elements) if kind is list:
                return self.listed_boxes([self.lower(element, scope) for element in elements])
            case Call():
                return self.call(node, scope)
            case _:
                unsupported(type(node).__name__)

    def listed_boxes(self, values: Sequence[Value]) -> Boxes:
        """A list of distinct boxes, in scene order."""
        self.charge_operator(*values)
        boxes = [value.box for value in values if isinstance(value, BoxRef) and value.box in BOXES]
        if not boxes or len(boxes) < len(values) or boxes != sorted(set(boxes)):
            unsupported("display")
        return Boxes(tuple(Number(box in boxes) for box in BOXES))

    def member(self, node: Member, scope: Scope) -> Value:
        """Code for an attribute or method of an item or a box."""
        of = self.lower(node.of, scope)
        self.charge(1 + MAX_ITEMS)
        if isinstance(of, BoxRef) and node.called:
            if node.name == "is_tower":
                return Bool(BoxCall(of.box, "is_tower", box_functions.is_tower))
            return as_collection(of)
        if isinstance(of, ItemRef) and node.name == "box":
            return BoxRef(of.box)
        unsupported("member")

    def comparison(self, node: Comparison, scope: Scope) -> Bool:
        """Code for a comparison of numbers or truths, or of two boxes."""
        values = [self.lower(part, scope) for part in (node.left, *node.rights)]
        self.charge_operator(*values, *values)
        if isinstance(values[0], BoxRef) and node.operators in (("==",), ("!=",)):
            other = values[1]
            if not isinstance(other, BoxRef):
                unsupported("comparison of a box with something else")
            same = values[0] == other
            return Bool(Number(same if node.operators == ("==",) else not same))
        if {"in", "not in"} & {*node.operators}:
            unsupported("membership")
        return Bool(operate(" ".join(node.operators), *codes_of(values, Int, Bool)))

    def arithmetic(self, node: Arithmetic, scope: Scope) -> Value:
        """Code for integers; a remainder needs a constant divisor other than 0."""
        values = self.lower(node.left, scope), self.lower(node.right, scope)
        self.charge_operator(*values)
        if node.operator == "%" and (node.right == Constant(0) or not isinstance(node.right, Constant)):
            unsupported("remainder")
        return Int(operate(node.operator, *codes_of(values, Int)))

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
        if word.name in ("filter_obj", "All", "Any"):
            return self.quantifier(node, scope)
        lower_word = lowering_of(word)
        if lower_word is None or None in node.arguments:
            unsupported(word.name)
        values = [as_collection(self.lower(argument, scope)) for argument in node.arguments if argument is not None]
        self.charge_call(word, *values)
        return lower_word(*values)

    def test(self, node: Call, scope: Scope) -> Bool:
        """Code for a test of one item: the item's bit in the mask of all that pass."""
        item = self.lower(cast("Node", node.arguments[0]), scope)
        if not isinstance(item, ItemRef):
            unsupported("test of something other than an item")
        return Bool(_has_bit(self.test_mask(node, item.box), item.index))

    def test_mask(self, node: Call, box: str) -> Code:
        """Code for the bits of a box's items that pass a test."""
        self.charge_call(node.word, *[FALSE] * len(node.arguments))
        constants: list[Enum] = []
        for parameter, argument in zip(node.word.parameters[1:], node.arguments[1:], strict=True):
            side = Constant(parameter.default) if argument is None else argument
            if not isinstance(side, Constant) or not isinstance(side.value, Side):
                unsupported("side")
            constants.append(side.value)
        name = "_".join((node.word.name, *(value.name for value in constants)))
        return BoxCall(box, name, box_functions.vectorised_test(node.word, tuple(constants)))

    def relation(self, node: Call, scope: Scope) -> Items:
        """Code for the items related to an item."""
        of = self.lower(cast("Node", node.arguments[0]), scope)
        self.charge_call(node.word, of)
        if not isinstance(of, ItemRef):
            unsupported("relation of something other than an item")
        rows = BoxCall(of.box, node.word.name, box_functions.vectorised_relation(node.word))
        return Items((BoxItems(of.box, operate("row", rows, of.index)),))

    def binary(self, node: Call, scope: Scope) -> Bool:
        """AND, OR, NOT and the comparisons of numbers."""
        values = [self.lower(argument, scope) for argument in node.arguments if argument is not None]
        self.charge_call(node.word, *values)
        codes = codes_of(values, Bool if node.word.group == "logic" else Int)
        return Bool(operate(node.word.operator, *codes))

    def function(self, node: Node | None) -> Lambda:
        """The lambda that the node is, or stands for."""
        found = self.context.lambdas.get(id(node)) or as_lambda(cast("Node", node), "x")
        if found is None:
            unsupported("function")
        return self.context.lambdas.setdefault(id(node), found)

    def quantifier(self, node: Call, scope: Scope) -> Value:
        """filter_obj, All and Any."""
        collection = as_collection(self.lower(cast("Node", node.arguments[0]), scope))
        self.charge_call(node.word, collection, FALSE)
        function = self.function(node.arguments[1])
        name = node.word.name
        strict = name != "filter_obj"
        if isinstance(collection, Boxes):
            kept = self.filter_boxes(function, collection, scope, strict=strict)
            return kept if name == "filter_obj" else self.quantify_boxes(name, collection, kept)
        if not isinstance(collection, Items):
            unsupported("collection")
        found = Items(tuple(self.filter_part(function, part, scope, strict=strict) for part in collection.parts))
        if name == "filter_obj":
            return found
        if name == "Any":
            return as_truth(found)
        some = as_truth(collection)
        pairs = zip(collection.parts, found.parts, strict=True)
        return Bool(operate("and", some.code, *(operate("==", part.mask, kept.mask) for part, kept in pairs)))

    def quantify_boxes(self, name: str, collection: Boxes, kept: Boxes) -> Bool:
        """Code for `Any` or `All` over boxes."""
        if name == "Any":
            return as_truth(kept)
        if collection.unconditional:
            return Bool(operate("and", *kept.conditions))
        pairs = zip(collection.conditions, kept.conditions, strict=True)
        same = [operate("or", operate("not", before), after) for before, after in pairs]
        return Bool(operate("and", as_truth(collection).code, *same))

    def filter_boxes(self, function: Lambda, collection: Boxes, scope: Scope, *, strict: bool) -> Boxes:
        """Code for the condition of each box."""
        conditions: list[Code] = []
        for box, before in zip(BOXES, collection.conditions, strict=True):
            condition = self.box_condition(function, box, scope, strict=strict)
            conditions.append(condition if before == TRUE.code else operate("and", before, condition))
        return Boxes(tuple(conditions))

    def box_condition(self, function: Lambda, box: str, scope: Scope, *, strict: bool) -> Code:
        """Code for the condition of one box, a kernel where possible."""
        parameter = function.parameter
        body = function.body
        self.charge_lambda(body)
        if not self.can_be_kernel(function):
            return self.condition(body, {**scope, parameter: BoxRef(box)}, strict=strict).code
        local: Scope = {parameter: BoxRef(LOCAL_BOX)}
        key = (parameter, id(body), ("box", strict))  # which the tree or the context keeps
        return self.kernel_call(box, key, lambda inner: inner.condition(body, local, strict=strict).code)

    def filter_part(self, function: Lambda, part: BoxItems, scope: Scope, *, strict: bool) -> BoxItems:
        """The items of a part for which the body is true, computed by a kernel where possible."""
        if not self.can_be_kernel(function):
            return self.filter_inline(function, part, scope, strict=strict)
        whole = BoxItems(LOCAL_BOX, None)
        chosen = self.kernel_call(
            part.box,
            (function.parameter, id(function.body), ("items", strict)),
            lambda inner: inner.filter_inline(function, whole, {}, strict=strict).mask,
        )
        if part.chosen is not None:
            chosen = operate("&", part.chosen, chosen)
        return BoxItems(part.box, chosen)

    def filter_inline(self, function: Lambda, part: BoxItems, scope: Scope, *, strict: bool) -> BoxItems:
        """Code for a loop over a box's items that keeps those that meet a condition."""
        self.variables += 1
        index = f"i{self.variables}"
        item = ItemRef(LoopIndex(index), part.box)
        bound: Scope = {**scope, function.parameter: item}
        max_runs = self.max_runs
        self.max_runs = self.max_runs * box_functions.MAX_BOX_ITEMS
        self.charge_lambda(function.body)
        masks, rest = self.split(function, item, bound, strict=strict)
        for mask in masks:
            part = narrow(part, mask)
        if rest is None:
            self.max_runs = max_runs
            return part
        condition = self.condition(rest, bound, strict=strict)
        self.max_runs = max_runs
        return BoxItems(part.box, Where(index, part.mask, condition.code))

    def split(
        self, function: Lambda, item: ItemRef, bound: Scope, *, strict: bool
    ) -> tuple[list[ItemMask], Node | None]:
        """Splits the body of a filter into masks and the remaining condition to be evaluated item by item."""

        def mask_of(node: Node) -> ItemMask | None:
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
                    if mask is not None:
                        self.condition(rest, bound, strict=True)  # raises Unsupported unless it is a bool
                        return [mask], rest if strict else Not(Not(rest))
            case _:
                pass
        return [], body

    def item_mask(self, parameter: str, node: Node, item: ItemRef, bound: Scope) -> ItemMask | None:
        """A condition on an item vectorised over its box; None when that is not possible."""
        self.charge(costs.CALL + 8)  # the cost of AND, OR and NOT of bools
        match node:
            case Call(word=word, arguments=(Variable(name=name), *_)) if name == parameter and word.is_item_test:
                return ItemMask(self.test_mask(node, item.box))
            case Not(operand=operand) | Call(word=Word(operator="not"), arguments=(operand,)) if operand is not None:
                inner = self.item_mask(parameter, operand, item, bound)
                return inner and ItemMask(operate("~", inner.code), in_range=False)
            case Logic(operator=operator) | Call(word=Word(operator="and" | "or" as operator)):
                return self.combined_mask(parameter, operator, children(node), item, bound)
            case _:
                return self.constant_mask(node, item, bound)

    def combined_mask(
        self, parameter: str, operator: str, operands: Iterable[Node], item: ItemRef, bound: Scope
    ) -> ItemMask | None:
        """Code for the mask of AND or OR of item tests; None if an operand has no mask."""
        found = [self.item_mask(parameter, operand, item, bound) for operand in operands]
        masks = [mask for mask in found if mask]
        if len(masks) < len(found):
            return None
        in_range = any(m.in_range for m in masks) if operator == "and" else all(m.in_range for m in masks)
        code = operate("&" if operator == "and" else "|", *(mask.code for mask in masks))
        return ItemMask(code, in_range=in_range)

    def constant_mask(self, node: Node, item: ItemRef, bound: Scope) -> ItemMask | None:
        """A condition independent of the item, such as one on its box, broadcast to all items of the box."""
        try:
            value = self.condition(node, bound, strict=True)
        except Unsupported:
            return None
        if item.index.name in value.code.indices:
            return None
        return ItemMask(operate("negative", value.code), in_range=False)


def _is_of_scene(node: Node) -> bool:
    """Whether the node itself depends on more than one box."""
    return isinstance(node, SceneName) or (isinstance(node, Call | WordName) and node.word.depends_on == "scene")


def _has_bit(mask: Code, position: Code) -> Code:
    """Code: whether a mask has the bit at a position, as 0 or 1."""
    return operate("&", operate(">>", mask, position), Number(1))
