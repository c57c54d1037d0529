"""Scatter: what ADD and REMOVE make of small scenes, clause by clause of docs/spec.md, "Legality and effects".

Items are written with the top-left of their bounding square; a cell of the released grid is 20 x 20 pixels.
"""

import pytest

from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.scene import Scene, SceneError, Shape
from lilgym_mp.scene.actions import STOP, ActionError, AddBlock, AddItem, RemoveItem
from lilgym_mp.scene.appearances import InvalidReason, Scatter
from tests.scenes import MEDIUM, SMALL, B, circle, items_of, scene, scene_of, square

PAPER = RULE_SETS["paper"].placement
RELEASE = RULE_SETS["release"].placement
BOTH = pytest.mark.parametrize("rules", [PAPER, RELEASE], ids=["paper", "release"])

SCATTER = Scatter()
PIXELS = Scatter((380, 100))


def put(item, others, rules, box=0):
    """The place where `item`, put at a cell's top-left, comes to rest among `others`, or why it does not."""
    (new,), there = items_of(item), items_of(others)
    before = scene(*[[]] * box, there)
    action = AddItem(7 * box + new.x // 20, new.y // 20, new.shape, new.colour, new.size)
    after, invalid = SCATTER.apply(before, action, rules)
    if invalid is not None:
        assert after is before
        return invalid
    placed = after.boxes[box].items[-1]
    assert after == scene(*[[]] * box, [*there, placed])
    assert placed._replace(x=new.x, y=new.y) == new
    return f"{placed.x},{placed.y}"


def check_put(line):
    """A line has the item, the others, and what comes of it under the paper's and the release's rules."""
    item, others, *expected = map(str.strip, line.split("|"))
    assert [put(item, others, rules) for rules in (PAPER, RELEASE)] == expected, line


ADD = {
    "crossing_the_right_or_bottom_border_is_invalid": """
        circle 80,0 large    | | out_of_box | out_of_box
        square 0,80 large    | | out_of_box | out_of_box
        triangle 80,80 large | | out_of_box | out_of_box
        triangle 80,80       | | 80,80      | 80,80""",
    "touching_borders_is_no_overlap": """
        square 20,20 | square 0,20; square 40,20; square 20,0; square 20,40 | 20,20 | 20,20""",
    # The circle's centre is (31, 31), 15.6 pixels from the square's corner (20, 20), its radius 15. The triangle's
    # right side runs from (30, 20) to (40, 40), past the square's corner (35, 30).
    "overlap_is_of_the_true_shapes_not_of_their_bounding_squares": """
        square 0,0     | circle 16,16 large | 0,0   | 0,0
        triangle 20,20 | square 35,20 small | 20,20 | 20,20""",
    "searches_rows_from_top_to_bottom_before_columns_from_left_to_right": """
        square 0,0 small | square 0,0 small                    | 0,10 | overlap
        square 0,0 small | square 0,0 small; square 0,10 small | 10,0 | overlap""",
    # The blocker spans the cell's width and leaves free what starts 15 or more pixels below the cell's top: there 10 x
    # 5 of the small square's 100 pixels lie in the cell; of the triangle's 200 it is 112.5, where 14 rows would be 98;
    # of the medium square half of both; of the large one never half, but half of the cell is covered.
    "finds_places_with_half_of_the_item_in_the_cell_or_half_of_the_cell_covered": """
        square 0,20 small | square 0,15 | 0,35    | overlap
        square 0,20 small | square 0,16 | overlap | overlap
        triangle 0,20     | square 0,5  | 0,25    | overlap
        triangle 0,20     | square 0,6  | overlap | overlap
        square 0,20       | square 0,10 | 0,30    | overlap
        square 0,20       | square 0,11 | overlap | overlap
        square 0,20 large | square 0,10 | 0,30    | overlap
        square 0,20 large | square 0,11 | overlap | overlap""",
    # In the cell at (80, 0) a medium item has room at x = 80 only; row 20 is no longer in the cell.
    "finds_places_inside_the_box": """
        square 80,0 | square 85,0 small; square 80,19 small | overlap | overlap""",
    # Found is (20, 61), a fraction of a pixel from the square; the nearest points round to one pixel in x.
    "snaps_at_a_found_place_too": """
        circle 20,60 | square 34,51 small | 21,61 | overlap""",
    "snaps_over_four_pixels": """
        square 40,40 | square 60,40 | 40,40 | 40,40
        square 40,40 | square 61,40 | 41,40 | 41,40
        square 40,40 | square 64,40 | 44,40 | 44,40
        square 40,40 | square 65,40 | 40,40 | 40,40
        square 40,40 | square 40,16 | 40,36 | 40,36""",
    # From corner (60, 60) to corner (64, 62): 4.47 pixels, 4 when truncated; to (64, 63) it is 5.
    "snaps_over_truncated_distances": """
        square 40,40 | square 64,62 | 44,42 | 44,42
        square 40,40 | square 64,63 | 40,40 | 40,40""",
    # The first is 2.24 pixels away, the other 2.
    "snaps_to_the_first_of_equal_truncated_distances": """
        square 40,40 | square 62,61; square 18,40 | 42,41 | 42,41
        square 40,40 | square 18,40; square 62,61 | 38,40 | 38,40""",
    # The triangle's left side from (55, 0) to (40, 30) is nearest to (40, 24) at (42.4, 25.2): truncated (42, 25).
    "snaps_by_truncated_nearest_points": """
        triangle 40,20 large | square 30,34 small | 38,19 | 38,19""",
    "snaps_to_no_other_after_a_refusal": """
        circle 60,60 small | square 29,31 large                       | 59,59 | 59,59
        circle 60,60 small | triangle 65,68 small; square 29,31 large | 60,60 | 61,61""",
}


@pytest.mark.parametrize("rule", ADD)
def test_add(rule):
    for line in ADD[rule].strip().splitlines():
        check_put(line)


def test_overlap_at_the_corner__searches_the_cell_under_paper_and_is_invalid_under_release():
    check_put("square 0,0 small | square 0,0 small | 0,10 | overlap")


def test_snap_out_of_the_box__is_refused_under_paper_and_made_under_release():
    check_put("triangle 40,0 large | square 30,14 small | 40,0 | 38,-1")


def test_snap_into_another__is_refused_under_paper_and_made_under_release():
    check_put("square 60,20 small | circle 40,25 | 60,20 | 58,20")


def test_snap__depends_on_the_box_under_release_only():
    for rules, places in ((PAPER, ["43,38"] * 3), (RELEASE, ["43,38", "43,39", "43,38"])):
        assert [put("circle 40,40", "circle 62,26 large", rules, box) for box in range(3)] == places


REMOVE = {  # cell, items before, and after, or why it is invalid
    # 100 and 50 square pixels of the cell at (20, 20)
    "removes_the_item_that_covers_most_of_the_cell": """
        1,1 | square 0,0 large; square 35,20 small | square 35,20 small
        1,1 | square 35,20 small; square 0,0 large | square 35,20 small""",
    # Of the cell at (0, 0) the triangle's bounding square covers 100, the triangle itself 25, the square 80.
    "counts_the_true_area_not_the_bounding_square": """
        0,0 | triangle 10,10; square 0,12 small | triangle 10,10
        0,0 | square 0,12 small; triangle 10,10 | triangle 10,10""",
    # Their right and left halves lie in the cell at (20, 0).
    "removes_the_first_of_equal_areas": """
        1,0 | circle 10,0; circle 30,0 | circle 30,0
        1,0 | circle 30,0; circle 10,0 | circle 10,0""",
    "of_a_cell_that_is_only_touched_has_nothing_to_remove": """
        0,0 | square 20,0; square 0,20 | nothing_to_remove
        0,0 | circle 16,16 large       | nothing_to_remove
        0,0 |                          | nothing_to_remove""",
}


@BOTH
@pytest.mark.parametrize("rule", REMOVE)
def test_remove(rule, rules):
    for line in REMOVE[rule].strip().splitlines():
        cell, before, after = map(str.strip, line.split("|"))
        there = scene_of(before)
        edit = SCATTER.apply(there, RemoveItem(*map(int, cell.split(","))), rules)
        assert edit == ((there, after) if "_" in after else (scene_of(after), None)), line


# Other grids


@BOTH
def test_native_add__does_not_search(rules):
    before = scene([square(0, 0, SMALL)])
    edit = PIXELS.apply(before, AddItem(9, 9, Shape.SQUARE, B, SMALL), rules)
    assert edit == (before, InvalidReason.OVERLAP)
    assert PIXELS.apply(before, AddItem(9, 10, Shape.SQUARE, B, SMALL), rules).invalid is None


def test_native_add__separator_and_border():
    for x, reason in ((80, None), (81, "out_of_box"), (100, "separator"), (139, "separator"), (140, None)):
        assert PIXELS.apply(scene(), AddItem(x, 0, Shape.CIRCLE, B, MEDIUM), PAPER).invalid == reason


def test_fine_grid__searches_its_own_cell():
    fine, small = Scatter((38, 10)), AddItem(0, 0, Shape.SQUARE, B, SMALL)
    found = fine.apply(scene_of("square 0,-5 small"), small, PAPER)
    assert found.scene == scene_of("square 0,-5 small; square 0,5 small blue")
    blocked = fine.apply(scene_of("square 0,-4 small"), small, PAPER)
    assert blocked.invalid is InvalidReason.OVERLAP  # only 40 of 100 square pixels would lie in the cell


# What is no scene or no action


@pytest.mark.parametrize(
    ("items", "message"),
    [
        ("circle 0,0; circle 81,0", r"item 1 at \(81, 0\), 20 pixels wide, lies outside its box"),
        ("circle 0,-1", r"item 0 at \(0, -1\), 20 pixels wide, lies outside its box"),
        ("circle 0,0; circle 50,50; square 60,60", r"item 2 at \(60, 60\) overlaps an earlier item of its box"),
    ],
)
def test_check_scene__items_outside_or_overlapping_are_refused_naming_box_and_item(items, message):
    with pytest.raises(SceneError, match=f"^box 1: {message}$"):
        SCATTER.check_scene(scene([circle(0, 0)], items_of(items)))


@pytest.mark.parametrize("action", [STOP, AddBlock(0, B)])
def test_apply__anything_but_an_edit_of_scatter_raises_action_error(action):
    with pytest.raises(ActionError, match="is not an edit of scatter"):
        SCATTER.apply(Scene.empty(), action, PAPER)
