"""Masks of batches equal the appearance's in every state, from any start scene."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lilgym_mp.appearances import Scatter
from lilgym_mp.appearances.legality import allowed_corners
from lilgym_mp.appearances.placement import is_free
from lilgym_mp.envs.cores.cell_places import cell_places
from lilgym_mp.envs.cores.scatter import ScatterCore
from lilgym_mp.rules import RULE_SETS, make_dynamics
from lilgym_mp.scene import BOX_SIDE, Box, Item, Scene
from tests.envs.alike import random_actions
from tests.envs.test_cores import Side, task_set
from tests.scenes import LARGE, SMALL, circle, scatter_boxes, scene, square, triangle, unchecked_boxes

GRIDS = [(19, 5), (38, 10), (95, 4), (19, 2), (38, 1), (76, 50)]
BY_RULES = pytest.mark.parametrize("rules", RULE_SETS)


def assert_masks_are_exact(scenes: Sequence[Scene], grid: tuple[int, int], rules: str) -> None:
    """Begins the scenes one after another in the same environment, again and again, and edits some on the way."""
    dynamics = make_dynamics(Scatter(grid), rules)
    side = Side(ScatterCore, dynamics, task_set(list(scenes)))

    def is_exact() -> bool:
        side.core.write_masks()
        return np.array_equal(side.buffers.mask[0], dynamics.legal_mask(side.core.state(0)))

    for visit, task in product(range(3), range(len(scenes))):
        side.core.start(np.array([0]), np.array([task]))
        if visit:  # the first time, masks are asked for after an edit alone
            assert is_exact()
        edits = np.flatnonzero(dynamics.appearance.legal_mask(scenes[task], dynamics.rules.placement))[-2:]
        for action in (0, *edits) if visit else (*edits, 0):
            side.buffers.action[:] = action
            side.core.step(np.array([0]))
            assert is_exact()


@BY_RULES
@pytest.mark.parametrize("grid", GRIDS, ids=str)
def test_masks__are_exact_for_literal_boxes(grid: tuple[int, int], rules: str) -> None:
    items = (circle(40, 40), square(0, 0, LARGE), triangle(70, 70, LARGE), square(90, 0, SMALL), circle(13, 57, SMALL))
    assert_masks_are_exact([scene([], items[:count], []) for count in (5, 3, 4, 0, 1)], grid, rules)


@settings(max_examples=50)
@given(
    grid=st.sampled_from(GRIDS[:3]),
    rules=st.sampled_from(list(RULE_SETS)),
    boxes=st.lists(scatter_boxes(), min_size=4, max_size=4),
    unchecked=unchecked_boxes,
)
def test_masks__are_exact_for_random_scenes(
    grid: tuple[int, int], rules: str, boxes: list[Box], unchecked: Box
) -> None:
    one, two, three, four = boxes
    scenes = [
        Scene((one, two, three)),
        Scene((unchecked, two, three)),
        Scene((one, unchecked, four)),
        Scene((four, two, one)),
    ]
    assert_masks_are_exact(scenes, grid, rules)


def test_masks__ignore_items_outside_the_box() -> None:
    outside: list[Item] = [circle(0, -10, SMALL), square(100, 50), triangle(-40, -40)]
    assert_masks_are_exact([scene(), *(scene([item]) for item in outside), scene()], (19, 5), "release")


@pytest.mark.parametrize("grid", GRIDS, ids=str)
def test_cell_places__bits_equal_the_free_positions_and_uncovered_parts(grid: tuple[int, int]) -> None:
    cell = Scatter(grid).cell
    places = cell_places(*cell, searches=True)
    there = square(37, 44, LARGE)
    width, height = cell[0], places.part_height
    kept = np.zeros_like(places.empty)
    for part, index in np.ndindex(places.empty.shape[:2]):
        column, row = divmod(index, BOX_SIDE // cell[1])
        dx = column * width - there.x + places.offset[0]
        dy = row * cell[1] + part * height - there.y + places.offset[1]
        near = 0 <= dx < places.kept_index.shape[1] and 0 <= dy < places.kept_index.shape[2]
        kept[part, index] = places.kept[places.kept_index[there.footprint, dx, dy] if near else 0]
    free = sum(
        is_free(footprint, x, y, [there])
        for footprint, x, y in np.argwhere(allowed_corners(*cell, searches=True)).tolist()
    )
    covered = [
        (x, y)
        for x, y in product(range(0, BOX_SIDE, width), range(0, BOX_SIDE, height))
        if x < 67 and x + width > 37 and y < 74 and y + height > 44
    ]
    uncovered = places.empty[..., 0].size - len(covered)
    assert int(np.bitwise_count(places.empty & kept).sum()) == free + uncovered


@BY_RULES
def test_action_masks__of_a_batch_are_exact_throughout_long_random_play(rules: str) -> None:
    env: Any = gym.make_vec("lilgym_mp/ScatterFlipIt-v0", num_envs=64, rules=rules)
    env.reset(seed=0)
    generator = np.random.default_rng(0)
    for step in range(150):
        masks = env.action_masks()
        if step % 10 == 9:
            for mask, state in zip(masks, env.states(), strict=True):
                assert np.array_equal(mask, env.dynamics.legal_mask(state))
        env.step(random_actions(masks, generator))
    env.close()
