"""Hyperparameters of the parser. Imports no torch."""

from __future__ import annotations

from dataclasses import dataclass

from lilgym_mp.learning.common.recipes import HEADS, PairRecipe, setting

OBJECTIVES = ("accuracy", "return")


@dataclass(frozen=True)
class ParserRecipe(PairRecipe):
    """Everything the parser's training depends on, except its corpus."""

    seed: int = setting(0, "seed of the network, the pairs and their order")
    updates: int = setting(6_000, "optimiser steps", 1)
    warm_up: int = setting(100, "updates of linear warm-up", 1)
    dropout: float = setting(0.2, "dropout rate", 0, 1)
    generated_pairs: int = setting(40_000, "maximum number of distinct generated pairs", 1)
    held_out: int = setting(300, "training statements held out to calibrate probabilities")
    width: int = setting(96, "network width", 1, multiple_of=HEADS)
    objective: str = setting(
        "accuracy",
        "what plans maximise: expected accuracy, or expected return, which edits reduce",
        choices=OBJECTIVES,
    )
