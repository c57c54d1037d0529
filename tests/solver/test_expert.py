"""The expert plays environments to success from any state."""

import gymnasium as gym
import pytest

from lilgym_mp.solver import Expert
from lilgym_mp.wrappers import ActionMask


def play(env, expert):
    total = 0.0
    while True:
        _, reward, terminated, truncated, info = env.step(expert.act())
        total += float(reward)
        if terminated or truncated:
            return total, info


@pytest.mark.parametrize(
    ("configuration", "rules"),
    [
        ("TowerScratch", "release"),
        ("TowerFlipIt", "paper"),
        ("ScatterScratch", "paper"),
        ("ScatterFlipIt", "release"),
    ],
)
def test_expert__succeeds(configuration, rules):
    env = gym.make(f"lilgym_mp/{configuration}-v0", split="dev", rules=rules)
    expert = Expert(env)
    for seed in range(5):
        env.reset(seed=seed)
        steps = expert.plan().steps
        total, info = play(env, expert)
        assert info["outcome"] == "success"
        assert total == pytest.approx(1 - 0.1 * (steps - 1))


def test_expert__replans_after_other_actions():
    env = gym.make("lilgym_mp/TowerFlipIt-v0", split="dev")
    expert = Expert(env)
    env.reset(seed=3)
    expert.act()
    env.step(next(action for action in range(1, 13) if env.unwrapped.action_masks()[action]))
    assert play(env, expert)[1]["is_success"]


def test_expert__stops_if_there_is_no_solution():
    env = gym.make("lilgym_mp/TowerScratch-v0", split="dev", horizon=1)
    env.reset(seed=0)
    assert Expert(env).act() == 0


def test_expert__accepts_wrapped_environments():
    env = ActionMask(gym.make("lilgym_mp/ScatterFlipIt-v0", split="dev"))
    env.reset(seed=0)
    found = Expert(env).optimal_actions()
    assert Expert(env).act() in found.actions
    assert env.unwrapped.action_masks()[list(found.actions)].all()


def test_expert__needs_an_environment_of_this_package():
    with pytest.raises(TypeError, match="an environment of lilgym-mp"):
        Expert(gym.make("CartPole-v1"))


def test_expert__needs_an_environment_that_was_reset():
    expert = Expert(gym.make("lilgym_mp/TowerScratch-v0", split="dev"))
    with pytest.raises(gym.error.ResetNeeded):
        expert.act()
