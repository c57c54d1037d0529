"""A model of rewards and search with it, from rewards and the rules of editing.

Learns from the rewards of STOPs whether statements hold in scenes, and plays by searching, with the rules of editing,
for a scene where it is sure of the target. One agent plays both starts of an appearance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.learning.common.commands import TimedCommand
from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.reward_model.recipe import RewardModelRecipe, default_recipe

if TYPE_CHECKING:
    from lilgym_mp.learning.reward_model.training import Progress

DEFAULT_UPDATES = 25_000


def _note(progress: Progress) -> str:
    held_out = progress.held_out_accuracy
    known = "" if held_out is None else f", held out {100 * held_out:.1f} %"
    return f"{progress.stops:,} stops, loss {progress.loss:.2f}, truth {100 * progress.accuracy:.1f} %{known}"


COMMAND = TimedCommand(
    "reward-model",
    RewardModelRecipe,
    default_recipe,
    "lilgym_mp.learning.reward_model.training:train_reward_model",
    DEFAULT_UPDATES,
    _note,
)
LEARNER = Learner(
    add_options=COMMAND.add_options,
    train=COMMAND.train,
    recipe=RewardModelRecipe,
    make_recipe=lambda configuration, options: default_recipe(CONFIGURATIONS[configuration][0], **options),
    progress=("held_out_accuracy", "accuracy of predicted truth values on held-out statements"),
    numbers={"updates": DEFAULT_UPDATES, "minutes": None},
)
