"""Batches of statements with programs, as indices, sample from a corpus and from the generator."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from lilgym_mp.corpus import NoTasksError, load_all_tasks
from lilgym_mp.corpus.forms import normalised
from lilgym_mp.learning.parsing.network import Sizes, Slots
from lilgym_mp.learning.parsing.pairs import Pair, Variations, normalise_statement, pair_of, slots_of
from lilgym_mp.learning.training_run import TrainingError

LAST_GENERATED = 1 / 8  # of the generator's share at the first step, at the last one
POOL = 16  # batches that are sample together and sorted by length


class Example(NamedTuple):
    """A statement of the corpus with its program."""

    statement: str
    program: str
    appearance: str


class ExamplePool:
    """Examples to draw pairs from; each is brought into the parser's terms when it is first sample."""

    def __init__(self, examples: Sequence[Example], known: frozenset[str]) -> None:
        self.appearances = {example.appearance for example in examples}
        self._examples = list(examples)
        self._pairs: list[Pair | None] = [None] * len(examples)
        self._known = known

    def __len__(self) -> int:
        return len(self._examples)

    def sample(self, rng: random.Random) -> Pair:
        """A pair at random. Raises TrainingError when no example has a program that can be learnt."""
        while self._examples:
            index = rng.randrange(len(self._examples))
            pair = self._pairs[index] or self._made(index)
            if pair is not None:
                return pair
        raise TrainingError("nothing to learn from: no statement has a program that the parser can write")

    def _made(self, index: int) -> Pair | None:
        """The pair of an example; one that has none is dropped."""
        statement, program, appearance = self._examples[index]
        normalised = normalise_statement(statement, appearance, self._known)
        pair = self._pairs[index] = pair_of(normalised, program, most_tokens=Sizes.longest_program)
        if pair is None:
            self._examples[index], self._pairs[index] = self._examples[-1], self._pairs[-1]
            del self._examples[-1], self._pairs[-1]
        return pair


class ExampleStream:
    """Examples without end, each sample once."""

    def __init__(self, examples: Iterator[Example], known: frozenset[str]) -> None:
        self._examples = examples
        self._known = known

    def sample(self, rng: random.Random) -> Pair:
        """The next example's pair; those that have none are passed over."""
        while True:
            statement, program, appearance = next(self._examples)
            normalised = normalise_statement(statement, appearance, self._known)
            pair = pair_of(normalised, program, most_tokens=Sizes.longest_program)
            if pair is not None:
                return pair


class PairSource(Protocol):
    """What pairs are sample from."""

    def sample(self, rng: random.Random) -> Pair: ...


class PairSources(NamedTuple):
    """Where pairs come from."""

    corpus: PairSource
    generated: PairSource | None


def evaluation_statements(corpus: str) -> set[str]:
    """The statements of the corpus's other splits, normalised: what no generated statement may be, even by chance."""
    try:
        sets = list(load_all_tasks(corpus, splits=("dev", "test")))
    except NoTasksError:
        return set()
    return {normalised(task.statement) for tasks in sets for task in tasks}


class Batch(NamedTuple):
    """Pairs as indices, padded at the end."""

    words: Tensor  # (B, words)
    tokens: Tensor  # (B, length)
    slots: Slots


def generated_share(first: float, done: float) -> float:
    """The generator's share of the pairs when `done`, 0 to 1, of the steps are made: the language at large comes
    first, what the corpus says last."""
    return first * (1 + (LAST_GENERATED - 1) * done)


def sample_batches(
    sources: PairSources,
    share: Callable[[], float],
    variations: Variations,
    indices: Callable[[Pair], tuple[list[int], list[int]]],
    size: int,
    rng: random.Random,
    device: torch.device,
) -> Iterator[Batch]:
    """Endless batches of `size` pairs of nearly equal length.

    `share`: the generator's share of the pairs now; `indices`: of a pair's words and of its tokens.
    """
    corpus, generated = sources
    while True:
        now = 0.0 if generated is None else share()
        chosen = (generated if generated and rng.random() < now else corpus for _ in range(POOL * size))
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
            padded([[slot.part for slot in row] for row in slots]),
        ),
    )
