"""Stop forcing by mask and by replacement."""

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.wrappers import StopForcing

STOP, ADD_LEFT_YELLOW, ADD_LEFT_BLUE = 0, 1, 3  # of tower's actions


def test_mask__allows_only_stop_where_stop_succeeds_and_leaves_actions_alone(make):
    env = StopForcing(make("TowerScratch"))
    env.reset(options={"task": "blue"})
    assert env.action_masks().sum() == 10
    env.step(ADD_LEFT_BLUE)
    env.action_masks()[:] = False  # a new array each time
    assert np.flatnonzero(env.action_masks()).tolist() == [STOP]
    _, reward, terminated, _, info = env.step(ADD_LEFT_YELLOW)
    assert (reward, terminated, info) == (-0.1, False, {})


@pytest.mark.parametrize(
    ("actions", "reward", "forced"),
    [
        ([ADD_LEFT_BLUE], -0.1, False),
        ([ADD_LEFT_BLUE, ADD_LEFT_YELLOW], 1.0, True),
        ([ADD_LEFT_BLUE, STOP], 1.0, False),
        ([STOP], -1.0, False),
    ],
    ids=["not there yet", "forced", "own stop", "wrong stop"],
)
def test_replace__replaces_actions_where_stop_succeeds(make, actions, reward, forced):
    env = StopForcing(make("TowerScratch"), mode="replace")
    env.reset(options={"task": "blue"})
    for action in actions:
        _, last, *_, info = env.step(action)
    assert (last, info["forced_stop"]) == (reward, forced)
    assert env.action_masks().sum() > 1


def test_observe__shows_where_stop_succeeds_and_changes_nothing_else(make):
    env = StopForcing(make("TowerScratch"), mode="observe")
    observation, _ = env.reset(options={"task": "blue"})
    shown = [observation["forced"]]
    for action in (ADD_LEFT_BLUE, ADD_LEFT_YELLOW):
        observation, reward, *_ = env.step(action)
        assert reward == -0.1
        assert env.action_masks().sum() > 1
        assert observation in env.observation_space
        shown.append(observation["forced"])
    assert np.array(shown).tolist() == [[0], [1], [1]]


@pytest.mark.parametrize("mode", ["mask", "replace", "observe"])
def test_evaluation_splits__are_refused_unless_allowed(make, mode):
    with pytest.raises(ValueError, match="split 'dev' is for evaluation"):
        StopForcing(make("TowerScratch", split="dev"), mode=mode)
    StopForcing(make("TowerScratch", split="dev"), mode=mode, allow_evaluation=True)


def test_step_before_reset__is_refused(make):
    with pytest.raises(gym.error.ResetNeeded):
        StopForcing(make("TowerScratch"), mode="replace").step(STOP)
