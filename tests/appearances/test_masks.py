"""The mask is exact: an action is masked out where, and only where, doing it is invalid."""

import random
from functools import cache

import pytest

from lilgym_mp.envs.rules import RULE_SETS, make_dynamics
from lilgym_mp.scene import Box, Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.appearances import RELEASED_GRID, Scatter, make_appearance
from tests.stress.mask_exactness import scenes_of, wrong_actions

SCENES = 40
BY_RULES = pytest.mark.parametrize("rules", RULE_SETS)


@cache
def dynamics_of(appearance, rules, grid=RELEASED_GRID):
    return make_dynamics(make_appearance(appearance, grid), rules)


@cache
def scenes_for(appearance, rules):
    """The empty scene, start scenes and, nine in ten, scenes from random play under these rules."""
    scenes = scenes_of(dynamics_of(appearance, rules), SCENES, start_share=0.1)
    assert len(scenes) == SCENES
    return scenes


@BY_RULES
@pytest.mark.parametrize(("appearance", "count"), [("tower", SCENES), ("scatter", 6)])
def test_mask__is_exact_for_every_action(appearance, count, rules):
    dynamics = dynamics_of(appearance, rules)
    scenes = random.Random(0).sample(scenes_for(appearance, rules), count)
    assert not [scene for scene in scenes if wrong_actions(dynamics, scene)]


@BY_RULES
@pytest.mark.parametrize(
    ("grid", "scenes", "actions"),
    [((38, 10), 4, 1500), ((19, 1), 10, 533), ((95, 4), 4, 1500), ((380, 100), 3, 3000)],
    ids=str,
)
def test_scatter_mask__is_exact_on_other_grids(rules, grid, scenes, actions):
    chance = random.Random(0)
    dynamics = dynamics_of("scatter", rules, grid)
    numbers = chance.sample(range(dynamics.appearance.action_count), actions)
    for scene in chance.sample(scenes_for("scatter", rules), scenes):
        assert not wrong_actions(dynamics, scene, numbers)


def test_native_mask__counts_the_pixels_of_a_small_scene():
    native = Scatter((380, 100))
    item = Item(40, 40, Shape.SQUARE, Colour.BLUE, Size.MEDIUM)
    mask = native.legal_mask(Scene.empty().with_box(1, Box((item,))), RULE_SETS["paper"].placement)
    small_squares = mask[1 : 1 + 380 * 100 * 27].reshape(380, 100, 3, 3, 3)[:, :, Shape.SQUARE, Colour.BLUE, Size.SMALL]
    # A small square has 91 x 91 places in a box; 29 x 29 of them overlap the medium one in the middle.
    assert [int(small_squares[x : x + 100].sum()) for x in (0, 140, 280)] == [8281, 8281 - 841, 8281]
