"""The recorded episodes of release 0.0.1, repeated action by action under rules="release".

The observations' images have the recorded SHA-256 sums, but for six that do not show the scene alone.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.scene.render import draw
from tests.fidelity.recorded import RECORDINGS, Recording

Recorded = dict[Recording, list[dict[str, Any]]]


def sha256(image: Any) -> str:
    assert (image.shape, image.dtype) == ((50, 190, 3), np.uint8)
    return hashlib.sha256(image.tobytes()).hexdigest()


def repeated(env: gym.Env[Any, Any], recording: Recording, episode: dict[str, Any]) -> dict[str, Any]:
    """The record of our own episode: the same task, the same actions."""
    core: Any = env.unwrapped
    observation, _ = env.reset(options={"task": episode["example"]})
    start_sum, steps = sha256(observation["image"]), []
    target, start = bool(observation["target"]), core.scene.to_json()
    for step in episode["steps"]:
        truth = core.task.truth(core.scene)
        assert core.goal_reached() == (truth == core.task.target)
        observation, reward, terminated, truncated, info = env.step(core.encode_action(step["action"]))
        if not step["image_fresh"]:
            assert np.array_equal(observation["image"], draw(core.scene, "half"))
        steps.append(
            {
                "action": step["action"],
                "truth_before": truth,
                "reward": reward,
                "terminated": terminated,
                "truncated": truncated,
                "forced": info["forced_stop"] if recording.stop_forcing else False,
                "scene": core.scene.to_json(),
                "image_fresh": step["image_fresh"],
                "image_sha256": sha256(observation["image"]) if step["image_fresh"] else step["image_sha256"],
            }
        )
    return {**episode, "target": target, "start": start, "start_image_sha256": start_sum, "steps": steps}


def test_recordings__are_1998_episodes_of_7081_steps_with_six_images_of_more_than_the_scene(
    recorded_episodes: Recorded,
):
    assert set(recorded_episodes) == set(RECORDINGS)
    every = [episode for episodes in recorded_episodes.values() for episode in episodes]
    fresh = [step["image_fresh"] for episode in every for step in episode["steps"]]
    assert (len(every), len(fresh), fresh.count(False)) == (1998, 7081, 6)


@pytest.mark.parametrize("recording", RECORDINGS, ids=str)
def test_episodes__targets_starts_truths_rewards_flags_scenes_and_images_equal_the_recorded_ones(
    recording: Recording, official_data: Path, recorded_episodes: Recorded
):
    with recording.environment(official_data) as env:
        for episode in recorded_episodes[recording]:
            assert repeated(env, recording, episode) == episode, episode["example"]
