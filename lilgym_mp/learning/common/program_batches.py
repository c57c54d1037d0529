"""Training on statement-program pairs, sampled from a corpus and from the generator."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import islice
from random import Random
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from lilgym_mp.corpus.generator import training_pairs
from lilgym_mp.corpus.held_out import statement_digest
from lilgym_mp.learning.common.optimisation import optimise
from lilgym_mp.learning.common.program_network import ParserNetwork, Sizes, Slots
from lilgym_mp.learning.common.program_pairs import Pair, normalise_statement, pair_of, slots_of, varied
from lilgym_mp.learning.common.recipes import PairRecipe
from lilgym_mp.learning.common.run_directory import TrainingRunError
from lilgym_mp.learning.common.words import pad_rows

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
        self._examples: list[Example | Pair] = list(examples)
        self._known = known

    def __len__(self) -> int:
        return len(self._examples)

    def sample(self, rng: Random) -> Pair:
        """A random pair. Raises TrainingRunError when no example has a program the parser can write."""
        while self._examples:
            index = rng.randrange(len(self._examples))
            found = self._examples[index]
            pair = found if isinstance(found, Pair) else _pair(found, self._known)
            if pair is not None:
                self._examples[index] = pair
                return pair
            self._examples[index] = self._examples[-1]  # its program has no prefix form or too many tokens
            del self._examples[-1]
        raise TrainingRunError("no training data: no statement has a program that the parser can write")


def _pair(example: Example, known: Collection[str]) -> Pair | None:
    normalised = normalise_statement(example.statement, example.appearance, known)
    return pair_of(normalised, example.program, most_tokens=Sizes.longest_program)


def generated_examples(
    appearance: str, seed: int, excluded: Collection[str], most: int | None = None
) -> Iterator[Example]:
    """The first `most` statements that the generator makes, or infinitely many, without those with excluded digests."""
    for statement, program in islice(training_pairs(appearance, seed), most):
        if statement_digest(statement) not in excluded:
            yield Example(statement, program, appearance)


def pairs_of(examples: Iterator[Example], known: Collection[str]) -> Iterator[Pair]:
    """The examples' pairs; those without one are skipped."""
    for example in examples:
        if (pair := _pair(example, known)) is not None:
            yield pair


PairSource = Callable[[Random], Pair]


class ProgramTrainer:
    """Trains a network to write the programs of statements, from a corpus and from generated pairs."""

    def __init__(
        self,
        network: ParserNetwork,
        recipe: PairRecipe,
        corpus: PairSource,
        generated: PairSource | None,
        indices: Callable[[Pair], tuple[list[int], list[int]]],
        rng: Random,
    ) -> None:
        """`indices`: the word and token indices of a pair."""
        self.network = network
        self._recipe = recipe
        self.optimiser = torch.optim.AdamW(
            network.parameters(), recipe.learning_rate, weight_decay=recipe.weight_decay, fused=True
        )
        self._device = network.logits.weight.device
        self._corpus = corpus
        self._generated = generated
        self._indices = indices
        self._rng = rng
        self._done = 0.0
        self._batches = self._sampled()

    def step(self, done: float, learning_rate: float, norm: float = 1.0) -> float:
        """One optimiser step on the cross-entropy of program tokens; returns the loss. Raises TrainingRunError.

        `done`: the training progress, 0 to 1. `norm`: the largest of the gradient.
        """
        self._done = done
        self.network.train()
        words, tokens, slots = next(self._batches)
        logits = self.network(words, tokens, slots).flatten(0, 1)
        smoothing = self._recipe.smoothing
        loss = functional.cross_entropy(logits, tokens.flatten(), ignore_index=0, label_smoothing=smoothing)
        optimise(self.optimiser, loss, norm, learning_rate)
        return loss.item()

    def _sampled(self) -> Iterator[tuple[Tensor, Tensor, Slots]]:
        """Infinite `_batch`es of pairs of similar length; the fraction of generated ones falls linearly."""
        recipe = self._recipe
        size = self._recipe.batch_size
        rng = self._rng
        generated = self._generated
        while True:
            fraction = recipe.generated * (1 + (FINAL_GENERATED - 1) * self._done) if generated else 0.0
            chosen = (generated if generated and rng.random() < fraction else self._corpus for _ in range(POOL * size))
            pool = [varied(source(rng), recipe.shapes, recipe.numbers, rng) for source in chosen]
            pool.sort(key=lambda pair: (len(pair.tokens), len(pair.words)))
            batches = [pool[first : first + size] for first in range(0, len(pool), size)]
            rng.shuffle(batches)
            yield from (_batch([self._indices(pair) for pair in pairs], self._device) for pairs in batches)


def _batch(pairs: Sequence[tuple[list[int], list[int]]], device: torch.device) -> tuple[Tensor, Tensor, Slots]:
    """(B, words) word indices, (B, length) token indices and the tokens' slots, right-padded with 0."""
    slots = [list(slots_of(tokens)) for _, tokens in pairs]
    parents, arguments = ([[slot[field] for slot in row] for row in slots] for field in range(2))
    columns = [words for words, _ in pairs], [tokens for _, tokens in pairs], parents, arguments
    words, tokens, *places = (torch.from_numpy(pad_rows(rows)).to(device) for rows in columns)
    return words, tokens, Slots(*places)
