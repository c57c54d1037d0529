"""The shipped imitation agents."""

from __future__ import annotations

import numpy as np
import pytest

from lilgym_mp import load_agent
from lilgym_mp.evaluation import Observations, Settings, evaluate
from lilgym_mp.scene import Scene
from lilgym_mp.scene.render import draw
from tests.scenes import LARGE, MEDIUM, B, K, circle, square

MIN_ACCURACY = {  # on dev; random play has at most 0.2
    "TowerScratch": 0.7,
    "TowerFlipIt": 0.7,
    "ScatterScratch": 0.55,
    "ScatterFlipIt": 0.65,
}


@pytest.mark.parametrize("configuration", MIN_ACCURACY)
def test_shipped_network__solves_most_dev_tasks_from_pixels(configuration: str):
    settings = Settings(configuration)
    agent = load_agent(f"imitation-{settings.appearance}", "cpu")
    assert "builtin" in agent.description.supervision
    tasks = settings.make("dev").evaluation_tasks()
    episodes = evaluate(agent.policy(settings), settings, "dev", task_ids=tasks[:: len(tasks) // 70])
    assert sum(episode.is_success for episode in episodes) / len(episodes) > MIN_ACCURACY[configuration]
    assert len({len(episode.actions) for episode in episodes}) > 2


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
