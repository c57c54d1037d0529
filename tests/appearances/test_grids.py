"""Scatter's grids: which tile the boxes and separators, and what is said of those that do not."""

from itertools import product

import pytest

from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import RemoveItem
from lilgym_mp.scene.appearances import (
    GridError,
    InvalidReason,
    Scatter,
    checked_grid,
    make_appearance,
)

COLUMNS = (19, 38, 76, 95, 190, 380)
ROWS = (1, 2, 4, 5, 10, 20, 25, 50, 100)
PLACEMENT = RULE_SETS["paper"].placement


def test_grid__every_documented_one_tiles_the_image():
    for columns, rows in product(COLUMNS, ROWS):
        scatter = Scatter((columns, rows))
        width, height = scatter.cell
        assert (width * columns, height * rows) == (380, 100)
        assert scatter.action_count == 1 + 28 * columns * rows
        separators = [
            column
            for column in range(columns)
            if scatter.apply(Scene.empty(), RemoveItem(column, 0), PLACEMENT).invalid is InvalidReason.SEPARATOR
        ]
        pixels = [x for column in separators for x in range(column * width, (column + 1) * width)]
        assert pixels == [*range(100, 140), *range(240, 280)]


def test_grid__columns_that_straddle_a_separator_are_refused_with_the_choices():
    for columns in set(range(1, 400)) - set(COLUMNS):
        with pytest.raises(GridError) as fault:
            checked_grid((columns, 5))
        assert str(fault.value) == (
            f"grid {columns} x 5: with {columns} columns cells would straddle a separator;"
            " choose from 19, 38, 76, 95, 190, 380 columns"
        )


@pytest.mark.parametrize("rows", [3, 6, 7, 30, 99, 101, 200])
def test_grid__rows_that_do_not_divide_the_height_are_refused_with_the_choices(rows):
    with pytest.raises(GridError, match=rf"{rows} rows do not divide 100 pixels; choose from 1, 2, 4, 5, 10, 20, 25, "):
        Scatter((19, rows))


@pytest.mark.parametrize(
    "grid", [None, 19, "pixels", (19,), (19, 5, 1), (19.0, 5), ("19", "5"), (0, 5), (-19, 5), (19, True), {19, 5}]
)
def test_grid__anything_but_a_pair_of_integers_is_refused(grid):
    with pytest.raises(GridError) as fault:
        make_appearance("scatter", grid)
    assert str(fault.value).startswith("grid must be 'native' or a pair (columns, rows) of positive whole numbers, not")
    assert repr(grid) in str(fault.value)
