"""The corpus of a few statements that the tests of imitation use, and a recipe that learns it in seconds."""

from lilgym_mp.learning.reward_model.learner import RewardModelRecipe
from tests.learning.imitation.conftest import settings, statements

__all__ = ["settings", "small_recipe", "statements"]

SMALL = {
    "width": 32,
    "dropout": 0.0,
    "statements": 3,
    "scenes": 32,
    "held_out": 0.0,
    "unknown_words": 0.0,
    "first_stops": 40,
    "reuse": 4,
    "learning_rate": 1e-2,
    "averaging": 0.95,
    "averaged_exchanges": 1,
    "beam": 3,
}


def small_recipe(settings, **changes):
    return RewardModelRecipe.of(settings.configuration, **{**SMALL, **changes})
