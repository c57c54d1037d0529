"""Words of statements: forms, vocabularies, and fixed-length arrays of token ids."""

from __future__ import annotations

import json
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from lilgym_mp.corpus.locations import PathLike
from lilgym_mp.scene.arrays import Int64Array, Strings

PAD = 0
UNKNOWN = 1
FIRST_WORD = 2
FORMAT = "lilgym_mp-vocabulary"
VERSION = 1
# Letters, and what words of Hebrew, Arabic, Indic and Thai scripts have besides: marks and joiners.
_LETTER = r"(?:[^\W_]|[\u0300-\u036f\u0591-\u05c7\u0610-\u061a\u064b-\u0670\u0900-\u0963\u0970-\u0e4e\u200c\u200d])"
_WORD = re.compile(rf"[^\W_]{_LETTER}*(?:['\u2019]{_LETTER}+)*")
NUMERALS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
_PLACEHOLDERS = {
    **dict.fromkeys(("yellow", "black", "blue"), "COLOUR"),
    **dict.fromkeys(("circle", "circles", "square", "squares", "triangle", "triangles"), "SHAPE"),
    **dict.fromkeys(("small", "medium", "big", "large"), "SIZE"),
    **dict.fromkeys(NUMERALS, "NUMBER"),
}


class VocabularyError(ValueError):
    """An invalid vocabulary, token id or length."""


@lru_cache(2**12)  # every new environment asks for those of its corpus
def words(statement: str) -> Strings:
    """The statement's words and numbers in lower case, without punctuation except apostrophes inside words."""
    return tuple(_WORD.findall(unicodedata.normalize("NFC", statement).lower()))


def normalised(statement: str) -> str:
    """The statement in lower case without punctuation."""
    return " ".join(words(statement))


def statement_form(statement: str) -> str:
    """The normalised statement with a placeholder for each colour, shape, size and number (words or digits)."""
    return " ".join("NUMBER" if word.isdigit() else _PLACEHOLDERS.get(word, word) for word in words(statement))


@dataclass(frozen=True)
class Vocabulary:
    """A mapping from words to token ids: 0 is padding, 1 unknown, then the words in the given order.

    Args:
        words: The words, all different.

    Raises:
        VocabularyError: For duplicate words.
    """

    words: Strings
    _ids: dict[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Raises VocabularyError for duplicate words."""
        ids = {word: token_id for token_id, word in enumerate(self.words, start=FIRST_WORD)}
        if len(ids) != len(self.words):
            repeated = sorted(word for word, count in Counter(self.words).items() if count > 1)
            raise VocabularyError(f"duplicate words: {', '.join(repeated)}")
        object.__setattr__(self, "_ids", ids)

    @classmethod
    def from_statements(cls, statements: Iterable[str]) -> Vocabulary:
        """The vocabulary of all words in the statements, sorted.

        Args:
            statements: The statements.
        """
        return cls(tuple(sorted({word for statement in statements for word in words(statement)})))

    def __len__(self) -> int:
        """The number of token ids, including padding and unknown."""
        return FIRST_WORD + len(self.words)

    def token_id(self, word: str) -> int:
        """The id of a word, or UNKNOWN.

        Args:
            word: The word, in lower case.
        """
        return self._ids.get(word, UNKNOWN)

    def encode(self, statement: str, length: int) -> Int64Array:
        """The statement's token ids, int64 (length,), padded or truncated at the end.

        Args:
            statement: The statement.
            length: The number of ids.
        """
        if length < 1:
            raise VocabularyError(f"length must be at least 1, not {length}")
        ids = [self.token_id(word) for word in words(statement)[:length]]
        encoded = np.full(length, PAD, dtype=np.int64)
        encoded[: len(ids)] = ids
        return encoded

    def decode(self, token_ids: Iterable[int]) -> list[str]:
        """The words of the token ids, "?" for unknown; padding is skipped.

        Args:
            token_ids: The ids.
        """
        return [self._word(int(token_id)) for token_id in token_ids if int(token_id) != PAD]

    def statement(self, token_ids: Iterable[int]) -> str:
        """A statement that `encode` turns into these token ids.

        Args:
            token_ids: The ids.
        """
        unknown = "x" * (1 + max(map(len, self.words), default=0))  # longer than any word of the vocabulary
        return " ".join(unknown if word == "?" else word for word in self.decode(token_ids))

    def _word(self, token_id: int) -> str:
        if token_id == UNKNOWN:
            return "?"
        if not FIRST_WORD <= token_id < len(self):
            raise VocabularyError(f"invalid token id {token_id}; choose from 0 to {len(self) - 1}")
        return self.words[token_id - FIRST_WORD]

    def save(self, path: PathLike) -> None:
        """Writes the vocabulary as JSON.

        Args:
            path: The file.
        """
        content = {"format": FORMAT, "version": VERSION, "words": list(self.words)}
        Path(path).write_text(json.dumps(content, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: PathLike) -> Vocabulary:
        """Reads a vocabulary written by `save`.

        Args:
            path: The file.

        Raises:
            VocabularyError: Naming the file and the fault.
        """
        try:
            content: Any = json.loads(Path(path).read_text(encoding="utf-8-sig"))
            kind = (content["format"], content["version"])
            listed = tuple(content["words"])
        except (OSError, ValueError, RecursionError, TypeError, KeyError) as fault:
            raise VocabularyError(f"{os.fspath(path)}: is no vocabulary that can be read: {fault!r}") from None
        if kind != (FORMAT, VERSION) or not all(isinstance(word, str) for word in listed):
            raise VocabularyError(f"{os.fspath(path)}: must have format {FORMAT!r}, version {VERSION}, texts as words")
        return cls(listed)
