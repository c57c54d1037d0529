"""The shipped imitation agents."""

from __future__ import annotations

import pytest

from lilgym_mp import load_agent
from lilgym_mp.evaluation import Settings, evaluate

MIN_ACCURACY = {  # on dev; random play has at most 0.2
    "TowerScratch": 0.7, "TowerFlipIt": 0.7, "ScatterScratch": 0.55, "ScatterFlipIt": 0.65,
}  # fmt: skip


@pytest.mark.parametrize("configuration", MIN_ACCURACY)
def test_shipped_network__solves_most_dev_tasks_from_pixels(configuration: str):
    settings = Settings(configuration)
    agent = load_agent(f"imitation-{settings.appearance}", "cpu")
    assert "builtin" in agent.description.supervision
    episodes = evaluate(agent.policy(settings), settings, "dev")
    assert sum(episode.is_success for episode in episodes) / len(episodes) > MIN_ACCURACY[configuration]
    assert len({len(episode.actions) for episode in episodes}) > 2
