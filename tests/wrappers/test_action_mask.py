"""The action mask in infos."""

import numpy as np

from lilgym_mp.wrappers import ActionMask, StopForcing

STOP, ADD_LEFT_BLUE, REMOVE_MIDDLE = 0, 3, 11  # of tower's actions


def test_action_mask__is_current_beside_the_environments_infos(make):
    env = ActionMask(make("TowerScratch"))
    _, info = env.reset(seed=0)
    assert info["action_mask"].tolist() == [1] * 10 + [0] * 3
    assert env.action_space.sample(info["action_mask"]) < 10  # takes int8 alone
    *_, info = env.step(ADD_LEFT_BLUE)
    assert info["action_mask"].tolist() == [1] * 10 + [1, 0, 0]
    assert env.step(REMOVE_MIDDLE)[4]["outcome"] == "invalid_action"


def test_action_mask__respects_stop_forcing_inside_and_outside(make):
    for stack in (lambda env: ActionMask(StopForcing(env)), lambda env: StopForcing(ActionMask(env))):
        env = stack(make("TowerFlipIt"))
        _, info = env.reset(options={"task": "pair-no"})
        assert info["action_mask"].sum() > 1
        *_, info = env.step(ADD_LEFT_BLUE)
        assert np.flatnonzero(info["action_mask"]).tolist() == [STOP]
        assert np.flatnonzero(env.action_masks()).tolist() == [STOP]
