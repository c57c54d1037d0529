"""The release's pictures: the environment's own observations have the recorded SHA-256 sums."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lilgym_mp.scene.render import draw
from tests.fidelity.recorded import RECORDINGS, Recording

Recorded = dict[Recording, list[dict[str, Any]]]


def sha256(image: Any) -> str:
    assert (image.shape, image.dtype) == ((50, 190, 3), np.uint8)
    return hashlib.sha256(image.tobytes()).hexdigest()


def test_recorded_images__all_but_six_show_the_scene_alone(recorded_episodes: Recorded):
    every = (episode for episodes in recorded_episodes.values() for episode in episodes)
    fresh = [step["image_fresh"] for episode in every for step in episode["steps"]]
    assert (len(fresh), fresh.count(False)) == (7081, 6)


@pytest.mark.parametrize("recording", RECORDINGS, ids=str)
def test_observations__every_image_that_shows_the_scene_alone_is_the_recorded_one(
    recording: Recording, official_data: Path, recorded_episodes: Recorded
):
    with recording.environment(official_data) as env:
        core: Any = env.unwrapped
        for episode in recorded_episodes[recording]:
            observation, _ = env.reset(options={"task": episode["example"]})
            assert sha256(observation["image"]) == episode["start_image_sha256"]
            for step in episode["steps"]:
                observation, *_ = env.step(core.encode_action(step["action"]))
                if step["image_fresh"]:
                    assert sha256(observation["image"]) == step["image_sha256"], episode["example"]
                else:
                    assert np.array_equal(observation["image"], draw(core.scene, "half"))
