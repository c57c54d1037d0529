"""Pretraining before imitation: the text encoder on writing programs, the cell geometry on legal edits (Scatter)."""

from __future__ import annotations

import math
import random
from collections.abc import Collection, Sequence

import numpy as np
import torch
from torch.nn import functional

from lilgym_mp.corpus.tokens import UNKNOWN
from lilgym_mp.learning.common.attention import MAX_WORDS
from lilgym_mp.learning.common.optimisation import optimise, warm_up
from lilgym_mp.learning.common.program_batches import Example, ExamplePool, ProgramTrainer, generated_examples, pairs_of
from lilgym_mp.learning.common.program_network import ParserNetwork, Sizes
from lilgym_mp.learning.common.program_pairs import COLOURS, TOKENS, Pair, exchanged, tokens_recoloured
from lilgym_mp.learning.common.recipes import PairRecipe
from lilgym_mp.learning.common.words import StatementTokenizer
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.dataset import DatasetEntry
from lilgym_mp.learning.imitation.learner import ImitationRecipe
from lilgym_mp.learning.imitation.network import CellGeometry, ImitationNetwork
from lilgym_mp.scene.arrays import Rng

PARSER = PairRecipe()  # hyperparameters shared with parse and plan
GEOMETRY_LEARNING_RATE = 0.01
BOXES = 128  # per batch


class TextPretraining:
    """Trains the network's text encoder with a program decoder on top, on training and generated statements.

    The decoder is discarded. Colours are permuted at random, as in imitation.
    """

    def __init__(
        self,
        network: ImitationNetwork,
        tokenizer: StatementTokenizer,
        entries: Sequence[DatasetEntry],
        appearance: str,
        excluded: Collection[str],
        recipe: ImitationRecipe,
        seed: int,
    ) -> None:
        """`excluded`: digests of dev and test statements, which are dropped from the generated ones."""
        self._tokenizer = tokenizer
        self._recipe = recipe
        self._rng = random.Random(f"text {seed}")
        device = next(network.parameters()).device
        sizes = Sizes(width=recipe.width, hidden=3 * recipe.width, longest_statement=MAX_WORDS)
        parser = ParserNetwork(0, len(TOKENS), sizes, recipe.dropout, network.text).to(device)
        known = frozenset(tokenizer.vocabulary.words)
        corpus = ExamplePool([Example(entry.statement, entry.program.source, appearance) for entry in entries], known)
        generated = pairs_of(generated_examples(appearance, seed, excluded), known)
        self._trainer = ProgramTrainer(
            parser, PARSER, corpus.sample, lambda rng: next(generated), self._indices, self._rng
        )

    def step(self, done: float) -> float:
        """One optimiser step; returns the loss. `done`: the fraction completed, 0 to 1. Raises TrainingRunError."""
        learning_rate = PARSER.learning_rate * warm_up(done, self._recipe.warmup) * (1 - done)
        return self._trainer.step(done, learning_rate, self._recipe.gradient_norm)

    def _indices(self, pair: Pair) -> tuple[list[int], list[int]]:
        rng = self._rng
        recipe = self._recipe
        token_id = self._tokenizer.vocabulary.token_id
        exchange = dict(zip(COLOURS, rng.sample(COLOURS, 3) if recipe.recolour else COLOURS, strict=True))
        recoloured = exchanged(pair.words[1:], exchange)[:MAX_WORDS]  # without the appearance token
        dropped = PARSER.unknown if recipe.unknown_words else 0.0
        words = [UNKNOWN if rng.random() < dropped else token_id(word) for word in recoloured]
        return words or [UNKNOWN], [TOKENS.index(token) for token in tokens_recoloured(pair.tokens, exchange)]


def pretrain_geometry(geometry: CellGeometry, table: BoxFeatureTable, updates: int, warmup: float, rng: Rng) -> None:
    """Trains it to predict the legal edits of the boxes collected so far. Raises TrainingRunError."""
    device = geometry.cells.device
    optimiser = torch.optim.AdamW(geometry.parameters(), GEOMETRY_LEARNING_RATE, weight_decay=0.0, fused=True)
    table.update_features()
    for done in (update / updates for update in range(updates)):
        chosen = rng.integers(len(table), size=BOXES)
        offsets = torch.from_numpy(table.offsets[chosen].astype(np.int64)).to(device)
        legal = torch.from_numpy(table.legal[chosen].astype(np.float32)).to(device)
        _, logits = geometry(geometry.item_terms(offsets).sum(1))
        loss = functional.binary_cross_entropy_with_logits(logits, legal)
        learning_rate = GEOMETRY_LEARNING_RATE * warm_up(done, warmup) * (1 - done)
        optimise(optimiser, loss, math.inf, learning_rate)
