"""A model of rewards and search with it, from rewards and the rules of editing.

Learns from the rewards of STOPs whether statements hold in scenes, and plays by searching, with the rules of editing,
for a scene where it is sure of the target. One agent plays both starts of an appearance.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.common.recipes import Recipe, UpdateBudget, setting


@dataclass(frozen=True, slots=True)
class RewardModelRecipe(Recipe):
    """A model of rewards, and search with it (docs/reward_model.md)."""

    width: int = setting(64, "network width; a multiple of 4", 4)
    counts: int = setting(16, "soft counts of items and of boxes; more suit Scatter")
    tokens: int = setting(6, "queries that read the statement", 1)
    dropout: float = setting(0.1, "dropout rate", 0, 0.9)
    statements: int = setting(32, "statements per batch", 1)
    scenes: int = setting(48, "scenes per statement in a batch", 4)
    paired: float = setting(0.5, "fraction of them in pairs that one edit and the truth value set apart", 0, 1)
    learning_rate: float = setting(3e-3, "peak learning rate of AdamW", 0, 1)
    weight_decay: float = setting(0.02, "weight decay of AdamW")
    averaging: float = setting(0.998, "decay of the running average of weights, which plays", 0, 1)
    unknown_words: float = setting(0.03, "fraction of training words replaced by the unknown word", 0, 1)
    first_stops: int = setting(60, "scenes stopped in per statement before training begins", 1)
    reuse: int = setting(30, "times that a label is trained on before more are collected, on average", 1)
    searching: float = setting(
        0.5, "fraction of collections for scenes that a search finds, after a quarter of the run", 0, 1
    )
    held_out: float = setting(0.05, "fraction of training statements held out to measure accuracy", 0, 0.5)
    averaged_exchanges: int = setting(2, "exchanges of what a statement does not name that are averaged in play", 1, 6)
    beam: int = setting(16, "scenes kept by the search", 1)
    edit_cost: float = setting(0.003, "probability traded for saving one edit in the choice of a scene", 0, 1)

    by_appearance: ClassVar = {
        "tower": {"counts": 0, "first_stops": 150, "dropout": 0.15, "unknown_words": 0.05, "averaged_exchanges": 6},
        "scatter": {"first_stops": 250, "beam": 3},
    }


@dataclass(frozen=True, slots=True)
class RewardModelOptions(UpdateBudget):
    """The options of a reward model's run besides its recipe."""

    updates: int = setting(25_000, "updates of the optimiser", 1)


def _train(*arguments: Any, **options: Any) -> Any:
    from lilgym_mp.learning.reward_model.training import train_reward_model

    return train_reward_model(*arguments, **options)


def _load_agent(path: Path, device: str) -> Any:
    from lilgym_mp.learning.reward_model.agent import load_agent

    return load_agent(path, device)


LEARNER = Learner(RewardModelRecipe, RewardModelOptions, _train, _load_agent, __doc__)
