"""The mask is exact: an action is masked out where, and only where, doing it is invalid."""

from __future__ import annotations

import random
from functools import cache

import numpy as np
import pytest

from lilgym_mp.envs.rules import RULE_SETS, Dynamics, State, make_dynamics
from lilgym_mp.scene import Box, Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.actions import AddItem, RemoveItem
from lilgym_mp.scene.appearances import Grid, InvalidReason, PlacementRules, Scatter, make_appearance
from lilgym_mp.scene.arrays import BoolArray
from tests.stress.mask_exactness import scenes_of, wrong_actions

SCENES = 400
SCATTER = Scatter()
BOX_COLUMNS = (range(5), range(7, 12), range(14, 19))
BY_RULES = pytest.mark.parametrize("rules", RULE_SETS)

Legal = tuple[BoolArray, BoolArray]


@cache
def dynamics_of(appearance: str, rules: str, grid: Grid = SCATTER.grid) -> Dynamics:
    return make_dynamics(make_appearance(appearance, grid), rules)


@cache
def scenes_for(appearance: str, rules: str) -> list[Scene]:
    """The empty scene, start scenes and, nine in ten, scenes from random play under these rules."""
    scenes = scenes_of(dynamics_of(appearance, rules), SCENES, start_share=0.1)
    assert len(scenes) == SCENES
    return scenes


@BY_RULES
def test_tower_mask__is_exact_for_every_action_of_many_scenes(rules: str):
    dynamics = dynamics_of("tower", rules)
    assert not [scene for scene in scenes_for("tower", rules) if wrong_actions(dynamics, scene)]


@BY_RULES
def test_scatter_mask__is_exact_for_every_action_of_some_scenes(rules: str):
    dynamics = dynamics_of("scatter", rules)
    scenes = random.Random(0).sample(scenes_for("scatter", rules), 8)
    assert not [scene for scene in scenes if wrong_actions(dynamics, scene)]


@BY_RULES
def test_scatter_mask__is_exact_for_every_cell_and_footprint_of_many_scenes(rules: str):
    """Validity hangs on the box alone and not on the colour, which the test above holds for every action.

    So each different box of the scenes is tried once, where it was met first: every cell with every shape and
    size in one colour, the next colour each time, and every removal. What that says of a scene's boxes must be what
    the scene's mask says of all 2,661 actions: the same for every colour, nothing on separators, always STOP.
    """
    dynamics = dynamics_of("scatter", rules)
    tried: dict[tuple[Item, ...], Legal] = {}
    for scene in scenes_for("scatter", rules):
        for index, box in enumerate(scene.boxes):
            if box.items not in tried:
                tried[box.items] = tried_in_box(scene, index, dynamics.rules.placement)
        expected = assembled([tried[box.items] for box in scene.boxes])
        assert np.array_equal(dynamics.legal_mask(State(None, scene, 0)), expected)  # type: ignore[arg-type]


def tried_in_box(scene: Scene, box_index: int, rules: PlacementRules) -> Legal:
    """(5, 5, 3, 3) and (5, 5): by column of the box, row, shape and size, whether ADD, and REMOVE, are valid."""
    adds, removes = np.zeros((5, 5, 3, 3), np.bool_), np.zeros((5, 5), np.bool_)
    tries = 0
    for x, column in enumerate(BOX_COLUMNS[box_index]):
        for row in range(5):
            removes[x, row] = SCATTER.apply(scene, RemoveItem(column, row), rules).invalid is None
            for shape in Shape:
                for size in Size:
                    action = AddItem(column, row, shape, Colour(tries % 3), size)
                    adds[x, row, shape, size] = SCATTER.apply(scene, action, rules).invalid is None
                    tries += 1
    return adds, removes


def assembled(by_box: list[Legal]) -> BoolArray:
    """(2661,) the mask of a scene whose boxes are legal as given."""
    adds, removes = np.zeros((19, 5, 3, 3, 3), np.bool_), np.zeros((19, 5), np.bool_)
    for columns, (box_adds, box_removes) in zip(BOX_COLUMNS, by_box, strict=True):
        adds[columns] = box_adds[:, :, :, None, :]
        removes[columns] = box_removes
    return np.concatenate([[True], adds.ravel(), removes.ravel()])


@BY_RULES
@pytest.mark.parametrize(
    ("grid", "scenes", "actions"),
    [((38, 10), 10, 2000), ((76, 20), 10, 2000), ((19, 1), 20, 533), ((95, 4), 10, 2000), ((380, 100), 5, 4000)],
    ids=str,
)
def test_scatter_mask__is_exact_on_other_grids(rules: str, grid: Grid, scenes: int, actions: int):
    chance = random.Random(0)
    dynamics = dynamics_of("scatter", rules, grid)
    numbers = chance.sample(range(dynamics.appearance.action_count), actions)
    for scene in chance.sample(scenes_for("scatter", rules), scenes):
        assert not wrong_actions(dynamics, scene, numbers)


def test_native_mask__counts_the_pixels_of_a_small_scene():
    native = Scatter((380, 100))
    item = Item(40, 40, Shape.SQUARE, Colour.BLUE, Size.MEDIUM)
    mask = native.legal_mask(Scene.empty().with_box(1, Box((item,))), RULE_SETS["paper"].placement)
    removes = mask[native.action_count - 380 * 100 :].reshape(380, 100)
    assert np.argwhere(removes).tolist() == [[140 + x, y] for x in range(40, 60) for y in range(40, 60)]
    small_squares = mask[1 : 1 + 380 * 100 * 27].reshape(380, 100, 3, 3, 3)[:, :, Shape.SQUARE, Colour.BLUE, Size.SMALL]
    # A small square has 91 x 91 places in a box; 29 x 29 of them overlap the medium one in the middle.
    assert [int(small_squares[x : x + 100].sum()) for x in (0, 140, 280)] == [8281, 8281 - 841, 8281]


@BY_RULES
@pytest.mark.parametrize(
    ("appearance", "reasons"),
    [("tower", {"full_tower", "empty_tower"}), ("scatter", set(InvalidReason) - {"full_tower", "empty_tower"})],
)
def test_scenes_tried__include_every_invalid_reason(appearance: str, reasons: set[InvalidReason], rules: str):
    dynamics = dynamics_of(appearance, rules)
    decode, apply = dynamics.appearance.decode, dynamics.appearance.apply
    actions = [decode(number) for number in range(1, dynamics.appearance.action_count)]
    scenes = scenes_for(appearance, rules)[::20]
    met = {apply(scene, action, dynamics.rules.placement).invalid for scene in scenes for action in actions}
    assert met == {None, *reasons}
