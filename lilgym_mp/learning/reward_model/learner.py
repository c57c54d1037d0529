"""A model of rewards and search with it, from rewards and the rules of editing.

Learns from the rewards of STOPs whether statements hold in scenes, and plays by searching, with the rules of editing,
for a scene where it is sure of the target. One agent plays both starts of an appearance.
"""

from __future__ import annotations

from dataclasses import dataclass

from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.common.recipes import UpdateBudget, setting
from lilgym_mp.learning.reward_model.recipe import RewardModelRecipe


@dataclass(frozen=True, slots=True)
class RewardModelOptions(UpdateBudget):
    """The options of a reward model's run besides its recipe."""

    updates: int = setting(25_000, "updates of the optimiser", 1)


LEARNER = Learner(
    RewardModelRecipe,
    RewardModelOptions,
    "lilgym_mp.learning.reward_model.training:train_reward_model",
)
