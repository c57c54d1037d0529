"""Statements as word indices, with number words as digits and misspellings repaired.

PPO, the game and agents of Stable-Baselines3 read words as written instead (`Vocabulary.encode`), as batches of
environments give them. Which of the two an agent reads is fixed by the vocabulary in its model file: there the former
has number words and misspellings, and no digits.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

import numpy as np

from lilgym_mp.corpus.spelling import normalised_words, plain_words
from lilgym_mp.corpus.tokens import PAD, UNKNOWN, Vocabulary
from lilgym_mp.learning.common.attention import MAX_WORDS
from lilgym_mp.learning.common.augmentation import RECOLOURINGS
from lilgym_mp.scene import Colour
from lilgym_mp.scene.arrays import Int64Array

CACHED_STATEMENTS = 20_000
MAX_CHARACTERS = 1_000  # longer statements are truncated
FEW_STATEMENTS = 100  # with more than this, a word that occurs in only one statement counts as a misspelling
DIGITS = tuple(map(str, range(1, 10)))


def vocabulary_of(statements: Iterable[str]) -> Vocabulary:
    """The words of the statements as written, without likely misspellings, and the digits."""
    word_sets = [set(plain_words(statement)) for statement in statements]
    counts = Counter(word for word_set in word_sets for word in word_set)
    least = 2 if len(word_sets) > FEW_STATEMENTS else 1
    return Vocabulary(tuple(sorted({*DIGITS, *(word for word, count in counts.items() if count >= least)})))


class StatementTokenizer:
    """Statements to word indices after `normalised_words`: digits for number words, misspellings repaired."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self._known = frozenset(vocabulary.words)
        names = [colour.name.lower() for colour in Colour]
        exchanges = [{name: recolouring.text(name) for name in names} for recolouring in RECOLOURINGS]
        self._recoloured = exchange_table(vocabulary, exchanges)

    @lru_cache(CACHED_STATEMENTS)  # noqa: B019 (of the class, so that tokenizers can be pickled)
    def encode(self, statement: str) -> Int64Array:
        """(T,) word indices, 1 <= T <= MAX_WORDS."""
        words = normalised_words(statement[:MAX_CHARACTERS], self._known)[:MAX_WORDS]
        return np.array([self.vocabulary.token_id(word) for word in words] or [UNKNOWN], np.int64)

    def recoloured(self, indices: Int64Array, recolouring: int) -> Int64Array:
        """The word indices with colour words permuted; `recolouring`: an index into RECOLOURINGS."""
        return self._recoloured[recolouring][indices]


def exchange_table(vocabulary: Vocabulary, exchanges: Sequence[Mapping[str, str]]) -> Int64Array:
    """(E, words) the index that each word's index becomes under each exchange, as far as both words are known."""
    table = np.tile(np.arange(len(vocabulary)), (len(exchanges), 1))
    for row, exchange in zip(table, exchanges, strict=True):
        for old, new in exchange.items():
            pair = vocabulary.token_id(old), vocabulary.token_id(new)
            if UNKNOWN not in pair:
                row[pair[0]] = pair[1]
    return table


def pad_rows(rows: Sequence[Int64Array | Sequence[int]], min_length: int = 0) -> Int64Array:
    """(B, T) the rows right-padded with PAD to the longest, at least `min_length`."""
    padded = np.full((len(rows), max(min_length, *map(len, rows))), PAD, np.int64)
    for padded_row, row in zip(padded, rows, strict=True):
        padded_row[: len(row)] = row
    return padded
