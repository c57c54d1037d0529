"""Masks of batches equal the appearance's in every state, from any start scene."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lilgym_mp.envs.cores.scatter import ScatterCore
from lilgym_mp.envs.rules import RULE_SETS, make_dynamics
from lilgym_mp.scene import Box, Scene
from lilgym_mp.scene.appearances import Scatter
from tests.envs.test_cores import CoreUnderTest, tasks_of
from tests.scenes import scatter_boxes, unchecked_boxes

GRIDS = [(19, 5), (38, 10), (95, 4), (38, 1), (76, 50)]


def assert_masks_are_exact(scenes: Sequence[Scene], grid: tuple[int, int], rules: str) -> None:
    """Begins the scenes one after another in the same environment, again and again, and edits some on the way."""
    dynamics = make_dynamics(Scatter(grid), rules)
    side = CoreUnderTest(ScatterCore, dynamics, tasks_of(list(scenes)))

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


@settings(max_examples=40)
@given(
    grid=st.sampled_from(GRIDS),
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
