"""Statements as words and as fixed-length arrays of token ids."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

PAD, UNKNOWN = 0, 1
FIRST_WORD = 2
FORMAT = "lilgym_mp-vocabulary"
VERSION = 1
_WORD = re.compile(r"[^\W_]+(?:['\u2019][^\W_]+)*")


class VocabularyError(ValueError):
    """A vocabulary that cannot be used."""


def words(statement: str) -> list[str]:
    """The statement's words and numbers in lower case; apostrophes inside a word stay, punctuation goes."""
    return _WORD.findall(statement.lower())


@dataclass(frozen=True)
class Vocabulary:
    """A fixed numbering of words: 0 is padding, 1 any unknown word, then the words in the order given."""

    words: tuple[str, ...]
    _numbers: dict[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Raises VocabularyError for a word that stands twice."""
        numbers = {word: number for number, word in enumerate(self.words, start=FIRST_WORD)}
        if len(numbers) != len(self.words):
            repeated = sorted({word for word in self.words if self.words.count(word) > 1})
            raise VocabularyError(f"words stand twice: {', '.join(repeated)}")
        object.__setattr__(self, "_numbers", numbers)

    @classmethod
    def from_statements(cls, statements: Iterable[str]) -> Vocabulary:
        """Every word of the statements, sorted."""
        return cls(tuple(sorted({word for statement in statements for word in words(statement)})))

    def __len__(self) -> int:
        """How many numbers there are, padding and unknown included."""
        return FIRST_WORD + len(self.words)

    def number(self, word: str) -> int:
        return self._numbers.get(word, UNKNOWN)

    def encode(self, statement: str, length: int) -> npt.NDArray[np.int64]:
        """The statement's token ids, shape (length,): padded at the end, cut when longer."""
        if length < 1:
            raise VocabularyError(f"length must be at least 1, not {length}")
        numbers = [self.number(word) for word in words(statement)[:length]]
        encoded = np.full(length, PAD, dtype=np.int64)
        encoded[: len(numbers)] = numbers
        return encoded

    def decode(self, numbers: Iterable[int]) -> list[str]:
        """The words behind the numbers, "?" for unknown ones, padding left out."""
        return [self._word(int(number)) for number in numbers if int(number) != PAD]

    def _word(self, number: int) -> str:
        if number == UNKNOWN:
            return "?"
        if not FIRST_WORD <= number < len(self):
            raise VocabularyError(f"no word has number {number}; numbers are 0 to {len(self) - 1}")
        return self.words[number - FIRST_WORD]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the words as JSON."""
        content = {"format": FORMAT, "version": VERSION, "words": list(self.words)}
        Path(path).write_text(json.dumps(content, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Vocabulary:
        """The vocabulary that `save` wrote. Raises VocabularyError naming the file and the fault."""
        try:
            content: object = json.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as fault:
            raise VocabularyError(f"{os.fspath(path)}: cannot be read: {fault}") from None
        record = cast("dict[str, object]", content) if isinstance(content, dict) else {}
        if record.get("format") != FORMAT or record.get("version") != VERSION:
            raise VocabularyError(f"{os.fspath(path)}: must be a JSON object of format {FORMAT!r}, version {VERSION}")
        listed = record.get("words")
        if not isinstance(listed, list) or not all(isinstance(word, str) for word in cast("list[object]", listed)):
            raise VocabularyError(f"{os.fspath(path)}: words must be a list of texts")
        return cls(tuple(cast("list[str]", listed)))
