"""What programs look at, and that sketches keep their truth."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lilgym_mp.corpus import load_tasks
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Box, Scene, Size
from lilgym_mp.solver.aspects import Aspects, aspects
from lilgym_mp.solver.sketches import Sketcher
from tests.scenes import LARGE, B, K, Y, circle, loose_boxes, scatter_boxes, square


def of(program: str) -> Aspects:
    return aspects(compile_program(program).tree)


def test_questions__join_what_is_asked_of_one_item():
    looked_at = of("exist(filter_obj(all_items, lambda x: is_blue(x) and not is_touching_wall(x)))")
    (question,) = looked_at.questions
    assert [question(item) for item in (circle(40, 40, colour=B), circle(0, 0, colour=B), circle(40, 40))] == [
        True,
        False,
        False,
    ]


def test_questions__are_shared_by_programs_that_ask_the_same():
    assert of("exist(filter_obj(all_items, is_blue))").questions == (
        of("count(filter_obj(all_boxes[0], lambda item: is_blue(item))) == 2").questions
    )


def test_questions__about_a_named_value_ask_for_that_value_only():
    (question,) = of("exist(filter_color(all_items, Color.BLUE))").questions
    assert question(circle(0, 0, colour=K)) == question(square(5, 5, colour=Y))


def test_questions__about_any_value_ask_for_the_attribute():
    (question,) = of("count(get_set_colors(all_items)) == 2").questions
    assert question(circle(0, 0, colour=K)) != question(circle(0, 0, colour=Y))


@pytest.mark.parametrize(
    "program",
    [
        "exist(filter_obj(all_items, is_top))",
        "exist(get_touching(all_items))",
        "exist(filter_obj(all_boxes, lambda b: b.is_tower()))",
        "exist(filter_obj(combinations(all_items, 2), lambda p: is_closely_touching(p[0], p[1])))",
        "exist(get_img_all_above(all_items))",
    ],
)
def test_relations__are_not_taken_for_questions(program: str):
    assert of(program).relational


@pytest.mark.parametrize(
    "program", ["query_color(all_items) == [Color.BLUE]", "exist(filter_obj([all_items[0:1]], exist))"]
)
def test_order__matters_to_lists_and_positions(program: str):
    assert of(program).ordered


def test_order__of_boxes_is_no_order_of_items():
    assert not of("exist(all_boxes[1])").ordered


BY_THEMSELVES = (
    "count(filter_obj(all_items, lambda x: is_blue(x) and is_closely_touching_corner(x, Side.LEFT))) == 1",
    "exist(filter_obj(all_boxes, lambda b: count(get_set_shapes(b)) == 2 and not exist(filter_size(b, Size.BIG))))",
    "All(filter_color(all_items, Color.BLACK), lambda x: is_close_to_wall(x, Side.TOP) or is_triangle(x))",
    "count(filter_obj(all_items, lambda x: count(filter_obj(x.box, lambda y: is_yellow(y) and is_small(x))) == 1)) > 0",
    "query_color(all_boxes[0]) == query_color(all_boxes[2])",
    "count(all_boxes[0]) + count(filter_obj(all_boxes[1], is_touching_wall)) == 3",
    "is_blue(unique(filter_shape(all_items, Shape.CIRCLE)))",
)


@given(st.tuples(*[scatter_boxes() | loose_boxes] * 3), st.sampled_from(BY_THEMSELVES))
@settings(max_examples=80)
def test_sketch__has_the_programs_truth(boxes: tuple[Box, Box, Box], source: str):
    program = compile_program(source)
    sketcher = Sketcher(aspects(program.tree))
    left, middle, right = (sketcher.box(sketcher.sketch(box)) for box in boxes)
    assert program(Scene((left, middle, right))) == program(Scene(boxes))


@pytest.mark.parametrize("split", ["train", "dev"])
def test_sketch__has_the_truth_of_builtin_programs(split: str):
    starts = load_tasks("builtin", "scatter", "flipit", split)[:150]
    for task in starts:
        looked_at = aspects(compile_program(task.program).tree)
        if not looked_at.relational:
            sketcher = Sketcher(looked_at)
            left, middle, right = (sketcher.box(sketcher.sketch(box)) for box in task.start.boxes)
            assert task.truth(Scene((left, middle, right))) != task.target, task.program


def test_classes__have_an_item_of_each_look():
    classes = Sketcher(of("exist(filter_obj(all_items, lambda x: is_big(x) and is_black(x)))")).classes
    number = classes.of(square(0, 0, LARGE, K))
    assert {(shape.name, size.name) for shape, _, size in classes.item_types[number]} == {
        ("CIRCLE", "LARGE"),
        ("SQUARE", "LARGE"),
        ("TRIANGLE", "LARGE"),
    }


def test_classes__are_all_known_before_any_item_is_seen():
    """Or else a sketch could be refuted although an item of an unforeseen class would do."""
    program = " or ".join(
        f"exist(filter_obj(all_items, lambda x: {word}(x, Side.{side})))"
        for word in ("is_touching_wall", "is_closely_touching_wall", "is_close_to_wall", "is_close_to_corner")
        for side in ("LEFT", "RIGHT", "TOP", "BOTTOM")
    )
    classes = Sketcher(of(program)).classes
    known = len(classes)
    for size in Size:
        for x in range(-2, 100 - size.pixels + 3):
            for y in (-2, -1, 0, 1, 4, 5, 8, 9, 35, 100 - size.pixels - 9, 100 - size.pixels - 4, 100 - size.pixels):
                classes.of(square(x, y, size))
                classes.of(square(y, x, size))
    assert len(classes) == known
