"""Generated code has the reference evaluator's value or error on random programs and scenes."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lilgym_mp.programs import Program, ProgramRuntimeError, compile_program
from lilgym_mp.programs.words import WORDS
from lilgym_mp.scene import Box, Colour, Item, Scene, Shape, Size

SIDES = ("TOP", "BOTTOM", "LEFT", "RIGHT", "ANY")
COLORS = ("Color.YELLOW", "Color.BLACK", "Color.BLUE")
TESTS = [word.name for word in WORDS.values() if word.group == "item tests"]
WALLS = ("is_touching_wall", "is_closely_touching_wall", "is_touching_corner", "is_closely_touching_corner")
RELATIONS = [word.name for word in WORDS.values() if word.group == "related items"]


class Grammar:
    """Random well-typed programs; `items` and `boxes` are the variables in scope, by type."""

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.count = 0

    def pick(self, *choices: str) -> str:
        return self.rng.choice(choices)

    def name(self) -> str:
        self.count += 1
        return self.pick("x", "y", f"v{self.count}")

    def truth(self, depth: int, items: tuple[str, ...], boxes: tuple[str, ...]) -> str:
        draw = self.rng.random()
        if depth <= 0 or draw < 0.2:
            return self.small_truth(items, boxes)
        d = depth - 1
        if draw < 0.45:
            a, b = self.truth(d, items, boxes), self.truth(d, items, boxes)
            return self.pick(
                f"AND({a}, {b})", f"OR({a}, {b})", f"NOT({a})", f"({a} and {b})", f"({a} or {b})", f"(not {a})"
            )
        if draw < 0.6:
            order = self.pick("==", "!=", "<", "<=", ">", ">=")
            return f"{self.number(d, items, boxes)} {order} {self.number(d, items, boxes)}"
        s, t = self.items(d, items, boxes), self.items(d, items, boxes)
        colors, others = self.colors(d, items, boxes), self.colors(d, items, boxes)
        return self.pick(
            f"exist({s})",
            f"exist({self.boxes(d, items, boxes)})",
            f"{self.pick('All', 'Any')}({s}, {self.item_test(d, items, boxes)})",
            f"{self.pick('All', 'Any')}({self.boxes(d, items, boxes)}, {self.box_test(d, items, boxes)})",
            f"{self.pick('contained', 'equal_set', 'equal')}({s}, {t})",
            f"{s} {self.pick('==', '!=')} {t}",
            f"{self.pick('contained', 'equal_set', 'equal', 'equal_color')}({colors}, {others})",
            f"({colors} {self.pick('==', '!=')} {others})",
            f"{self.pick(*COLORS)} {self.pick('in', 'not in')} {colors}",
            f"member_of({self.pick(*COLORS)}, {colors})",
            f"all_same_{self.pick('color', 'shape', 'size')}({s})",
            f"all_same_attribute({self.boxes(d, items, boxes)}, lambda b: count(b))",
            f"equal_color(query_color({s}), query_color({t}))",
            f"exist(filter_obj(combinations({s}, 2), lambda p: {self.pair_test(d, boxes)}))",
            f"exist(filter_obj(combinations(all_boxes, 2), lambda p: {self.truth(d, items, ('p[0]', 'p[1]'))}))",
            f"{self.pick(*TESTS)}(unique({s}))",
        )

    def small_truth(self, items: tuple[str, ...], boxes: tuple[str, ...]) -> str:
        if items and self.rng.random() < 0.8:
            x = self.rng.choice(items)
            wall = f"{self.pick(*WALLS)}({x}, Side.{self.pick(*SIDES)})"
            y = self.rng.choice(items)
            return self.pick(
                f"{self.pick(*TESTS)}({x})", f"{self.pick(*TESTS)}({x})", wall, f"{x}.box.is_tower()", f"{x} == {y}",
                f"{x}.color == {y}.color", f"equal_shape(query_shape({x}), query_shape({y}))",
                f"{x} in get_touching({y})",
            )  # fmt: skip
        if boxes and self.rng.random() < 0.8:
            return f"{self.rng.choice(boxes)}.is_tower()"
        return self.pick("True", "False", "exist(all_items)", "all_items", "1 == 1")

    def pair_test(self, depth: int, boxes: tuple[str, ...]) -> str:
        return self.pick(
            "all_same_color(p)", "count(get_set_shapes(p)) == 1", self.truth(depth, ("p[0]", "p[1]"), boxes)
        )

    def number(self, depth: int, items: tuple[str, ...], boxes: tuple[str, ...]) -> str:
        if depth <= 0:
            return self.pick("0", "1", "2", "3")
        d = depth - 1
        return self.pick(
            "1", "2", f"count({self.items(d, items, boxes)})", f"len({self.items(d, items, boxes)})",
            f"count({self.boxes(d, items, boxes)})", f"count({self.colors(d, items, boxes)})",
            f"(count({self.items(d, items, boxes)}) + {self.number(d, items, boxes)})",
            f"count({self.items(d, items, boxes)}) % {self.pick('2', '3', '0')}",
        )  # fmt: skip

    def items(self, depth: int, items: tuple[str, ...], boxes: tuple[str, ...]) -> str:
        sources = ["all_items", *(f"{b}.all_items_in_box()" for b in boxes), *boxes, *(f"{x}.box" for x in items)]
        if depth <= 0:
            return self.pick(*sources)
        d = depth - 1
        s, t = self.items(d, items, boxes), self.items(d, items, boxes)
        x = self.rng.choice(items) if items else s
        return self.pick(
            s,
            f"filter_obj({s}, {self.item_test(d, items, boxes)})",
            f"filter_obj({s}, {self.item_test(d, items, boxes)})",
            f"filter_color({s}, {self.pick(*COLORS)})",
            f"filter_shape({s}, Shape.{self.pick('CIRCLE', 'SQUARE')})",
            f"{self.pick(*RELATIONS)}({x})",
            f"{self.pick('union', 'intersect')}({s}, {t})",
            f"set({s})",
            f"({s} + {t})",
        )

    def boxes(self, depth: int, items: tuple[str, ...], boxes: tuple[str, ...]) -> str:
        if depth <= 0 or self.rng.random() < 0.3:
            return "all_boxes"
        return f"filter_obj({self.boxes(depth - 1, items, boxes)}, {self.box_test(depth - 1, items, boxes)})"

    def colors(self, depth: int, items: tuple[str, ...], boxes: tuple[str, ...]) -> str:
        return self.pick(
            f"get_set_colors({self.items(depth - 1, items, boxes)})", "{Color.BLUE, Color.BLACK}", "[Color.YELLOW]",
            f"query_color({self.items(depth - 1, items, boxes)})", "set([Color.BLUE])",
        )  # fmt: skip

    def item_test(self, depth: int, items: tuple[str, ...], boxes: tuple[str, ...]) -> str:
        x = self.name()
        kept = tuple(item for item in items if item != x), tuple(box for box in boxes if box != x)
        return self.pick(self.pick(*TESTS), f"lambda {x}: {self.truth(depth, (x, *kept[0]), kept[1])}")

    def box_test(self, depth: int, items: tuple[str, ...], boxes: tuple[str, ...]) -> str:
        b = self.name()
        kept = tuple(item for item in items if item != b), tuple(box for box in boxes if box != b)
        return f"lambda {b}: {self.truth(depth, kept[0], (b, *kept[1]))}"


def random_box(rng: random.Random, towers: bool) -> Box:
    if towers:
        blocks = range(rng.randrange(5))
        return Box(tuple(Item(40, 80 - 21 * i, Shape.SQUARE, Colour(rng.randrange(3)), Size.MEDIUM) for i in blocks))
    items: list[Item] = []
    for _ in range(rng.randrange(6)):
        size = rng.choice(list(Size))
        x, y = (rng.choice((0, 4, 40, 100 - size.pixels, rng.randrange(-2, 90))) for _ in range(2))
        items.append(Item(x, y, rng.choice(list(Shape)), rng.choice(list(Colour)), size))
    return Box(tuple(items))


def random_scene(rng: random.Random) -> Scene:
    towers = rng.random() < 0.4
    boxes = [random_box(rng, towers) for _ in range(3)]
    if rng.random() < 0.3:
        boxes[rng.randrange(3)] = boxes[0]
    return Scene((boxes[0], boxes[1], boxes[2]))


def outcome(evaluate: object, scene: Scene) -> object:
    """The value or the error message."""
    try:
        return evaluate(scene)  # type: ignore[operator]
    except ProgramRuntimeError as fault:
        return str(fault)


def assert_agreement(program: Program, scene: Scene) -> None:
    fresh = Scene.of(*(box.items for box in scene.boxes))
    assert outcome(program.evaluate, fresh) == outcome(program.evaluate_reference, scene), program.source
    assert outcome(program.evaluate, fresh) == outcome(program.evaluate_reference, scene), f"again: {program.source}"


@settings(max_examples=300)
@given(st.integers(0, 2**40), st.integers(1, 4))
def test_random_programs__generated_code_agrees_with_the_reference(seed: int, depth: int) -> None:
    rng = random.Random(seed)
    source = Grammar(rng).truth(depth, (), ())
    if len(source) > 3_000:
        return
    program = compile_program(source)
    for _ in range(4):
        assert_agreement(program, random_scene(rng))


def test_random_programs__many_have_generated_code_and_values() -> None:
    rng = random.Random(7)
    programs = [compile_program(Grammar(rng).truth(3, (), ())) for _ in range(200)]
    scene = random_scene(rng)
    assert sum(program.has_generated_code for program in programs) > 60
    assert sum(isinstance(outcome(program.evaluate, scene), bool) for program in programs) > 80


SUPPORTED = (
    "exist(filter_obj(all_items, lambda x: AND(is_blue(x), NOT(is_touching_wall(x, Side.TOP)))))",
    "count(filter_obj(all_boxes, lambda b: b.is_tower() and count(b) >= 2)) == 1",
    "exist(filter_obj(all_items, lambda x: exist(get_below(x)) and is_black(unique(get_below(x)))))",
    "exist(filter_obj(all_boxes, lambda a: count(filter_obj(all_boxes, lambda b: count(a) == count(b))) == 2))",
    "exist(filter_obj(combinations(all_boxes, 2), lambda p: get_set_colors(p[0]) == get_set_colors(p[1])))",
    "exist(filter_obj(combinations(all_items, 2), lambda p: all_same_color(p) and p[0].box != p[1].box))",
    "exist(all_items) and is_top(unique(filter_color(all_items, Color.BLUE)))",
    "All(filter_obj(all_boxes, lambda b: b.is_tower()), lambda b: count(b) < 3)",
    "all_same_attribute(all_boxes, lambda b: count(filter_color(b, Color.BLUE)))",
    "exist(filter_obj(get_set_colors(all_items), lambda c: count(filter_color(all_items, c)) == 1))",
)


@pytest.mark.parametrize("source", SUPPORTED)
def test_common_constructs__have_generated_code_that_agrees(source: str) -> None:
    program, rng = compile_program(source), random.Random(source)
    assert program.has_generated_code
    for _ in range(40):
        assert_agreement(program, random_scene(rng))


@pytest.mark.parametrize(
    "source",
    [
        "exist(set(all_boxes)[0])",
        "exist(set(all_boxes)[1].all_items_in_box())",
        "exist(union(all_boxes, all_boxes)[0])",
        "count([all_boxes[0], all_boxes[0]]) == 1",
        "len([all_boxes[0], all_boxes[0]]) == 2",
        "exist(combinations(set([all_boxes[2], all_boxes[0]]), 2)[0][0])",
    ],
)
def test_sets_and_repeated_elements_of_a_static_list__are_not_lists_of_distinct_elements(source: str) -> None:
    program, rng = compile_program(source), random.Random(0)
    for _ in range(20):
        assert_agreement(program, random_scene(rng))


def test_generated_code__follows_a_changed_box() -> None:
    program = compile_program("count(filter_obj(all_boxes, lambda b: exist(filter_color(b, Color.BLUE)))) == 1")
    scene = Scene.empty()
    blue = Box((Item(0, 0, Shape.SQUARE, Colour.BLUE, Size.SMALL),))
    truths: list[bool] = []
    for index in (0, 1, 2):
        scene = scene.with_box(index, blue)
        truths.append(program(scene))
    assert truths == [True, False, False]


def test_generated_code__box_memo_is_shared_between_programs_without_collisions() -> None:
    box = Box((Item(0, 0, Shape.SQUARE, Colour.BLUE, Size.SMALL), Item(50, 50, Shape.CIRCLE, Colour.BLACK, Size.LARGE)))
    scene = Scene((box, Box(), box))
    bodies = ("is_blue(x)", "is_black(x)", "NOT(is_blue(x))", "is_blue(x) and is_square(x)", "is_yellow(x)")
    counts = [compile_program(f"count(filter_obj(all_items, lambda x: {body})) == 2")(scene) for body in bodies]
    assert counts == [True, True, True, True, False]
    lambdas = ("lambda x: exist(filter_obj(x, is_blue))", "lambda x: exist(filter_obj(x, is_yellow))")
    assert [compile_program(f"exist(filter_obj(all_boxes, {f}))")(scene) for f in lambdas] == [True, False]
