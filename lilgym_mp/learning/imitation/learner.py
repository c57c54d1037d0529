"""A network that imitates the expert's optimal actions, from images and text.

Trains a network to imitate the sets of optimal actions that the expert finds. The trained agent acts on images and
statements alone, without planning.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.learning.common.commands import TimedCommand
from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.imitation.recipe import ImitationRecipe, default_recipe

if TYPE_CHECKING:
    from lilgym_mp.learning.imitation.training import Progress

DEFAULT_UPDATES = 3_600


def _note(progress: Progress) -> str:
    if progress.actions is None or progress.truth_accuracy is None:
        return f"text layers, loss {progress.text or 0:.2f}"
    return f"{progress.states:,} states, loss {progress.actions:.2f}, truth {100 * progress.truth_accuracy:.1f} %"


COMMAND = TimedCommand(
    "imitation",
    ImitationRecipe,
    default_recipe,
    "lilgym_mp.learning.imitation.training:train_imitation",
    DEFAULT_UPDATES,
    _note,
    {"teacher": "imitate this reward model's search, from rewards and the rules of editing, instead of the expert"},
)
LEARNER = Learner(
    add_options=COMMAND.add_options,
    train=COMMAND.train,
    recipe=ImitationRecipe,
    make_recipe=lambda configuration, options: default_recipe(CONFIGURATIONS[configuration][0], **options),
    progress=("truth_accuracy", "accuracy of predicted truth values"),
    numbers={"updates": DEFAULT_UPDATES, "minutes": None},
)
