"""Semantics of the words not covered by recordings: each rule is shown by programs in small scenes."""

import pytest

from lilgym_mp.programs import ProgramRuntimeError, compile_program
from tests.scenes import circle, scene, scene_of

THREE = "square 0,0; circle 40,40 black; circle 75,80 small blue"


def value(source, shown):
    """The value, checked to be the same by both evaluators, or the error message."""
    program = compile_program(source)
    try:
        truth = program.evaluate(shown)
    except ProgramRuntimeError as fault:
        return str(fault)
    assert truth == program.evaluate_reference(shown)
    return str(truth).lower()


# Each rule has lines with the value, or a part of the error message, the program, and after @ the boxes.
RULES = {
    # Sets
    "count__equal_items_in_one_box_are_two": """
        true : count(all_items) == 2 and count(set(all_items)) == 2 @ square 0,0; square 0,0""",
    "len__counts_repetitions": """
        true : len(all_items + all_items) == 6 @ THREE""",
    "unique__fails_for_zero_or_two_elements": """
        not 0 : is_blue(unique(all_items))
        not 2 : is_blue(unique(all_boxes[0])) @ square 0,0; square 50,0
        true : is_blue(unique(all_items)) @ square 0,0 blue""",
    "union_all__of_no_sets_is_empty": """
        true : equal_set(union_all(all_boxes), all_items) @ THREE | square 0,0
        true : count(union_all([])) == 0""",
    "intersect_all__of_no_sets_is_empty": """
        true : is_blue(unique(intersect_all([all_items[1:], filter_obj(all_items, is_small)]))) @ THREE
        true : count(intersect_all([])) == 0""",
    "select__returns_all_sublists_of_that_size": """
        true : count(select(2, all_items)) == 3 and All(select(2, all_items), lambda c: len(c) == 2) @ THREE
        true : select(1, all_items)[0] == [all_items[0]] and count(select(4, all_items)) == 0 @ THREE""",
    "combinations__are_in_order": """
        true : combinations(all_items, 2)[2][1] == all_items[2] and count(combinations(all_items, 2)) == 3 @ THREE""",
    "filter_obj__of_a_set_is_in_scene_order": """
        true : filter_obj(set(all_items), lambda x: 1) == all_items @ THREE | tower yk""",
    # Item tests
    "is_top_and_is_bottom__hold_for_all_tied_items": """
        true : count(filter_obj(all_items, is_top)) == 2 @ square 0,30; square 40,30; circle 70,60 small
        true : count(filter_obj(all_items, is_bottom)) == 1 @ square 0,30; square 40,30; circle 70,60 small
        true : count(filter_obj(all_items, is_bottom)) == 2 @ circle 0,60; square 70,60 small blue; circle 40,30
        true : count(filter_obj(all_items, is_top)) == 1 @ circle 0,60; square 70,60 small blue; circle 40,30""",
    "is_bottom__compares_tops_not_bottoms": """
        true : is_blue(unique(filter_obj(all_items, is_bottom))) @ circle 0,60 large; circle 50,70 small blue""",
    "is_second_and_is_third__only_in_a_tower": """
        true : is_black(unique(filter_obj(all_items, is_second))) @ tower ykb
        true : is_blue(unique(filter_obj(all_items, is_third))) @ tower ykb
        false : exist(filter_obj(all_items, lambda x: is_second(x) or is_third(x))) @ tower ykb; circle 0,0""",
    "is_tower__needs_squares_with_equal_right_edges": """
        true : all_boxes[0].is_tower() @ tower y
        false : all_boxes[0].is_tower()
        false : all_boxes[0].is_tower() @ square 40,80; square 41,59
        false : all_boxes[0].is_tower() @ square 40,80; circle 40,59
        true : all_boxes[0].is_tower() @ square 40,80; square 50,70 small""",
    # Walls
    "specific_corner__needs_both_named_sides": """
        true : is_closely_touching_specific_corner(all_items[0], Side.LEFT, Side.TOP) @ circle 4,4
        true : is_closely_touching_specific_corner(all_items[0], Side.TOP, Side.LEFT) @ circle 4,4
        false : is_closely_touching_specific_corner(all_items[0], Side.LEFT, Side.BOTTOM) @ circle 4,4
        false : is_closely_touching_specific_corner(all_items[0], Side.LEFT, Side.TOP) @ circle 4,5""",
    # Two items and related items
    "get_touching__at_one_pixel_but_not_at_two": """
        true : exist(get_touching(all_items[0])) @ square 0,0; square 21,0
        false : exist(get_touching(all_items[0])) @ square 0,0; square 22,0
        false : exist(get_touching(all_items[0])) @ square 0,0 | square 0,0""",
    "get_closely_touching__at_four_pixels_but_not_at_five": """
        true : exist(get_closely_touching(all_items[0])) @ square 0,0; square 24,0
        false : exist(get_closely_touching(all_items[0])) @ square 0,0; square 25,0""",
    "is_closely_touching__compares_opposite_edges_across_boxes": """
        true : is_closely_touching(all_items[0], all_items[1]) @ square 0,0 | square 24,70
        false : is_closely_touching(all_items[0], all_items[1]) @ square 0,0 | square 25,70
        false : is_closely_touching(all_items[0], all_items[1]) @ square 0,0 | square 0,0""",
    "get_above__requires_touching_in_towers_only": """
        true : count(get_above(all_items[0])) == 1 @ tower ykb
        true : count(get_box_all_above(all_items[0])) == 2 @ tower ykb
        true : count(get_above(all_items[0])) == 2 @ tower ykb; circle 0,90 small
        true : count(get_below(all_items[2])) == 1 and count(get_box_all_below(all_items[2])) == 2 @ tower ykb""",
    "get_above__includes_items_whose_bottom_equals_the_top": """
        true : exist(get_above(all_items[0])) @ circle 0,50; circle 60,30
        false : exist(get_above(all_items[0])) @ circle 0,50; circle 60,31""",
    "related_words__return_the_union_over_a_collection": """
        true : equal_set(get_above(all_items), all_items[1:]) and get_above(all_items) == set(all_items[1:]) @ tower ykb
        true : count(get_above(filter_color(all_items, Color.BLUE))) == 0 @ tower ykb""",
    "get_img_all_above_and_below__search_all_boxes": """
        true : count(get_img_all_above(all_items[0])) == 1 @ circle 0,50 | circle 0,30; circle 0,31
        true : count(get_img_all_below(all_items[0])) == 1 @ circle 0,30 | circle 0,50; circle 0,49""",
    "box_and_image_neighbours__with_and_without_the_item": """
        true : get_box_inclusive(all_items[0]) == set(all_boxes[0]) @ square 0,0; square 50,0 | square 0,0
        true : get_box_exclusive(all_items[0]) == {all_items[1]} @ square 0,0; square 50,0 | square 0,0
        true : get_img_exclusive(all_items[0]) == {all_items[1], all_items[2]} @ square 0,0; square 50,0 | square 0,0
        true : get_box_exclusive(all_boxes[0]) == set(all_boxes[0]) @ square 0,0; square 50,0 | square 0,0""",
    # Attributes
    "query__one_value_per_item_in_scene_order": """
        true : query_color(all_items) == [Color.YELLOW, Color.BLACK, Color.BLUE] @ THREE
        true : query_shape(set(all_items)) == [Shape.SQUARE, Shape.CIRCLE, Shape.CIRCLE] @ THREE
        true : query_size(all_items[2]) == [Size.SMALL] @ THREE""",
    "all_same__exactly_one_value": """
        true : all_same(query_shape(all_items[1:])) and not all_same(query_shape(all_items)) @ THREE
        false : all_same([]) or all_same_color(all_items) or all_same_attribute(all_items, is_top)
        true : all_same([[Color.BLUE], [Color.BLUE]]) and not all_same([1, 2])
        true : all_same_attribute(all_items[1:], query_shape) @ THREE""",
    "values_of_different_attributes__are_never_equal": """
        false : all_items[0].color == all_items[0].shape or all_items[0].size == 0 @ circle 0,0 small
        false : contained(get_set_colors(all_items), get_set_shapes(all_items)) @ circle 0,0 small""",
    # Comparison and logic
    "comparison_words__require_ints": """
        a must be an int, not a list of 0 : ge(all_items, 1)
        b must be an int, not bool True : equal_int(1, True)
        true : le(1, 1) and ge(1, 1) and lt(1, 2) and gt(2, 1) and equal_int(2, 2)
        false : lt(1, 1) or gt(1, 1) or equal_int(1, 2)""",
    "equal__a_value_equals_the_list_holding_only_it": """
        true : equal(Color.BLUE, [Color.BLUE]) and equal([Color.BLUE, Color.BLUE], Color.BLUE)
        false : equal([Color.BLUE, Color.BLUE], [Color.BLUE]) or equal(Color.BLUE, [])
        true : equal({Color.BLUE, Color.BLACK}, [Color.BLACK, Color.BLUE])
        true : equal(all_boxes[0], all_items) @ THREE""",
    "equal_attribute__requires_values_of_that_attribute": """
        true : equal_color(query_color(all_items[0]), Color.YELLOW) @ THREE
        a must be a Color or collection of Colors : equal_color(Shape.CIRCLE, Color.BLUE)
        b must be a Shape or collection of Shapes : equal_shape(Shape.CIRCLE, [1])
        Size : equal_size(1, Size.BIG)""",
    "logic_words__require_bools_and_evaluate_all_arguments": """
        a must be a bool, not int 1 : AND(1, True)
        b must be a bool, not a list of 0 : OR(True, all_items)
        a must be a bool : NOT(count(all_items))
        unique : AND(False, is_blue(unique(all_items)))
        unique : OR(True, is_blue(unique(all_items)))
        false : False and is_blue(unique(all_items))""",
    "all_and_any__require_true_not_truthy": """
        false : All(all_items, lambda x: 1) or Any(all_items, lambda x: all_items) @ THREE
        true : All(all_items, lambda x: True) and Any(all_items, is_black) @ THREE
        false : All(all_items, lambda x: True) or Any(all_items, lambda x: True)""",
    "all__stops_at_the_first_failure": """
        false : All(all_boxes, lambda b: count(b) == 1 and is_blue(unique(b))) @ square 0,0 | THREE
        false : All(all_boxes, lambda b: is_blue(unique(b))) @ square 0,0 | THREE
        unique : All(all_boxes, lambda b: is_yellow(unique(b))) @ square 0,0 | THREE""",
    "a_box__has_the_truthiness_of_the_list_of_its_items": """
        false : all(all_boxes) @ | square 0,0
        false : exist(filter_obj(all_boxes, lambda b: b))
        true : exist(filter_obj(all_boxes, lambda b: b)) @ | square 0,0
        true : count(filter_obj(all_boxes, lambda b: not b)) == 2 and all([all_boxes[1]]) @ | square 0,0
        true : len(all_boxes[1]) == 0""",
    # Built-ins and operators
    "min__the_first_of_the_smallest_by_key": """
        true : min(all_boxes, key=count) == all_boxes[1] @ THREE
        empty : min(all_items, key=is_top) == 1
        true : min([3, 1, 2]) == 1
        cannot order : min(all_boxes) == all_boxes[0]""",
    "all_builtin__true_when_empty": """
        true : all(all_items) and all([True, 1]) and not all([all_items])""",
    "operators__fail_on_other_types": """
        <: cannot be used with Color.BLUE and Color.BLACK : Color.BLUE < Color.BLACK
        right side is 0 : 1 % 0 == 0
        cannot be used : all_items + 1 == 1
        out of range : is_top(all_items[0])
        only a list can be indexed : is_top(set(all_items)[0]) @ THREE
        element of a set : count({all_items}) == 1
        .is_tower : all_items.is_tower()
        a program must return a bool : count(all_items)""",
}


@pytest.mark.parametrize("rule", RULES)
def test_word(rule):
    for line in RULES[rule].strip().splitlines():
        expected, program = line.strip().split(" : ")
        source, _, shown = program.partition(" @ ")
        found = value(source, scene_of(shown.replace("THREE", THREE)))
        assert found == expected if expected in ("true", "false") else expected in found, line


def holds(source, item):
    return value(source, scene([item])) == "true"


@pytest.mark.parametrize(
    ("word", "margin"), [("is_touching_wall", 0), ("is_closely_touching_wall", 4), ("is_close_to_wall", 8)]
)
def test_walls__margin_is_inclusive(word, margin):
    for inside, side, outside in (
        (circle(margin, 40), "LEFT", circle(margin + 1, 40)),
        (circle(80 - margin, 40), "RIGHT", circle(79 - margin, 40)),
        (circle(40, margin), "TOP", circle(40, margin + 1)),
        (circle(40, 80 - margin), "BOTTOM", circle(40, 79 - margin)),
    ):
        for tested in (f"{word}(all_items[0])", f"{word}(all_items[0], Side.{side})"):
            assert holds(tested, inside)
            assert not holds(tested, outside)
        assert not any(holds(f"{word}(all_items[0], Side.{other})", inside) for other in {"LEFT", "TOP"} - {side})


@pytest.mark.parametrize(
    ("word", "margin"), [("is_touching_corner", 0), ("is_closely_touching_corner", 4), ("is_close_to_corner", 8)]
)
def test_corners__need_exactly_two_walls(word, margin):
    assert holds(f"{word}(all_items[0]) and {word}(all_items[0], Side.LEFT)", circle(margin, margin))
    assert not holds(f"{word}(all_items[0], Side.RIGHT)", circle(margin, margin))
    assert not holds(f"{word}(all_items[0])", circle(margin, margin + 1))
