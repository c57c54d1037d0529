"""A network that imitates the expert's optimal actions, from images and text.

Trains a network to imitate the sets of optimal actions that the expert finds. The trained agent acts on images and
statements alone, without planning.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.common.recipes import UpdateBudget, setting
from lilgym_mp.learning.imitation.recipe import ImitationRecipe

_TEACHER = "imitate this reward model's search, from rewards and the rules of editing, instead of the expert"


@dataclass(frozen=True, slots=True)
class ImitationOptions(UpdateBudget):
    """The options of an imitation run besides its recipe."""

    updates: int = setting(3_600, "updates of the optimiser", 1)
    teacher: Path | None = setting(None, _TEACHER, kind=Path, metavar="RUN")


LEARNER = Learner(
    ImitationRecipe,
    ImitationOptions,
    "lilgym_mp.learning.imitation.training:train_imitation",
)
