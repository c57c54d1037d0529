"""Generated code has the reference evaluator's value or error; tests/stress compares random programs."""

from __future__ import annotations

import random

import pytest

from lilgym_mp.programs import Program, compile_program
from lilgym_mp.scene import Box, Colour, Item, Scene, Shape, Size
from tests.stress.program_truth import scenes, value


def assert_agreement(program: Program, scene: Scene) -> None:
    fresh = Scene.of(*(box.items for box in scene.boxes))
    for _ in range(2):  # the second time from memos
        assert value(program, fresh) == value(program, scene, reference=True), program.source


SUPPORTED = (
    "exist(filter_obj(all_items, lambda x: AND(is_blue(x), NOT(is_touching_wall(x, Side.TOP)))))",
    "count(filter_obj(all_boxes, lambda b: b.is_tower() and count(b) >= 2)) == 1",
    "exist(filter_obj(all_items, lambda x: exist(get_below(x)) and is_black(unique(get_below(x)))))",
    "exist(filter_obj(all_boxes, lambda a: count(filter_obj(all_boxes, lambda b: count(a) == count(b))) == 2))",
    "exist(filter_obj(combinations(all_boxes, 2), lambda p: get_set_colors(p[0]) == get_set_colors(p[1])))",
    "exist(all_items) and is_top(unique(filter_color(all_boxes[0], Color.BLUE)))",
    "All(filter_obj(all_boxes, lambda b: b.is_tower()), lambda b: count(b) < 3)",
    "count(filter_obj(filter_obj(all_boxes, lambda b: b.is_tower()), lambda b: count(b) < 3)) == 1",
    "exist(filter_obj(combinations(all_items, 2), lambda p: all_same_color(p) and p[0].box != p[1].box))",
    "all_same_attribute(filter_obj(all_boxes, lambda b: b), lambda b: count(filter_color(b, Color.BLUE)))",
    "count(filter_obj(all_boxes, lambda b: exist(get_above(b)))) == 1",
    "All(all_items, lambda x: equal_color(query_color(x), [Color.BLUE]) or x.color in {Color.BLACK, Color.YELLOW})",
    "equal_set([Color.BLUE, Color.BLACK], get_set_colors(all_items)) and contained([Color.BLUE], {Color.BLUE})",
)


@pytest.mark.parametrize("source", SUPPORTED)
def test_common_constructs__have_generated_code_that_agrees(source: str) -> None:
    program, rng = compile_program(source), random.Random(source)
    assert program.has_generated_code
    for scene in (scene for _ in range(8) for scene in scenes(rng)):
        assert_agreement(program, scene)


def test_words_as_functions__are_told_apart() -> None:
    """Also where an object of one has the address that an object of another had."""
    tops = (f"query_color(unique(filter_obj({name}.all_items_in_box(), is_top)))" for name in "xy")
    bottoms = (f"query_color(unique(filter_obj({name}.all_items_in_box(), is_bottom)))" for name in "xy")
    same = f"equal_color({', '.join(tops)}) and NOT(equal_color({', '.join(bottoms)}))"
    source = f"exist(filter_obj(all_boxes, lambda x: exist(filter_obj(all_boxes, lambda y: {same}))))"
    rng = random.Random(0)
    for _ in range(20):
        program = Program(source)
        assert program.has_generated_code
        for scene in scenes(rng):
            assert_agreement(program, scene)


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
    for scene in (scene for _ in range(4) for scene in scenes(rng)):
        assert_agreement(program, scene)


def test_generated_code__box_memo_is_shared_between_programs_without_collisions() -> None:
    box = Box((Item(0, 0, Shape.SQUARE, Colour.BLUE, Size.SMALL), Item(50, 50, Shape.CIRCLE, Colour.BLACK, Size.LARGE)))
    scene = Scene((box, Box(), box))
    bodies = ("is_blue(x)", "is_black(x)", "NOT(is_blue(x))", "is_blue(x) and is_square(x)", "is_yellow(x)")
    counts = [compile_program(f"count(filter_obj(all_items, lambda x: {body})) == 2")(scene) for body in bodies]
    assert counts == [True, True, True, True, False]
    lambdas = ("lambda x: exist(filter_obj(x, is_blue))", "lambda x: exist(filter_obj(x, is_yellow))")
    assert [compile_program(f"exist(filter_obj(all_boxes, {f}))")(scene) for f in lambdas] == [True, False]
