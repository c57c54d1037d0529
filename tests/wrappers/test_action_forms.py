"""Actions as arrays and by name."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import ActionError
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.wrappers import (
    MultiDiscreteActions,
    StopForcing,
    WrongEnvironment,
    multi_discrete_actions_v0,
)
from tests.scenes import scene_of


def test_arrays__are_the_released_form(make):
    env = MultiDiscreteActions(make("TowerScratch"))
    assert env.action_space == spaces.MultiDiscrete([3, 3, 3])
    env.reset(seed=0)
    for array, shown in ((np.array([1, 0, 2]), scene_of("tower b")), ([2, 0, -1], Scene.empty())):
        env.step(array)
        assert env.unwrapped.scene == shown


def test_arrays__of_scatter_cover_the_grid(make):
    env = MultiDiscreteActions(make("ScatterScratch", grid=(38, 10)))
    assert env.action_space == spaces.MultiDiscrete([3, 38, 10, 3, 3, 3])


@pytest.mark.parametrize("unused", [-1, 99])
@pytest.mark.parametrize(("appearance", "grid"), [("Tower", (19, 5)), ("Scatter", (38, 4))])
def test_every_array__decodes_to_its_index_ignoring_unused_slots(make, appearance, grid, unused):
    env = MultiDiscreteActions(make(f"{appearance}Scratch", grid=grid))
    actions = make_appearance(appearance.lower(), grid)
    arrays = np.array([actions.to_array(actions.decode(index)) for index in range(actions.action_count)])
    arrays[arrays == -1] = unused
    indices, _ = env.transformation.actions(arrays, env._state)
    assert indices.tolist() == list(range(actions.action_count))


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([1, 3, 0], r"box 3 .*; choose from 0 \.\. 2"),
        ([1, 0], "3 whole numbers"),
        ([1.0, 0.0, 0.0], "3 whole numbers"),
    ],
)
def test_invalid_array__is_refused(make, action, message):
    env = MultiDiscreteActions(make("TowerScratch"))
    env.reset(seed=0)
    with pytest.raises(ActionError, match=message):
        env.step(action)


def test_arrays__of_a_batch(corpus):
    batch = multi_discrete_actions_v0(gym.make_vec("lilgym_mp/TowerScratch-v0", num_envs=3, corpus=str(corpus)))
    batch.reset(seed=0)
    batch.step(np.array([[1, 0, 2], [1, 2, 1], [0, 0, 0]]))
    assert batch.unwrapped._buffers.action.tolist() == [3, 8, 0]


def test_wrapper_that_needs_discrete_actions__is_refused_on_others(make):
    with pytest.raises(WrongEnvironment, match=r"StopForcing needs the action space Discrete\(13\)"):
        StopForcing(MultiDiscreteActions(make("TowerScratch")), mode="replace")
    MultiDiscreteActions(StopForcing(make("TowerScratch"), mode="replace"))
