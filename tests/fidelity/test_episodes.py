"""The recorded episodes of release 0.0.1, repeated action by action under rules="release"."""

import gzip
import hashlib
import json
from collections import defaultdict

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.envs.registration import environment_id
from lilgym_mp.scene.render import draw
from lilgym_mp.wrappers import StopForcing

RECORDINGS = [  # configuration, split, and whether stops were forced
    (f"{appearance}-{start}", split, stop_forcing)
    for appearance in ("tower", "scatter")
    for start, split in (("scratch", "train"), ("scratch", "dev"), ("flipit", "dev"))
    for stop_forcing in (False, True)
]


@pytest.fixture(scope="module")
def recorded_episodes(golden):
    """Every recorded episode, by what was recorded."""
    episodes = defaultdict(list)
    with gzip.open(golden / "episodes.jsonl.gz", "rt") as file:
        for episode in map(json.loads, file):
            episodes[episode["config"], episode["split"], episode["stop_forcing"]].append(episode)
    return episodes


def sha256(image):
    assert (image.shape, image.dtype) == ((50, 190, 3), np.uint8)
    return hashlib.sha256(image.tobytes()).hexdigest()


def check(env, episode):
    """Compares with our own episode of the same task and actions. Images that do not show the scene are as `draw`s."""
    core = env.unwrapped
    observation, _ = env.reset(options={"task": episode["example"]})
    assert observation["target"] == episode["target"]
    assert core.scene.to_json() == episode["start"]
    assert sha256(observation["image"]) == episode["start_image_sha256"]
    for step in episode["steps"]:
        truth = core.task.truth(core.scene)
        assert core.goal_reached() == (truth == core.task.target)
        observation, reward, terminated, truncated, info = env.step(core.encode_action(step["action"]))
        found = {
            "truth_before": truth,
            "reward": reward,
            "terminated": terminated,
            "truncated": truncated,
            "forced": info.get("forced_stop", False),
            "scene": core.scene.to_json(),
        }
        assert found == {key: step[key] for key in found}, episode["example"]
        if step["image_fresh"]:
            assert sha256(observation["image"]) == step["image_sha256"]
        else:
            assert np.array_equal(observation["image"], draw(core.scene, "half"))


def test_recordings__are_1998_episodes_of_7081_steps_with_six_images_of_something_else(
    recorded_episodes,
):
    assert set(recorded_episodes) == set(RECORDINGS)
    every = [episode for episodes in recorded_episodes.values() for episode in episodes]
    fresh = [step["image_fresh"] for episode in every for step in episode["steps"]]
    assert (len(every), len(fresh), fresh.count(False)) == (1998, 7081, 6)


@pytest.mark.parametrize("recording", RECORDINGS, ids=str)
def test_episodes__target_start_truths_rewards_flags_scenes_and_images_equal_the_recorded_ones(
    recording, official_data, recorded_episodes
):
    config, split, stop_forcing = recording
    env = gym.make(environment_id(*config.split("-")), corpus=official_data, split=split, rules="release")
    if stop_forcing:
        env = StopForcing(env, mode="replace", allow_evaluation=True)
    for episode in recorded_episodes[recording]:
        check(env, episode)
