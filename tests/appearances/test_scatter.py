"""Scatter: what ADD and REMOVE make of small scenes, clause by clause of docs/spec.md, "Legality and effects".

Items are written with the top-left of their bounding square; a cell of the released grid is 20 x 20 pixels.
"""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.scene import Box, Item, Scene, SceneError, Shape
from lilgym_mp.scene.actions import STOP, Action, ActionError, AddBlock, AddItem, RemoveItem
from lilgym_mp.scene.appearances import InvalidReason, PlacementRules, Scatter
from tests.scenes import LARGE, MEDIUM, SMALL, B, circle, scene, square, triangle

PAPER = RULE_SETS["paper"].placement
RELEASE = RULE_SETS["release"].placement
BOTH = pytest.mark.parametrize("rules", [PAPER, RELEASE], ids=["paper", "release"])

SCATTER = Scatter()
PIXELS = Scatter((380, 100))


def put(item: Item, others: Sequence[Item], rules: PlacementRules, box: int = 0) -> Item | InvalidReason:
    """Where `item`, whose place is a cell's top-left pixel, comes to rest among `others`, or why it does not."""
    before = _only(box, others)
    action = AddItem(7 * box + item.x // 20, item.y // 20, item.shape, item.colour, item.size)
    after, invalid = SCATTER.apply(before, action, rules)
    if invalid is not None:
        assert after is before
        return invalid
    *old, new = after.boxes[box].items
    assert old == list(others)
    assert _only(box, [*old, new]) == after
    return new


def _only(box: int, items: Sequence[Item]) -> Scene:
    return Scene.empty().with_box(box, Box(tuple(items)))


def left_after_remove(
    cell: tuple[int, int], items: Sequence[Item], scatter: Scatter = SCATTER, rules: PlacementRules = PAPER
) -> list[Item] | InvalidReason:
    """The left box's items after REMOVE in a cell, or why it is invalid."""
    before = scene(items)
    after, invalid = scatter.apply(before, RemoveItem(*cell), rules)
    assert (after is before) == (invalid is not None)
    return invalid or list(after.boxes[0].items)


# Separators and borders


@BOTH
@pytest.mark.parametrize(("x", "y"), [(80, 0), (0, 80), (80, 80)])
def test_add__crossing_the_right_or_bottom_border_is_invalid(x: int, y: int, rules: PlacementRules):
    for shape in (circle, square, triangle):
        assert put(shape(x, y, LARGE), [], rules) is InvalidReason.OUT_OF_BOX
        assert put(shape(x, y, MEDIUM), [], rules) == shape(x, y, MEDIUM)


# Overlap


@BOTH
def test_overlap__touching_borders_is_none(rules: PlacementRules):
    around = [square(0, 20), square(40, 20), square(20, 0), square(20, 40)]
    assert put(square(20, 20), around, rules) == square(20, 20)


@BOTH
def test_overlap__is_of_the_true_shapes_not_of_their_bounding_squares(rules: PlacementRules):
    # The circle's centre is (31, 31), 15.6 pixels from the square's corner (20, 20), its radius 15.
    assert put(square(0, 0), [circle(16, 16, LARGE)], rules) == square(0, 0)
    # The triangle's right side runs from (30, 20) to (40, 40), past the square's corner (35, 30).
    assert put(triangle(20, 20), [square(35, 20, SMALL)], rules) == triangle(20, 20)


def test_overlap_at_the_corner__searches_the_cell_under_paper_and_is_invalid_under_release():
    assert put(square(0, 0, SMALL), [square(0, 0, SMALL)], PAPER) == square(0, 10, SMALL)
    assert put(square(0, 0, SMALL), [square(0, 0, SMALL)], RELEASE) is InvalidReason.OVERLAP


# The search


def test_search__rows_from_top_to_bottom_before_columns_from_left_to_right():
    assert put(square(0, 0, SMALL), [square(0, 0, SMALL)], PAPER) == square(0, 10, SMALL)
    assert put(square(0, 0, SMALL), [square(0, 0, SMALL), square(0, 10, SMALL)], PAPER) == square(10, 0, SMALL)


@pytest.mark.parametrize(
    ("item", "last"),
    [
        (square(0, 20, SMALL), 15),  # 10 x 5 of 100 square pixels lie in the cell: half of the item
        (triangle(0, 20, MEDIUM), 5),  # its upper 15 rows, 112.5 of 200, lie in the cell; 14 rows would be 98
        (square(0, 20, MEDIUM), 10),  # 20 x 10 of 400: half of both
        (square(0, 20, LARGE), 10),  # 20 x 10: never half of the item, but half of the cell
    ],
    ids=str,
)
def test_search__half_of_the_item_in_the_cell_or_half_of_the_cell_covered(item: Item, last: int):
    # The blocker spans the cell's width and leaves free what starts `last` or more pixels below the cell's top.
    assert put(item, [square(0, last)], PAPER) == item._replace(y=20 + last)
    assert put(item, [square(0, last + 1)], PAPER) is InvalidReason.OVERLAP


def test_search__positions_lie_inside_the_box():
    # In the cell at (80, 0) a medium item has room at x = 80 only; row 20 is no longer in the cell.
    assert put(square(80, 0), [square(85, 0, SMALL), square(80, 19, SMALL)], PAPER) is InvalidReason.OVERLAP


def test_search__a_found_position_is_snapped_too():
    # Found is (20, 61), a fraction of a pixel from the square; the nearest points round to one pixel in x.
    assert put(circle(20, 60), [square(34, 51, SMALL)], PAPER) == circle(21, 61)


# Snapping


@BOTH
@pytest.mark.parametrize("gap", [0, 1, 2, 3, 4])
def test_snap__reaches_four_pixels(gap: int, rules: PlacementRules):
    assert put(square(40, 40), [square(60 + gap, 40)], rules) == square(40 + gap, 40)
    assert put(square(40, 40), [square(40, 20 - gap)], rules) == square(40, 40 - gap)


@BOTH
def test_snap__distance_is_truncated(rules: PlacementRules):
    # From corner (60, 60) to corner (64, 62): 4.47 pixels, 4 when truncated; to (64, 63) it is 5.
    assert put(square(40, 40), [square(64, 62)], rules) == square(44, 42)
    assert put(square(40, 40), [square(64, 63)], rules) == square(40, 40)


@BOTH
def test_snap__goes_to_the_first_of_equal_truncated_distances(rules: PlacementRules):
    diagonal, straight = square(62, 61), square(18, 40)  # 2.24 and 2 pixels away
    assert put(square(40, 40), [diagonal, straight], rules) == square(42, 41)
    assert put(square(40, 40), [straight, diagonal], rules) == square(38, 40)


@BOTH
def test_snap__nearest_points_are_truncated_before_the_move(rules: PlacementRules):
    # The triangle's left side from (55, 0) to (40, 30) is nearest to (40, 24) at (42.4, 25.2): truncated (42, 25).
    assert put(triangle(40, 20, LARGE), [square(30, 34, SMALL)], rules) == triangle(38, 19, LARGE)


def test_snap_out_of_the_box__is_refused_under_paper_and_made_under_release():
    assert put(triangle(40, 0, LARGE), [square(30, 14, SMALL)], PAPER) == triangle(40, 0, LARGE)
    assert put(triangle(40, 0, LARGE), [square(30, 14, SMALL)], RELEASE) == triangle(38, -1, LARGE)


def test_snap_into_another__is_refused_under_paper_and_made_under_release():
    assert put(square(60, 20, SMALL), [circle(40, 25)], PAPER) == square(60, 20, SMALL)
    assert put(square(60, 20, SMALL), [circle(40, 25)], RELEASE) == square(58, 20, SMALL)


def test_snap__is_not_tried_again_after_a_refusal():
    nearest, second = triangle(65, 68, SMALL), square(29, 31, LARGE)
    assert put(circle(60, 60, SMALL), [second], PAPER) == circle(59, 59, SMALL)
    assert put(circle(60, 60, SMALL), [nearest, second], PAPER) == circle(60, 60, SMALL)
    assert put(circle(60, 60, SMALL), [nearest, second], RELEASE) == circle(61, 61, SMALL)


def test_snap__depends_on_the_box_under_release_only():
    places = {
        rules: [put(circle(40, 40), [circle(62, 26, LARGE)], rules, box) for box in range(3)]
        for rules in (PAPER, RELEASE)
    }
    assert places[PAPER] == [circle(43, 38)] * 3
    assert places[RELEASE] == [circle(43, 38), circle(43, 39), circle(43, 38)]


# REMOVE


@BOTH
def test_remove__removes_the_item_that_covers_most_of_the_cell(rules: PlacementRules):
    large, small = square(0, 0, LARGE), square(35, 20, SMALL)  # 100 and 50 square pixels of the cell at (20, 20)
    for items in ([large, small], [small, large]):
        assert left_after_remove((1, 1), items, rules=rules) == [small]


@BOTH
def test_remove__the_true_area_counts_not_the_bounding_square(rules: PlacementRules):
    # Of the cell at (0, 0) the triangle's bounding square covers 100, the triangle itself 25, the square 80.
    pointed, small = triangle(10, 10), square(0, 12, SMALL)
    for items in ([pointed, small], [small, pointed]):
        assert left_after_remove((0, 0), items, rules=rules) == [pointed]


@BOTH
def test_remove__removes_the_first_of_equal_areas(rules: PlacementRules):
    one, other = circle(10, 0), circle(30, 0)  # their right and left halves lie in the cell at (20, 0)
    assert left_after_remove((1, 0), [one, other], rules=rules) == [other]
    assert left_after_remove((1, 0), [other, one], rules=rules) == [one]


@BOTH
def test_remove__a_cell_that_is_only_touched_has_nothing_to_remove(rules: PlacementRules):
    assert left_after_remove((0, 0), [square(20, 0), square(0, 20)], rules=rules) is InvalidReason.NOTHING_TO_REMOVE
    assert left_after_remove((0, 0), [circle(16, 16, LARGE)], rules=rules) is InvalidReason.NOTHING_TO_REMOVE
    assert left_after_remove((0, 0), [], rules=rules) is InvalidReason.NOTHING_TO_REMOVE


# Native resolution


@BOTH
def test_native_add__does_not_search(rules: PlacementRules):
    before = scene([square(0, 0, SMALL)])
    edit = PIXELS.apply(before, AddItem(9, 9, Shape.SQUARE, B, SMALL), rules)
    assert edit == (before, InvalidReason.OVERLAP)
    assert PIXELS.apply(before, AddItem(9, 10, Shape.SQUARE, B, SMALL), rules).invalid is None


@BOTH
def test_native_add__separator_and_border(rules: PlacementRules):
    for x, reason in ((80, None), (81, "out_of_box"), (99, "out_of_box"), (100, "separator"), (139, "separator")):
        assert PIXELS.apply(scene(), AddItem(x, 0, Shape.CIRCLE, B, MEDIUM), rules).invalid == reason
    assert PIXELS.apply(scene(), AddItem(140, 0, Shape.CIRCLE, B, MEDIUM), rules).invalid is None


# Other grids


def test_fine_grid__searches_its_own_cell():
    fine = Scatter((38, 10))
    others = [square(0, -5, SMALL)]
    assert fine.apply(scene(others), AddItem(0, 0, Shape.SQUARE, B, SMALL), PAPER).scene == scene(
        [*others, square(0, 5, SMALL, B)]
    )
    blocked = fine.apply(scene([square(0, -4, SMALL)]), AddItem(0, 0, Shape.SQUARE, B, SMALL), PAPER)
    assert blocked.invalid is InvalidReason.OVERLAP  # only 40 of 100 square pixels would lie in the cell


# What is no scene or no action


@pytest.mark.parametrize(
    ("items", "message"),
    [
        ([circle(0, 0), circle(81, 0)], r"item 1 at \(81, 0\), 20 pixels wide, lies outside its box"),
        ([circle(0, -1)], r"item 0 at \(0, -1\), 20 pixels wide, lies outside its box"),
        ([circle(0, 0), circle(50, 50), square(60, 60)], r"item 2 at \(60, 60\) overlaps an earlier item of its box"),
    ],
)
def test_check_scene__items_outside_or_overlapping_are_refused_naming_box_and_item(items: list[Item], message: str):
    with pytest.raises(SceneError, match=f"^box 1: {message}$"):
        SCATTER.check_scene(scene([circle(0, 0)], items))


@pytest.mark.parametrize("action", [STOP, AddBlock(0, B)])
def test_apply__anything_but_an_edit_of_scatter_raises_action_error(action: Action):
    with pytest.raises(ActionError, match=r"is not an edit of scatter"):
        SCATTER.apply(scene(), action, PAPER)
