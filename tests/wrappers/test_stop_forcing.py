"""Stop forcing by mask and by replacement."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.wrappers import StopForcing

Make = Callable[..., gym.Env[Any, Any]]

STOP, ADD_LEFT_YELLOW, ADD_LEFT_BLUE = 0, 1, 3  # of tower's actions


def test_mask__allows_only_stop_where_stop_succeeds(make: Make):
    env = StopForcing(make("TowerScratch"))
    env.reset(options={"task": "blue"})
    assert env.action_masks().sum() == 10
    env.step(ADD_LEFT_BLUE)
    assert np.flatnonzero(env.action_masks()).tolist() == [STOP]


def test_mask__does_not_change_actions(make: Make):
    env = StopForcing(make("TowerScratch"))
    env.reset(options={"task": "blue"})
    env.step(ADD_LEFT_BLUE)
    _, reward, terminated, _, info = env.step(ADD_LEFT_YELLOW)
    assert (reward, terminated) == (-0.1, False)
    assert "forced_stop" not in info


def test_mask__is_a_new_array_each_time(make: Make):
    env = StopForcing(make("TowerScratch"))
    env.reset(options={"task": "blue"})
    env.action_masks()[:] = False
    assert env.action_masks()[STOP]


def test_replace__replaces_actions_where_stop_succeeds(make: Make):
    env = StopForcing(make("TowerScratch"), mode="replace")
    env.reset(options={"task": "blue"})
    assert env.step(ADD_LEFT_BLUE)[4]["forced_stop"] is False
    _, reward, terminated, _, info = env.step(ADD_LEFT_YELLOW)
    assert (reward, terminated, info["outcome"]) == (1.0, True, "success")
    assert info["forced_stop"] is True


def test_replace__does_not_report_the_agents_own_stop_as_forced(make: Make):
    env = StopForcing(make("TowerScratch"), mode="replace")
    env.reset(options={"task": "blue"})
    env.step(ADD_LEFT_BLUE)
    _, reward, *_, info = env.step(STOP)
    assert (reward, info["forced_stop"]) == (1.0, False)


def test_replace__keeps_a_wrong_stop(make: Make):
    env = StopForcing(make("TowerScratch"), mode="replace")
    env.reset(options={"task": "blue"})
    _, reward, *_, info = env.step(STOP)
    assert (reward, info["forced_stop"]) == (-1.0, False)


def test_replace__keeps_the_masks(make: Make):
    env = StopForcing(make("TowerScratch"), mode="replace")
    env.reset(options={"task": "blue"})
    env.step(ADD_LEFT_BLUE)
    assert env.action_masks().sum() == 11


@pytest.mark.parametrize("mode", ["mask", "replace"])
def test_evaluation_splits__are_refused_unless_allowed(make: Make, mode: str):
    with pytest.raises(ValueError, match="StopForcing is for training: split 'dev' is for evaluation"):
        StopForcing(make("TowerScratch", split="dev"), mode=mode)
    StopForcing(make("TowerScratch", split="dev"), mode=mode, allow_evaluation=True)


def test_unknown_mode__names_the_choices(make: Make):
    with pytest.raises(ValueError, match="unknown mode 'force'; choose from mask, replace"):
        StopForcing(make("TowerScratch"), mode="force")


def test_step_before_reset__is_refused(make: Make):
    with pytest.raises(gym.error.ResetNeeded):
        StopForcing(make("TowerScratch"), mode="replace").step(STOP)


@pytest.mark.usefixtures("official_data")
def test_replace__replays_recorded_stop_forcing(golden: Path):
    """Some recorded episodes of one configuration; tests/fidelity replays all."""
    env = StopForcing(
        gym.make("lilgym_mp/TowerFlipIt-v0", corpus="lilgym", split="dev", rules="release"),
        mode="replace",
        allow_evaluation=True,
    )
    with gzip.open(golden / "episodes.jsonl.gz", "rt") as lines:
        episodes = [json.loads(line) for line in lines]
    forced = [
        episode
        for episode in episodes
        if episode["stop_forcing"] and episode["config"] == "tower-flipit" and episode["split"] == "dev"
    ]
    assert forced
    for episode in forced[:40]:
        env.reset(options={"task": episode["example"]})
        for step in episode["steps"]:
            action = env.unwrapped.encode_action(step["action"])  # pyright: ignore[reportAttributeAccessIssue]
            _, reward, terminated, truncated, info = env.step(action)
            assert (reward, terminated, truncated, info["forced_stop"]) == (
                step["reward"],
                step["terminated"],
                step["truncated"],
                step["forced"],
            )
