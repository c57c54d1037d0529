"""Hyperparameters of the parser. Imports no torch."""

from __future__ import annotations

from dataclasses import dataclass

from lilgym_mp.learning.recipes import Recipe, setting

OBJECTIVES = ("accuracy", "return")
HEADS = 4  # attention heads; must divide the width


@dataclass(frozen=True)
class ParserRecipe(Recipe):
    """Everything the parser's training depends on, except its corpus."""

    seed: int = setting(0, "seed of the network, the pairs and their order")
    updates: int = setting(6_000, "optimiser steps", 1)
    batch_size: int = setting(32, "pairs per batch", 1)
    learning_rate: float = setting(2e-3, "peak learning rate of AdamW; cosine decay to 0", 1e-9)
    warm_up: int = setting(100, "updates of linear warm-up", 1)
    weight_decay: float = setting(0.01, "weight decay of AdamW")
    dropout: float = setting(0.2, "dropout rate", 0, 1)
    smoothing: float = setting(0.05, "label smoothing", 0, 1)
    unknown: float = setting(0.03, "word dropout: fraction of words replaced by the unknown word", 0, 1)
    generated: float = setting(0.8, "initial fraction of generated pairs; it falls linearly to an eighth of that", 0, 1)
    generated_pairs: int = setting(40_000, "maximum number of distinct generated pairs", 1)
    shapes: float = setting(0.5, "fraction of pairs augmented by exchanging shapes", 0, 1)
    numbers: float = setting(0.5, "fraction of pairs augmented by exchanging numbers", 0, 1)
    held_out: int = setting(300, "training statements held out to calibrate probabilities")
    width: int = setting(96, "network width", 1, multiple_of=HEADS)
    objective: str = setting(
        "accuracy",
        "what plans maximise: expected accuracy, or expected return, which edits reduce",
        choices=OBJECTIVES,
    )
