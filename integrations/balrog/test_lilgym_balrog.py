"""The adapter keeps the interface of BALROG's environments."""

from __future__ import annotations

import gymnasium as gym
import pytest
from lilgym_balrog import BalrogEnv

from lilgym_mp.scene.actions import describe
from lilgym_mp.solver import Expert


@pytest.mark.parametrize("configuration", ["TowerFlipIt", "ScatterFlipIt"])
def test_balrog__is_played_by_action_names(configuration: str):
    env = BalrogEnv(gym.make(f"lilgym_mp/{configuration}-v0"))
    shown, _ = env.reset(seed=0)
    assert set(shown) == {"text", "image"}
    assert shown["image"].size == (380, 100)
    assert "STOP" in env.language_action_space
    assert "Rewards:" in env.get_instruction_prompt()
    assert env.get_stats()["progression"] == 0
    assert env.check_action_validity("nonsense") == "STOP"
    assert env.failed_candidates == ["nonsense"]
    expert, ended = Expert(env), False
    while not ended:
        name = describe(env.get_wrapper_attr("dynamics").appearance.decode(expert.act()))
        assert env.check_action_validity(f"I choose {name}") == name
        _, _, terminated, truncated, _ = env.step(name)
        ended = terminated or truncated
    assert env.get_stats() == {"progression": 1.0, "success": True}
