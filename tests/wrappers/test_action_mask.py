"""The action mask in infos."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from lilgym_mp.wrappers import ActionMask, StopForcing, WrongEnvironment

Make = Callable[..., gym.Env[Any, Any]]

STOP, ADD_LEFT_BLUE, REMOVE_LEFT = 0, 3, 10  # of tower's actions


def test_action_mask__after_reset(make: Make):
    env = ActionMask(make("TowerScratch"))
    _, info = env.reset(seed=0)
    assert info["action_mask"].tolist() == [1] * 10 + [0] * 3


def test_action_mask__after_a_step_is_current(make: Make):
    env = ActionMask(make("TowerScratch"))
    env.reset(seed=0)
    *_, info = env.step(ADD_LEFT_BLUE)
    assert info["action_mask"].tolist() == [1] * 10 + [1, 0, 0]


def test_action_mask__samples_legal_actions(make: Make):
    env = ActionMask(make("ScatterFlipIt"))
    _, info = env.reset(seed=0)
    assert isinstance(env.action_space, spaces.Discrete)
    assert info["action_mask"].dtype == np.int8
    legal = env.action_masks()
    assert all(legal[env.action_space.sample(info["action_mask"])] for _ in range(20))


def test_action_mask__respects_stop_forcing_inside_and_outside(make: Make):
    for stack in (lambda env: ActionMask(StopForcing(env)), lambda env: StopForcing(ActionMask(env))):
        env = stack(make("TowerFlipIt"))
        _, info = env.reset(options={"task": "pair-no"})
        assert info["action_mask"].sum() > 1
        *_, info = env.step(ADD_LEFT_BLUE)
        assert np.flatnonzero(info["action_mask"]).tolist() == [STOP]
        assert np.flatnonzero(env.action_masks()).tolist() == [STOP]


def test_action_mask__keeps_the_environments_infos(make: Make):
    env = ActionMask(make("TowerScratch"))
    env.reset(seed=0)
    *_, info = env.step(REMOVE_LEFT)
    assert info["outcome"] == "invalid_action"


def test_action_mask__refuses_another_packages_environment():
    with pytest.raises(WrongEnvironment, match="ActionMask wraps Gymnasium environments of this package"):
        ActionMask(gym.make("CartPole-v1"))
