"""The recorded episodes of release 0.0.1, repeated action by action under rules="release"."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

from tests.fidelity.recorded import RECORDINGS, Recording

Recorded = dict[Recording, list[dict[str, Any]]]


def repeated(env: gym.Env[Any, Any], recording: Recording, episode: dict[str, Any]) -> dict[str, Any]:
    """The record of our own episode: the same task, the same actions, images left out."""
    core: Any = env.unwrapped
    observation, _ = env.reset(options={"task": episode["example"]})
    record = {"target": bool(observation["target"]), "start": core.scene.to_json(), "steps": []}
    for step in episode["steps"]:
        truth = core.task.truth(core.scene)
        assert core.goal_reached() == (truth == core.task.target)
        _, reward, terminated, truncated, info = env.step(core.encode_action(step["action"]))
        record["steps"].append(
            {
                "action": step["action"],
                "truth_before": truth,
                "reward": reward,
                "terminated": terminated,
                "truncated": truncated,
                "forced": info["forced_stop"] if recording.stop_forcing else False,
                "scene": core.scene.to_json(),
            }
        )
    return record


def without_images(episode: dict[str, Any]) -> dict[str, Any]:
    steps = [{key: value for key, value in step.items() if "image" not in key} for step in episode["steps"]]
    return {"target": episode["target"], "start": episode["start"], "steps": steps}


def test_recordings__are_1998_episodes_of_7081_steps(recorded_episodes: Recorded):
    assert set(recorded_episodes) == set(RECORDINGS)
    every = [episode for episodes in recorded_episodes.values() for episode in episodes]
    assert (len(every), sum(len(episode["steps"]) for episode in every)) == (1998, 7081)


@pytest.mark.parametrize("recording", RECORDINGS, ids=str)
def test_episodes__target_start_truths_rewards_flags_and_scenes_equal_the_recorded_ones(
    recording: Recording, official_data: Path, recorded_episodes: Recorded
):
    with recording.environment(official_data) as env:
        for episode in recorded_episodes[recording]:
            assert repeated(env, recording, episode) == without_images(episode), episode["example"]
