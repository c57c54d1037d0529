"""Recipes and budgets of all learners: values out of bounds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.envs.proposer_verifier import GameSettings
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.game.recipe import GameRecipe
from lilgym_mp.learning.game.training import train_game
from lilgym_mp.learning.imitation.recipe import ImitationRecipe
from lilgym_mp.learning.imitation.training import train_imitation
from lilgym_mp.learning.parsing.recipe import ParserRecipe
from lilgym_mp.learning.ppo.recipe import PPORecipe
from lilgym_mp.learning.recipes import Recipe
from lilgym_mp.learning.reward_model.recipe import RewardModelRecipe
from lilgym_mp.learning.reward_model.training import train_reward_model


@pytest.mark.parametrize(
    ("recipe", "settings", "fault"),
    [
        (ParserRecipe, {"updates": 0}, "updates must be at least 1, not 0"),
        (ParserRecipe, {"generated": 1.5}, "generated must be at least 0 and at most 1, not 1.5"),
        (ParserRecipe, {"width": 30}, "width must be a multiple of 4, not 30"),
        (ImitationRecipe, {"learning_rate": 2}, "learning-rate must be at least 0 and at most 1, not 2"),
        (RewardModelRecipe, {"averaged_exchanges": 7}, "averaged-exchanges must be at least 1 and at most 6, not 7"),
        (GameRecipe, {"algorithm": "mappo"}, "unknown algorithm 'mappo'; choose from central, independent, shared"),
        (PPORecipe, {"entropy": float("nan")}, "entropy must be at least 0, not nan"),
        (PPORecipe, {"envs": 24}, "rollout must be a multiple of envs: 4096 is not a multiple of 24"),
        (PPORecipe, {"same_statement": 7}, "envs must be a multiple of same-statement: 512 is not a multiple of 7"),
        (PPORecipe, {"batch_size": 8192}, "batch-size must be at most rollout, 4096, not 8192"),
        (PPORecipe, {"nlvr_reward": True}, "nlvr-reward and recolour exclude each other"),
    ],
)
def test_recipe__names_the_setting_out_of_bounds(recipe: type[Recipe], settings: dict[str, Any], fault: str):
    with pytest.raises(ValueError, match=fault):
        recipe(**settings)


@pytest.mark.parametrize(
    ("train", "unit", "settings", "recipe"),
    [
        (train_imitation, "updates", Settings("TowerScratch"), ImitationRecipe()),
        (train_reward_model, "updates", Settings("TowerScratch"), RewardModelRecipe()),
        (train_game, "steps", GameSettings.of(protocol="joint"), GameRecipe()),
    ],
)
def test_training__rejects_unusable_budgets(tmp_path: Path, train: Any, unit: str, settings: Any, recipe: Recipe):
    for budget, fault in (
        ({}, f"give a budget: {unit}, minutes, or both"),
        ({unit: 0}, f"{unit} must be above 0, not 0"),
        ({unit: 1, "minutes": -1.0}, "minutes must be above 0, not -1"),
        ({"minutes": float("nan")}, "minutes must be above 0, not nan"),
    ):
        with pytest.raises(ValueError, match=fault):
            train(settings, recipe, tmp_path / "run", **budget)
    assert not (tmp_path / "run").exists()
