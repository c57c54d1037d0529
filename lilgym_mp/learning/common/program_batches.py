"""Training batches of statement-program pairs, sampled from a corpus and from the generator."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from lilgym_mp.learning.common.program_network import ParserNetwork, Sizes, Slots
from lilgym_mp.learning.common.program_pairs import Pair, Variations, normalise_statement, pair_of, slots_of
from lilgym_mp.learning.common.run_directory import NotFiniteError, TrainingError

FINAL_GENERATED = 1 / 8  # fraction of generated pairs at the last step, relative to the first
POOL = 16  # batches sampled together and sorted by length


class Example(NamedTuple):
    """A statement with its program."""

    statement: str
    program: str
    appearance: str


class ExamplePool:
    """A finite dataset sampled with replacement; examples are tokenised when first sampled."""

    def __init__(self, examples: Sequence[Example], known: frozenset[str]) -> None:
        self.appearances = {example.appearance for example in examples}
        self._examples = list(examples)
        self._pairs: list[Pair | None] = [None] * len(examples)
        self._known = known

    def __len__(self) -> int:
        return len(self._examples)

    def sample(self, rng: random.Random) -> Pair:
        """A random pair. Raises TrainingError when no example has a program the parser can write."""
        while self._examples:
            index = rng.randrange(len(self._examples))
            pair = self._pairs[index] or self._tokenised(index)
            if pair is not None:
                return pair
        raise TrainingError("no training data: no statement has a program that the parser can write")

    def _tokenised(self, index: int) -> Pair | None:
        """The example's pair; None, removing the example, if its program has no prefix form or too many tokens."""
        pair = self._pairs[index] = _pair(self._examples[index], self._known)
        if pair is None:
            self._examples[index], self._pairs[index] = self._examples[-1], self._pairs[-1]
            del self._examples[-1], self._pairs[-1]
        return pair


def _pair(example: Example, known: Collection[str]) -> Pair | None:
    normalised = normalise_statement(example.statement, example.appearance, known)
    return pair_of(normalised, example.program, most_tokens=Sizes.longest_program)


@dataclass(frozen=True)
class ExampleStream:
    """An infinite stream of examples."""

    examples: Iterator[Example]
    known: Collection[str]

    def sample(self, rng: random.Random) -> Pair:
        """The next pair; examples without one are skipped."""
        return next(pair for example in self.examples if (pair := _pair(example, self.known)) is not None)


PairSource = ExamplePool | ExampleStream


class Batch(NamedTuple):
    """Index tensors, right-padded with 0."""

    words: Tensor  # (B, words)
    tokens: Tensor  # (B, length)
    slots: Slots


def generated_fraction(initial: float, done: float) -> float:
    """The fraction of generated pairs, annealed linearly in the training progress `done`, 0 to 1."""
    return initial * (1 + (FINAL_GENERATED - 1) * done)


def sample_batches(
    corpus: PairSource,
    generated: PairSource | None,
    current_fraction: Callable[[], float],
    variations: Variations,
    indices: Callable[[Pair], tuple[list[int], list[int]]],
    size: int,
    rng: random.Random,
    device: torch.device,
) -> Iterator[Batch]:
    """Infinite batches of `size` pairs of similar length.

    `current_fraction`: the fraction of generated pairs now; `indices`: the word and token indices of a pair.
    """
    while True:
        fraction = 0.0 if generated is None else current_fraction()
        chosen = (generated if generated and rng.random() < fraction else corpus for _ in range(POOL * size))
        pool = [variations.of(source.sample(rng), rng) for source in chosen]
        pool.sort(key=lambda pair: (len(pair.tokens), len(pair.words)))
        batches = [pool[first : first + size] for first in range(0, len(pool), size)]
        rng.shuffle(batches)
        yield from (_batch([indices(pair) for pair in pairs], device) for pairs in batches)


def _batch(pairs: Sequence[tuple[list[int], list[int]]], device: torch.device) -> Batch:
    tokens = [row for _, row in pairs]
    slots = [list(slots_of(row)) for row in tokens]

    def padded(rows: Sequence[Sequence[int]]) -> Tensor:
        longest = max(map(len, rows))
        return torch.tensor([[*row, *[0] * (longest - len(row))] for row in rows], device=device)

    return Batch(
        padded([words for words, _ in pairs]),
        padded(tokens),
        Slots(
            padded([[slot.parent for slot in row] for row in slots]),
            padded([[slot.argument for slot in row] for row in slots]),
        ),
    )


def training_step(
    network: ParserNetwork, batch: Batch, optimiser: torch.optim.Optimizer, smoothing: float, norm: float = 1.0
) -> float:
    """One optimiser step on the cross-entropy of program tokens; returns the loss. Raises NotFiniteError."""
    network.train()
    words, tokens, slots = batch
    logits = network(words, tokens, slots)
    loss = functional.cross_entropy(logits.flatten(0, 1), tokens.flatten(), ignore_index=0, label_smoothing=smoothing)
    if not math.isfinite(loss.item()):
        raise NotFiniteError(f"text {loss.item():g}")
    optimiser.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(network.parameters(), norm)
    optimiser.step()
    return loss.item()
