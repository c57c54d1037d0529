"""Features of programs, and abstractions that preserve their values."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene, Size
from lilgym_mp.solver.abstraction import Abstraction
from lilgym_mp.solver.program_features import program_features
from tests.scenes import scatter_boxes, square, unchecked_boxes


def of(program):
    return program_features(compile_program(program).tree)


def test_item_features__are_shared_by_programs_with_equal_tests():
    assert of("exist(filter_obj(all_items, is_blue))").item_features == (
        of("count(filter_obj(all_boxes[0], lambda item: is_blue(item))) == 2").item_features
    )


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
def test_relations__are_not_item_features(program):
    assert of(program).relational


@pytest.mark.parametrize(
    "program", ["query_color(all_items) == [Color.BLUE]", "exist(filter_obj([all_items[0:1]], exist))"]
)
def test_order__matters_for_lists_and_positions(program):
    assert of(program).order_matters


def test_order__of_items_does_not_matter_where_boxes_are_indexed():
    assert not of("exist(all_boxes[1])").order_matters


NOT_RELATIONAL = (
    "count(filter_obj(all_items, lambda x: is_blue(x) and is_closely_touching_corner(x, Side.LEFT))) == 1",
    "exist(filter_obj(all_boxes, lambda b: count(get_set_shapes(b)) == 2 and not exist(filter_size(b, Size.BIG))))",
    "All(filter_color(all_items, Color.BLACK), lambda x: is_close_to_wall(x, Side.TOP) or is_triangle(x))",
    "count(filter_obj(all_items, lambda x: count(filter_obj(x.box, lambda y: is_yellow(y) and is_small(x))) == 1)) > 0",
    "query_color(all_boxes[0]) == query_color(all_boxes[2])",
    "count(all_boxes[0]) + count(filter_obj(all_boxes[1], is_touching_wall)) == 3",
    "is_blue(unique(filter_shape(all_items, Shape.CIRCLE)))",
)


@given(st.tuples(*[scatter_boxes() | unchecked_boxes] * 3), st.sampled_from(NOT_RELATIONAL))
def test_abstraction__preserves_the_programs_value(boxes, source):
    program = compile_program(source)
    abstraction = Abstraction(program_features(program.tree))
    left, middle, right = (abstraction.representative(abstraction.abstract(box)) for box in boxes)
    assert program(Scene((left, middle, right))) == program(Scene(boxes))


def test_item_classes__are_all_known_in_advance():
    """Otherwise a goal could be declared infeasible although an item of an unknown class would reach it."""
    program = " or ".join(
        f"exist(filter_obj(all_items, lambda x: {word}(x, Side.{side})))"
        for word in ("is_touching_wall", "is_closely_touching_wall", "is_close_to_wall", "is_close_to_corner")
        for side in ("LEFT", "RIGHT", "TOP", "BOTTOM")
    )
    classes = Abstraction(of(program)).classes
    known = len(classes)
    for size in Size:
        for x in range(-2, 100 - size.pixels + 3):
            for y in (-2, -1, 0, 1, 4, 5, 8, 9, 35, 100 - size.pixels - 9, 100 - size.pixels - 4, 100 - size.pixels):
                classes.of(square(x, y, size))
                classes.of(square(y, x, size))
    assert len(classes) == known
