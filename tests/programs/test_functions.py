"""Semantics of the words not covered by recordings: each test is a small scene and a truth value."""

from __future__ import annotations

import pytest

from lilgym_mp.programs import ProgramRuntimeError, compile_program
from lilgym_mp.scene import Colour, Item, Scene, Shape, Size
from tests.scenes import LARGE, SMALL, B, K, Y, circle, square, tower


def holds(source: str, *boxes: list[Item]) -> bool:
    """The truth value in a scene of these boxes, checked to be the same by both evaluators."""
    scene = Scene.of(*boxes, *([] for _ in range(3 - len(boxes))))
    program = compile_program(source)
    truth = program.evaluate(scene)
    assert truth == program.evaluate_reference(scene)
    return truth


def fails(source: str, *boxes: list[Item]) -> str:
    """The error message in a scene of these boxes."""
    scene = Scene.of(*boxes, *([] for _ in range(3 - len(boxes))))
    with pytest.raises(ProgramRuntimeError) as fault:
        compile_program(source).evaluate(scene)
    return str(fault.value)


THREE = [square(0, 0), circle(40, 40, colour=K), circle(75, 80, SMALL, B)]


# Sets


def test_count__equal_items_in_one_box_are_two() -> None:
    assert holds("count(all_items) == 2 and count(set(all_items)) == 2", [square(0, 0), square(0, 0)])


def test_len__counts_repetitions() -> None:
    assert holds("len(all_items + all_items) == 6", THREE)


def test_unique__fails_for_zero_or_two_elements() -> None:
    assert "not 0" in fails("is_blue(unique(all_items))")
    assert "not 2" in fails("is_blue(unique(all_boxes[0]))", [square(0, 0), square(50, 0)])
    assert holds("is_blue(unique(all_items))", [square(0, 0, colour=B)])


def test_union_all__of_no_sets_is_empty() -> None:
    assert holds("equal_set(union_all(all_boxes), all_items)", THREE, [square(0, 0)])
    assert holds("count(union_all([])) == 0")


def test_intersect_all__of_no_sets_is_empty() -> None:
    halves = "[filter_obj(all_items, is_circle), filter_obj(all_items, is_small)]"
    assert holds(f"count(intersect_all({halves})) == 1 and is_blue(unique(intersect_all({halves})))", THREE)
    assert holds("count(intersect_all([])) == 0")


def test_select__returns_all_sublists_of_that_size() -> None:
    assert holds("count(select(2, all_items)) == 3 and All(select(2, all_items), lambda c: len(c) == 2)", THREE)
    assert holds("select(1, all_items)[0] == [all_items[0]] and count(select(4, all_items)) == 0", THREE)


def test_combinations__are_in_order() -> None:
    assert holds("combinations(all_items, 2)[2][1] == all_items[2] and count(combinations(all_items, 2)) == 3", THREE)


def test_filter_obj__of_a_set_is_in_scene_order() -> None:
    assert holds("filter_obj(set(all_items), lambda x: 1) == all_items", THREE, tower(Y, K))


# Item tests


def test_is_top_and_is_bottom__hold_for_all_tied_items() -> None:
    level = [square(0, 30), square(40, 30), circle(70, 60, SMALL)]
    assert holds("count(filter_obj(all_items, is_top)) == 2 and count(filter_obj(all_items, is_bottom)) == 1", level)
    low = [circle(0, 60), square(70, 60, SMALL, B), circle(40, 30)]
    assert holds("count(filter_obj(all_items, is_bottom)) == 2 and count(filter_obj(all_items, is_top)) == 1", low)


def test_is_bottom__compares_tops_not_bottoms() -> None:
    big_low, small_high = circle(0, 60, LARGE), circle(50, 70, SMALL, B)
    assert holds("is_blue(unique(filter_obj(all_items, is_bottom)))", [big_low, small_high])


def test_is_second_and_is_third__only_in_a_tower() -> None:
    assert holds("is_black(unique(filter_obj(all_items, is_second)))", tower(Y, K, B))
    assert holds("is_blue(unique(filter_obj(all_items, is_third)))", tower(Y, K, B))
    aside = [*tower(Y, K, B), circle(0, 0)]
    assert not holds("exist(filter_obj(all_items, lambda x: is_second(x) or is_third(x)))", aside)


def test_is_tower__needs_squares_with_equal_right_edges() -> None:
    source = "all_boxes[0].is_tower()"
    assert holds(source, tower(Y))
    assert not holds(source, [])
    assert not holds(source, [square(40, 80), square(41, 59)])
    assert not holds(source, [square(40, 80), circle(40, 59)])
    assert holds(source, [square(40, 80), square(50, 70, SMALL)])


# Walls


@pytest.mark.parametrize(
    ("word", "margin"), [("is_touching_wall", 0), ("is_closely_touching_wall", 4), ("is_close_to_wall", 8)]
)
def test_walls__margin_is_inclusive(word: str, margin: int) -> None:
    for inside, side in (
        (circle(margin, 40), "LEFT"),
        (circle(80 - margin, 40), "RIGHT"),
        (circle(40, margin), "TOP"),
        (circle(40, 80 - margin), "BOTTOM"),
    ):
        towards_middle = {"LEFT": (1, 0), "RIGHT": (-1, 0), "TOP": (0, 1), "BOTTOM": (0, -1)}[side]
        outside = inside._replace(x=inside.x + towards_middle[0], y=inside.y + towards_middle[1])
        for tested in (f"{word}(all_items[0])", f"{word}(all_items[0], Side.{side})"):
            assert holds(tested, [inside])
            assert not holds(tested, [outside])
        assert not any(holds(f"{word}(all_items[0], Side.{o})", [inside]) for o in {"LEFT", "TOP"} - {side})


@pytest.mark.parametrize(
    ("word", "margin"), [("is_touching_corner", 0), ("is_closely_touching_corner", 4), ("is_close_to_corner", 8)]
)
def test_corners__need_exactly_two_walls(word: str, margin: int) -> None:
    assert holds(f"{word}(all_items[0]) and {word}(all_items[0], Side.LEFT)", [circle(margin, margin)])
    assert not holds(f"{word}(all_items[0], Side.RIGHT)", [circle(margin, margin)])
    assert not holds(f"{word}(all_items[0])", [circle(margin, margin + 1)])


def test_specific_corner__needs_both_named_sides() -> None:
    word = "is_closely_touching_specific_corner"
    assert holds(f"{word}(all_items[0], Side.LEFT, Side.TOP)", [circle(4, 4)])
    assert holds(f"{word}(all_items[0], Side.TOP, Side.LEFT)", [circle(4, 4)])
    assert not holds(f"{word}(all_items[0], Side.LEFT, Side.BOTTOM)", [circle(4, 4)])
    assert not holds(f"{word}(all_items[0], Side.LEFT, Side.TOP)", [circle(4, 5)])


# Two items and related items


def test_get_touching__at_one_pixel_but_not_at_two() -> None:
    source = "exist(get_touching(all_items[0]))"
    assert holds(source, [square(0, 0), square(21, 0)])
    assert not holds(source, [square(0, 0), square(22, 0)])
    assert not holds(source, [square(0, 0)], [square(0, 0)])


def test_get_closely_touching__at_four_pixels_but_not_at_five() -> None:
    source = "exist(get_closely_touching(all_items[0]))"
    assert holds(source, [square(0, 0), square(24, 0)])
    assert not holds(source, [square(0, 0), square(25, 0)])


def test_is_closely_touching__compares_opposite_edges_across_boxes() -> None:
    source = "is_closely_touching(all_items[0], all_items[1])"
    assert holds(source, [square(0, 0)], [square(24, 70)])
    assert not holds(source, [square(0, 0)], [square(25, 70)])
    assert not holds(source, [square(0, 0)], [square(0, 0)])


def test_get_above__requires_touching_in_towers_only() -> None:
    assert holds("count(get_above(all_items[0])) == 1", tower(Y, K, B))
    assert holds("count(get_box_all_above(all_items[0])) == 2", tower(Y, K, B))
    assert holds("count(get_above(all_items[0])) == 2", [*tower(Y, K, B), circle(0, 90, SMALL)])
    assert holds("count(get_below(all_items[2])) == 1 and count(get_box_all_below(all_items[2])) == 2", tower(Y, K, B))


def test_get_above__includes_items_whose_bottom_equals_the_top() -> None:
    assert holds("exist(get_above(all_items[0]))", [circle(0, 50), circle(60, 30)])
    assert not holds("exist(get_above(all_items[0]))", [circle(0, 50), circle(60, 31)])


def test_related_words__return_the_union_over_a_collection() -> None:
    assert holds(
        "equal_set(get_above(all_items), all_items[1:]) and get_above(all_items) == set(all_items[1:])", tower(Y, K, B)
    )
    assert holds("count(get_above(filter_color(all_items, Color.BLUE))) == 0", tower(Y, K, B))


def test_get_img_all_above_and_below__search_all_boxes() -> None:
    assert holds("count(get_img_all_above(all_items[0])) == 1", [circle(0, 50)], [circle(0, 30), circle(0, 31)])
    assert holds("count(get_img_all_below(all_items[0])) == 1", [circle(0, 30)], [circle(0, 50), circle(0, 49)])


def test_box_and_image_neighbours__with_and_without_the_item() -> None:
    boxes = ([square(0, 0), square(50, 0)], [square(0, 0)])
    assert holds("get_box_inclusive(all_items[0]) == set(all_boxes[0])", *boxes)
    assert holds("get_box_exclusive(all_items[0]) == {all_items[1]}", *boxes)
    assert holds("get_img_exclusive(all_items[0]) == {all_items[1], all_items[2]}", *boxes)
    assert holds("get_box_exclusive(all_boxes[0]) == set(all_boxes[0])", *boxes)


# Attributes


def test_query__one_value_per_item_in_scene_order() -> None:
    assert holds("query_color(all_items) == [Color.YELLOW, Color.BLACK, Color.BLUE]", THREE)
    assert holds("query_shape(set(all_items)) == [Shape.SQUARE, Shape.CIRCLE, Shape.CIRCLE]", THREE)
    assert holds("query_size(all_items[2]) == [Size.SMALL]", THREE)


def test_all_same__exactly_one_value() -> None:
    assert holds("all_same(query_shape(all_items[1:])) and not all_same(query_shape(all_items))", THREE)
    assert not holds("all_same([]) or all_same_color(all_items) or all_same_attribute(all_items, is_top)")
    assert holds("all_same([[Color.BLUE], [Color.BLUE]]) and not all_same([1, 2])")
    assert holds("all_same_attribute(all_items[1:], query_shape)", THREE)


def test_values_of_different_attributes__are_never_equal() -> None:
    scene = [Item(0, 0, Shape(0), Colour(0), Size(0))]
    assert not holds("all_items[0].color == all_items[0].shape or all_items[0].size == 0", scene)
    assert not holds("contained(get_set_colors(all_items), get_set_shapes(all_items))", scene)


# Comparison and logic


def test_comparison_words__require_ints() -> None:
    assert "a must be an int, not a list of 0" in fails("ge(all_items, 1)")
    assert "b must be an int, not bool True" in fails("equal_int(1, True)")
    assert holds("le(1, 1) and ge(1, 1) and lt(1, 2) and gt(2, 1) and equal_int(2, 2)")
    assert not holds("lt(1, 1) or gt(1, 1) or equal_int(1, 2)")


def test_equal__a_value_equals_the_list_holding_only_it() -> None:
    assert holds("equal(Color.BLUE, [Color.BLUE]) and equal([Color.BLUE, Color.BLUE], Color.BLUE)")
    assert not holds("equal([Color.BLUE, Color.BLUE], [Color.BLUE]) or equal(Color.BLUE, [])")
    assert holds("equal({Color.BLUE, Color.BLACK}, [Color.BLACK, Color.BLUE])")
    assert holds("equal(all_boxes[0], all_items)", THREE)


def test_equal_attribute__requires_values_of_that_attribute() -> None:
    assert holds("equal_color(query_color(all_items[0]), Color.YELLOW)", THREE)
    assert "a must be a Color or collection of Colors" in fails("equal_color(Shape.CIRCLE, Color.BLUE)")
    assert "b must be a Shape or collection of Shapes" in fails("equal_shape(Shape.CIRCLE, [1])")
    assert "Size" in fails("equal_size(1, Size.BIG)")


def test_logic_words__require_bools_and_evaluate_all_arguments() -> None:
    assert "a must be a bool, not int 1" in fails("AND(1, True)")
    assert "b must be a bool, not a list of 0" in fails("OR(True, all_items)")
    assert "a must be a bool" in fails("NOT(count(all_items))")
    assert "unique" in fails("AND(False, is_blue(unique(all_items)))")
    assert "unique" in fails("OR(True, is_blue(unique(all_items)))")
    assert not holds("False and is_blue(unique(all_items))")


def test_all_and_any__require_true_not_truthy() -> None:
    assert not holds("All(all_items, lambda x: 1) or Any(all_items, lambda x: all_items)", THREE)
    assert holds("All(all_items, lambda x: True) and Any(all_items, is_black)", THREE)
    assert not holds("All(all_items, lambda x: True) or Any(all_items, lambda x: True)")


def test_all__stops_at_the_first_failure() -> None:
    faulty = "lambda b: count(b) == 1 and is_blue(unique(b))"
    assert not holds(f"All(all_boxes, {faulty})", [square(0, 0)], THREE)
    assert not holds("All(all_boxes, lambda b: is_blue(unique(b)))", [square(0, 0)], THREE)
    assert "unique" in fails("All(all_boxes, lambda b: is_yellow(unique(b)))", [square(0, 0)], THREE)


# Built-ins and operators


def test_min__the_first_of_the_smallest_by_key() -> None:
    assert holds("min(all_boxes, key=count) == all_boxes[1]", THREE, [], [])
    assert "empty" in fails("min(all_items, key=is_top) == 1")
    assert holds("min([3, 1, 2]) == 1")
    assert "cannot order" in fails("min(all_boxes) == all_boxes[0]")


def test_all_builtin__true_when_empty() -> None:
    assert holds("all(all_items) and all([True, 1]) and not all([all_items])")


def test_operators__fail_on_other_types() -> None:
    assert "<: cannot be used with Color.BLUE and Color.BLACK" in fails("Color.BLUE < Color.BLACK")
    assert "right side is 0" in fails("1 % 0 == 0")
    assert "cannot be used" in fails("all_items + 1 == 1")
    assert "out of range" in fails("is_top(all_items[0])")
    assert "only a list can be indexed" in fails("is_top(set(all_items)[0])", THREE)
    assert "element of a set" in fails("count({all_items}) == 1")
    assert ".is_tower" in fails("all_items.is_tower()")
    assert "a program must return a bool" in fails("count(all_items)")
