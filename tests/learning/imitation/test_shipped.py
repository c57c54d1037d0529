"""The shipped imitation agents."""

import numpy as np

from lilgym_mp import load_agent
from lilgym_mp.evaluation import Observations, Settings
from lilgym_mp.scene import Scene
from lilgym_mp.scene.render import draw
from tests.scenes import LARGE, MEDIUM, B, K, circle, square


def test_unreadable_images__are_answered_by_stop():
    """Under the released rules, items can occlude others."""
    occluding = Scene.of([circle(10, 10, LARGE, B), square(35, 20, MEDIUM, K)], [], [])
    images = np.stack([draw(scene, "half") for scene in (Scene.empty(), occluding)])
    settings = Settings("ScatterScratch", rules="release")
    policy = load_agent("imitation-scatter", "cpu").policy(settings)
    zeros = np.zeros(2, np.int64)
    observations = Observations(images, ("There is a circle.",) * 2, zeros + 1, zeros, zeros)
    first, second = policy(observations, np.zeros((2, 0), np.bool_), np.random.default_rng(0))
    assert first != 0
    assert second == 0
