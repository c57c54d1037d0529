"""Masks of batches equal the appearance's in every state, from any start scene."""

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lilgym_mp.envs.rules import RULE_SETS, make_dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import Scatter
from tests.envs.alike import compiled_core
from tests.scenes import scatter_boxes, unchecked_boxes

GRIDS = [(19, 5), (38, 10), (95, 4), (38, 1), (76, 50)]


@settings(max_examples=20)
@given(
    grid=st.sampled_from(GRIDS),
    rules=st.sampled_from(list(RULE_SETS)),
    boxes=st.lists(scatter_boxes(), min_size=4, max_size=4),
    unchecked=unchecked_boxes,
)
def test_masks__are_exact_for_random_scenes_begun_in_turn_and_edited(grid, rules, boxes, unchecked):
    one, two, three, four = boxes
    orders = [(one, two, three), (unchecked, two, three), (one, unchecked, four), (four, two, one)]
    tasks = [Task("own", "Blue is here.", "exist(all_items)", True, Scene(order)) for order in orders]
    dynamics = make_dynamics(Scatter(grid), rules)
    core, buffers = compiled_core(dynamics, tasks)

    def is_exact():
        core.write_masks()
        return np.array_equal(buffers.mask[0], dynamics.legal_mask(core.state(0)))

    for visit, task in product(range(3), range(len(tasks))):
        core.start(np.array([0]), np.array([task]))
        if visit:  # the first time, masks are asked for after an edit alone
            assert is_exact()
        edits = np.flatnonzero(dynamics.appearance.legal_mask(tasks[task].start, dynamics.rules.placement))[-2:]
        for action in (0, *edits) if visit else (*edits, 0):
            buffers.action[:] = action
            core.step(np.array([0]))
            assert is_exact()
