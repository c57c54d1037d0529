"""Settings of environments."""

from __future__ import annotations

import json

import pytest

from lilgym_mp.evaluation import Settings


@pytest.mark.parametrize("grid", [(38, 10), "native"])
def test_settings__from_json_is_the_inverse_of_to_json(grid: tuple[int, int] | str):
    settings = Settings("ScatterFlipIt", rules="release", horizon=5, grid=grid)
    assert Settings.from_json(json.loads(json.dumps(settings.to_json()))) == settings


def test_make__passes_all_settings():
    env = Settings("ScatterScratch", rules="release", horizon=5, grid=(38, 10)).make("test")
    assert env.tasks.provenance.split == "test"
    assert (env.dynamics.rules.name, env.dynamics.horizon) == ("release", 5)
    assert env.dynamics.appearance.action_count == 1 + 380 * 28
