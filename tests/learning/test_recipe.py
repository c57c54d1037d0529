"""The numbers that a training run depends on."""

from __future__ import annotations

import json
from typing import Any

import pytest

from lilgym_mp.learning.recipe import Recipe


def test_recipe__comes_back_from_json():
    recipe = Recipe(seed=3, learning_rate=1e-4, recolour=True)
    assert Recipe.from_json(json.loads(json.dumps(recipe.to_json()))) == recipe


@pytest.mark.parametrize(
    ("settings", "fault"),
    [
        ({"gamma": 1.5}, "gamma must be at least 0 and at most 1, not 1.5"),
        ({"envs": 0}, "envs must be at least 1, not 0"),
        ({"learning_rate": -1.0}, "learning-rate must be at least 0 and at most 1, not -1.0"),
        ({"rollout": 100, "envs": 16}, "rollout must be a multiple of envs: 100 is none of 16"),
        ({"batch_size": 4096}, "batch-size must be at most rollout, 2048, not 4096"),
        ({"entropy": float("nan")}, "entropy must be at least 0, not nan"),
    ],
)
def test_recipe__numbers_that_make_no_sense_are_refused(settings: dict[str, Any], fault: str):
    with pytest.raises(ValueError, match=fault):
        Recipe(**settings)
