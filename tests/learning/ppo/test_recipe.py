"""Recipes: named ones and invalid values."""

from itertools import product

import pytest

from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.learning.ppo.learner import MODELS, RECIPES, PPORecipe


def test_recipes__support_every_model_and_configuration():
    for name, model, configuration in product(RECIPES, MODELS, CONFIGURATIONS):
        recipe = PPORecipe.of(configuration, name, model=model, stop_forcing=True, seed=3)
        assert (recipe.model, recipe.stop_forcing, recipe.seed, recipe.mask) == (model, True, 3, False)
        assert PPORecipe.from_json(recipe.to_json()) == recipe


@pytest.mark.parametrize("name", ["paper", "release"])
def test_recipe__named_ones_set_every_relevant_value(name):
    chosen = {"seed", "model", "stop_forcing", "nlvr_reward", "microbatch", "reduced_precision"}
    assert set(PPORecipe.names()) - RECIPES[name]("TowerScratch", "c3-bert").keys() == chosen


@pytest.mark.parametrize(
    ("configuration", "model", "wanted"),
    [
        ("TowerScratch", "c3-bert", {"learning_rate": 3e-4, "entropy": 0.1, "optimiser": "adam"}),
        ("TowerFlipIt", "c10-bert", {"learning_rate": 3e-5, "entropy": 0.1, "schedule": "linear"}),
        ("ScatterScratch", "c3-bert", {"learning_rate": 3e-4, "entropy": 0.3, "final_entropy": 0.03}),
        ("ScatterScratch", "vilt", {"learning_rate": 3e-5, "optimiser": "adamw", "schedule": "cosine", "warmup": 0.01}),
    ],
)
def test_paper__has_the_values_of_its_table(configuration, model, wanted):
    recipe = PPORecipe.of(configuration, "paper", model=model)
    assert {name: getattr(recipe, name) for name in wanted} == wanted
    assert (recipe.rollout, recipe.batch_size, recipe.critic, recipe.sampled) == (2048, 64, "separate", True)
    assert recipe.cap_every_ratio


@pytest.mark.parametrize(
    ("settings", "fault"),
    [
        ({"gamma": 1.5}, "gamma must be at least 0 and at most 1, not 1.5"),
        ({"entropy": float("nan")}, "entropy must be at least 0, not nan"),
        ({"envs": 24}, "rollout must be a multiple of envs: 4096 is not a multiple of 24"),
        ({"same_statement": 7}, "envs must be a multiple of same-statement: 512 is not a multiple of 7"),
        ({"batch_size": 8192}, "batch-size must be at most rollout, 4096, not 8192"),
        ({"schedule": "step"}, "unknown schedule 'step'; choose from constant, cosine, linear"),
        ({"ratio_cap": 0.5}, "ratio-cap must be at least 1, not 0.5"),
        ({"nlvr_reward": True}, "nlvr-reward and recolour exclude each other"),
    ],
)
def test_recipe__rejects_invalid_values(settings, fault):
    with pytest.raises(ValueError, match=fault):
        PPORecipe(**settings)


def test_recipe__rejects_unknown_names_and_settings():
    with pytest.raises(ValueError, match="unknown recipe 'theirs'; choose from ours, paper, release"):
        PPORecipe.of("TowerScratch", "theirs")
    with pytest.raises(ValueError, match="unknown setting 'lr' of a recipe; choose from seed, "):
        PPORecipe.from_json({"lr": 3})
    with pytest.raises(ValueError, match="unknown configuration 'Tower'"):
        PPORecipe.of("Tower")
