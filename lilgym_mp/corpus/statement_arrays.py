"""Statements of tasks as padded arrays of token ids; the vocabulary comes from `training_tasks`."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from lilgym_mp.corpus.faults import NoTasksError
from lilgym_mp.corpus.loading import load_tasks
from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.corpus.tokens import Vocabulary, words
from lilgym_mp.scene.arrays import Int64Array
from lilgym_mp.scene.choices import checked_count

VOCABULARY_SPLIT = "train"
LENGTH_FACTOR = 1.25  # default length relative to the longest train statement
VocabularyOrPath = Vocabulary | Mapping[str, Sequence[str]] | str | os.PathLike[str]
LENGTH_MULTIPLE = 4  # the default length is rounded up to a multiple of this


def statements_of(tasks: TaskSet) -> list[str]:
    """The distinct statements, in file order."""
    return list({task.statement: None for task in tasks})


def training_tasks(tasks: TaskSet) -> TaskSet:
    """The train split of the tasks' corpus; the tasks themselves if it has none."""
    origin = tasks.provenance
    if origin.split == VOCABULARY_SPLIT:
        return tasks
    try:
        return load_tasks(origin.corpus, origin.appearance, origin.start, VOCABULARY_SPLIT)
    except NoTasksError:
        return tasks


def default_length(statements: Iterable[str]) -> int:
    """The padded length: the number of words of the longest statement, with some headroom."""
    longest = max([1, *(len(words(statement)) for statement in statements)])
    return LENGTH_MULTIPLE * math.ceil(longest * LENGTH_FACTOR / LENGTH_MULTIPLE)


class StatementArrays:
    """Token ids by task; by default, vocabulary and length come from `training_tasks`."""

    def __init__(
        self,
        tasks: TaskSet,
        vocabulary: VocabularyOrPath | None = None,
        length: int | None = None,
        *,
        truncate: bool = False,
    ) -> None:
        """`truncate`: statements that exceed the length; otherwise they are a ValueError."""
        if length is not None:
            length = checked_count("length", length, of=" of words or None")
        training = statements_of(training_tasks(tasks)) if vocabulary is None or length is None else []
        if isinstance(vocabulary, str | os.PathLike):
            vocabulary = Vocabulary.load(vocabulary)
        elif isinstance(vocabulary, Mapping):  # from the JSON of an environment's spec
            vocabulary = Vocabulary(tuple(vocabulary["words"]))
        self.vocabulary = vocabulary or Vocabulary.from_statements(training)
        self.length = length or default_length(training)
        self._truncates = truncate
        self.set_tasks(tasks)

    def set_tasks(self, tasks: TaskSet) -> None:
        """Replaces the tasks, keeping vocabulary and length. Raises ValueError when a statement is too long."""
        self._encoded: dict[str, Int64Array] = {}
        longest_first = sorted(statements_of(tasks), key=lambda statement: -len(words(statement)))
        self._encoded = {statement: self.row(statement) for statement in longest_first}
        self.rows: Int64Array = np.stack([self._encoded[task.statement] for task in tasks])  # (tasks, L)

    def row(self, statement: str) -> Int64Array:
        """(length,) the token ids of a statement. Raises ValueError when it is too long."""
        if statement in self._encoded:
            return self._encoded[statement]
        count = len(words(statement))
        if count > self.length and not self._truncates:
            raise ValueError(
                f"the statement {statement!r} has {count} words, but length is {self.length}: set length={count} or"
                " more, or truncate longer statements with the wrapper TokenizedStatement(env, truncate=True)"
            )
        return self.vocabulary.encode(statement, self.length)
