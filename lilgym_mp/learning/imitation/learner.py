"""A network that imitates the expert's optimal actions, from images and text.

Trains a network to imitate the sets of optimal actions that the expert finds. The trained agent acts on images and
statements alone, without planning.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.common.recipes import Recipe, UpdateBudget, setting


@dataclass(frozen=True, slots=True)
class ImitationRecipe(Recipe):
    """Imitation of sets of optimal first actions (docs/imitation.md); docs/lab/index.md has ablations."""

    width: int = setting(128, "network width; a multiple of 8", 8)
    text_layers: int = setting(2, "layers of the text encoder", 0)
    item_layers: int = setting(2, "layers of the item encoder, which attend to the statement", 1)
    dropout: float = setting(0.1, "dropout rate", 0, 0.9)
    statements: int = setting(24, "statements per batch", 1)
    solved: int = setting(8, "scenes with optimal actions per statement in a batch", 1)
    truth_only: int = setting(8, "further scenes per statement, half of them true where possible", 2)
    learning_rate: float = setting(1.5e-3, "peak learning rate of AdamW", 0, 1)
    warmup: float = setting(
        0.03, "fraction of the budget for linear warm-up; cosine decay follows", 0, 1, flag="warm_up"
    )
    weight_decay: float = setting(0.02, "weight decay of AdamW")
    gradient_norm: float = setting(1.0, "gradient clipping norm")
    truth: float = setting(3.0, "coefficient of the truth loss, which trains STOP")
    steps: float = setting(0.1, "coefficient of the steps-to-go loss", flag="steps_to_go")
    legal: float = setting(1.0, "coefficient of the legal-edits loss (Scatter)")
    recolour: bool = setting(True, "permute colours at random in words and scenes where both name the same ones")
    unknown_words: float = setting(0.02, "word dropout: fraction of training words replaced by the unknown word", 0, 1)
    collect_every: int = setting(13, "updates between collections: visiting scenes and querying the expert", 1)
    own_states: float = setting(
        0.5, "fraction of data collection on the network's own states (DAgger), after the first fifth of the run", 0, 1
    )
    empty_starts: float = setting(
        0.25,
        "fraction of trajectories from the empty scene in a FlipIt run; above 0 the agent also plays Scratch",
        0,
        1,
    )
    first_scenes: int = setting(3, "scenes with optimal actions per statement before imitation begins", 1)
    pretraining: float = setting(
        0.25, "fraction of updates that pretrain the text encoder; Scatter's legal edits get four times as many", 0, 0.9
    )
    budget: int = setting(20_000, "maximum scenes the expert expands per query", 1)
    held_out: float = setting(0.05, "fraction of training statements held out to tune the stop rule", 0, 0.5)

    by_appearance: ClassVar = {
        "tower": {"solved": 16, "truth_only": 32},
        "scatter": {"collect_every": 10, "own_states": 0.4, "first_scenes": 2},
    }


_TEACHER = "imitate this reward model's search, from rewards and the rules of editing, instead of the expert"


@dataclass(frozen=True, slots=True)
class ImitationOptions(UpdateBudget):
    """The options of an imitation run besides its recipe."""

    updates: int = setting(3_600, "updates of the optimiser", 1)
    teacher: Path | None = setting(None, _TEACHER, kind=Path, metavar="RUN")


def _train(*arguments: Any, **options: Any) -> Any:
    from lilgym_mp.learning.imitation.training import train_imitation

    return train_imitation(*arguments, **options)


def _load_agent(path: Path, device: str) -> Any:
    from lilgym_mp.learning.imitation.agent import ImitationAgent

    return ImitationAgent.load(path, device)


LEARNER = Learner(ImitationRecipe, ImitationOptions, _train, _load_agent, __doc__)
