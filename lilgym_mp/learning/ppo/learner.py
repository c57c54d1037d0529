"""Proximal policy optimisation, from rewards.

Trains an agent with proximal policy optimisation, from rewards (by default also from programs, to exchange colours;
--no-recolour for rewards alone). Ctrl-C saves a checkpoint and exits.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lilgym_mp.evaluation.policies import GREEDY, SAMPLED
from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.common.recipes import RunOptions, setting
from lilgym_mp.learning.ppo.recipe import DEFAULT_RECIPE, RECIPES, PPORecipe

_WEIGHTS = "directory of pretrained weights: config.json, model.safetensors and tokenizer"
_EVALUATIONS = "steps between evaluations on dev, for learning curves (default: no evaluations)"


@dataclass(frozen=True, slots=True)
class PPOOptions(RunOptions):
    """The options of a PPO run besides its recipe; the defaults of the recipe's settings are those of `ours`."""

    steps: int = setting(1_000_000, "environment steps", 1)
    recipe_name: str = setting(DEFAULT_RECIPE, f"one of {', '.join(sorted(RECIPES))}", flag="recipe", metavar="NAME")
    weights: Path | None = setting(None, _WEIGHTS, kind=Path, metavar="DIR")
    evaluate_every: int | None = setting(None, _EVALUATIONS, 1, kind=int)


LEARNER = Learner(
    PPORecipe,
    PPOOptions,
    "lilgym_mp.learning.ppo.training:train_ppo",
    directory="{configuration}",
    action_modes=(GREEDY, SAMPLED),  # the most probable first action may be STOP
)
