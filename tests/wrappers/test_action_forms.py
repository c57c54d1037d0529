"""Actions as arrays and by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import ActionError, describe, named
from lilgym_mp.scene.appearances import Appearance, make_appearance
from lilgym_mp.wrappers import (
    MultiDiscreteActions,
    StopForcing,
    WrongEnvironment,
    multi_discrete_actions_v0,
)

Make = Callable[..., gym.Env[Any, Any]]

BLUE_LEFT = [[{"x_loc": 40, "y_loc": 80, "type": "square", "color": "#0099ff", "size": 20}], [], []]


def scene(env: gym.Env[Any, Any]) -> Scene:
    return env.unwrapped.scene  # pyright: ignore[reportAttributeAccessIssue]


def test_arrays__are_the_released_form(make: Make):
    env = MultiDiscreteActions(make("TowerScratch"))
    assert env.action_space == spaces.MultiDiscrete([3, 3, 3])
    env.reset(seed=0)
    env.step(np.array([1, 0, 2]))
    assert scene(env).to_json() == BLUE_LEFT
    env.step([2, 0, -1])
    assert scene(env) == Scene.empty()


@pytest.mark.parametrize(
    ("grid", "sizes"),
    [((19, 5), [3, 19, 5, 3, 3, 3]), ((38, 10), [3, 38, 10, 3, 3, 3]), ((19, 1), [3, 19, 1, 3, 3, 3])],
)
def test_arrays__of_scatter_cover_the_grid(make: Make, grid: tuple[int, int], sizes: list[int]):
    assert MultiDiscreteActions(make("ScatterScratch", grid=grid)).action_space == spaces.MultiDiscrete(sizes)


@pytest.mark.parametrize("unused", [-1, 0, 99])
@pytest.mark.parametrize(("appearance", "grid"), [("Tower", (19, 5)), ("Scatter", (19, 5)), ("Scatter", (38, 4))])
def test_every_array__decodes_to_its_index_ignoring_unused_slots(
    make: Make, appearance: str, grid: tuple[int, int], unused: int
):
    env = MultiDiscreteActions(make(f"{appearance}Scratch", grid=grid))
    actions = make_appearance(appearance.lower(), grid)
    arrays = np.array([actions.to_array(actions.decode(index)) for index in range(actions.action_count)])
    arrays[arrays == -1] = unused
    indices, _ = env.transformation.actions(arrays, env._state)
    assert indices.tolist() == list(range(actions.action_count))


@pytest.mark.parametrize("actions", [make_appearance("tower"), make_appearance("scatter", (38, 10))], ids=str)
def test_every_name__decodes_to_its_action(actions: Appearance):
    assert all(named(describe(action)) == action for action in map(actions.decode, range(actions.action_count)))


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([1, 3, 0], "box 3 of the action is out of range; choose from 0 .. 2"),
        ([3, 0, 0], "type 3 of the action is out of range"),
        ([1, -1, 0], "box -1 of the action is out of range"),
        ([1, 0], "an action array must be 3 whole numbers"),
        ([1.0, 0.0, 0.0], "an action array must be 3 whole numbers"),
    ],
)
def test_invalid_array__is_refused(make: Make, action: list[Any], message: str):
    env = MultiDiscreteActions(make("TowerScratch"))
    env.reset(seed=0)
    with pytest.raises(ActionError, match=message):
        env.step(action)


def test_arrays__of_a_batch(corpus: Any):
    batch = multi_discrete_actions_v0(gym.make_vec("lilgym_mp/TowerScratch-v0", num_envs=3, corpus=str(corpus)))
    batch.reset(seed=0)
    batch.step(np.array([[1, 0, 2], [1, 2, 1], [0, 0, 0]]))
    assert batch.unwrapped._buffers.action.tolist() == [3, 8, 0]


def test_wrapper_that_needs_discrete_actions__is_refused_on_others(make: Make):
    with pytest.raises(WrongEnvironment, match=r"StopForcing needs the action space Discrete\(13\)"):
        StopForcing(MultiDiscreteActions(make("TowerScratch")), mode="replace")
    MultiDiscreteActions(StopForcing(make("TowerScratch"), mode="replace"))
