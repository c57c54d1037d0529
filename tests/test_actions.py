"""Actions: indices, the released array form, and invalid values."""

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lilgym_mp.scene import Colour, Shape, Size
from lilgym_mp.scene.actions import STOP, ActionError, AddBlock, AddItem, RemoveItem, describe, named
from lilgym_mp.scene.appearances import Scatter, Tower

TOWER = Tower()
SCATTER = Scatter()
PIXELS = Scatter((380, 100))
GRIDS = [(19, 5), (19, 1), (95, 4), (380, 100)]


def all_or_sampled(appearance):
    """The indices of all actions, or the first and last of each type and 3,000 others."""
    count = appearance.action_count
    first_remove = 1 + (count - 1) // 28 * 27  # in Scatter
    return {*range(0, count, 1 + count // 3_000), 1, first_remove - 1, first_remove, count - 1}


@pytest.mark.parametrize("appearance", [TOWER, *map(Scatter, GRIDS)], ids=str)
def test_actions__are_recovered_from_indices_arrays_and_names(appearance):
    for index in all_or_sampled(appearance):
        action = appearance.decode(index)
        assert appearance.encode(action) == index
        assert appearance.from_array(appearance.to_array(action)) == action
        assert named(describe(action)) == action


@pytest.mark.parametrize("grid", GRIDS, ids=str)
def test_scatter_indices__stop_then_adds_by_cell_shape_colour_size_then_removes(grid):
    columns, rows = grid
    scatter = Scatter(grid)
    assert scatter.decode(0) == STOP
    for x, y in ((0, 0), (1, 0), (columns // 2, rows // 2), (columns - 1, rows - 1)):
        cell = x * rows + y
        assert scatter.decode(1 + columns * rows * 27 + cell) == RemoveItem(x, y)
        for index, kind in enumerate(product(Shape, Colour, Size), 1 + cell * 27):
            assert scatter.decode(index) == AddItem(x, y, *kind)


@pytest.mark.parametrize(
    ("appearance", "values", "action"),
    [
        (TOWER, "0 -1 -1", "STOP"),
        (TOWER, "1 2 0", "ADD(RIGHT, YELLOW)"),
        (TOWER, "2 1 -1", "REMOVE(MIDDLE)"),
        (SCATTER, "0 -1 -1 -1 -1 -1", "STOP"),
        (SCATTER, "1 18 4 2 1 0", "ADD(18, 4, TRIANGLE, BLACK, SMALL)"),
        (SCATTER, "2 7 0 -1 -1 -1", "REMOVE(7, 0)"),
        (PIXELS, "2 379 99 -1 -1 -1", "REMOVE(379, 99)"),
    ],
)
def test_array_form__is_converted_both_ways(appearance, values, action):
    array = [*map(int, values.split())]
    assert describe(appearance.from_array(array)) == action
    assert appearance.to_array(named(action)) == array


@pytest.mark.parametrize(
    ("appearance", "values", "message"),
    [
        (TOWER, [1, 0], r"3 whole numbers \[type, box, colour\], not \[1, 0\]"),
        (TOWER, [1.0, 0, 0], r"3 whole numbers .*, not \[1\.0, 0"),
        (TOWER, [True, False, False], "3 whole numbers"),
        (TOWER, [3, 0, 0], r"type 3 .*; choose from 0 \.\. 2"),
        (TOWER, [1, 0, -1], "colour -1 "),
        (SCATTER, [1, 19, 0, 0, 0, 0], r"x 19 .*; choose from 0 \.\. 18"),
        (SCATTER, [2, 0, 5, 0, 0, 0], r"y 5 .*; choose from 0 \.\. 4"),
    ],
)
def test_array_form__an_invalid_array_is_refused_with_slot_and_choices(appearance, values, message):
    with pytest.raises(ActionError, match=message):
        appearance.from_array(values)


@given(st.lists(st.integers(-3, 20) | st.floats() | st.none() | st.text(max_size=2), max_size=8))
def test_array_form__any_list_is_an_action_or_raises_action_error(values):
    for appearance in (TOWER, SCATTER):
        try:
            action = appearance.from_array(values)
        except ActionError:
            continue
        assert appearance.decode(appearance.encode(action)) == action


@pytest.mark.parametrize(
    ("appearance", "action"),
    [
        (TOWER, RemoveItem(0, 0)),
        (TOWER, AddBlock(3, Colour.BLUE)),
        (TOWER, "STOP"),
        (SCATTER, AddBlock(0, Colour.BLUE)),
        (SCATTER, RemoveItem(19, 0)),
    ],
)
def test_encode__an_action_of_another_appearance_is_refused(appearance, action):
    with pytest.raises(ActionError):
        appearance.encode(action)
