"""The statements of tasks as arrays of token ids, by default in the words of the corpus's train split."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from lilgym_mp.corpus.loading import load_tasks
from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.corpus.tokens import Vocabulary, words

VOCABULARY_SPLIT = "train"
ROOM = 1.25  # the default length is this many times the longest statement of the vocabulary's split
LENGTH_STEP = 4  # rounded up to a multiple of this


def statements_of(tasks: TaskSet) -> list[str]:
    """Every statement once, in file order."""
    return list({task.statement: None for task in tasks})


def training_statements(tasks: TaskSet) -> list[str]:
    """The statements of the training split of the corpus that `tasks` come from."""
    origin = tasks.provenance
    if origin.split != VOCABULARY_SPLIT:
        tasks = load_tasks(origin.corpus, origin.appearance, origin.start, VOCABULARY_SPLIT)
    return statements_of(tasks)


def default_length(statements: Iterable[str]) -> int:
    """The longest statement's number of words, with room for somewhat longer ones."""
    longest = max(len(words(statement)) for statement in statements)
    return LENGTH_STEP * math.ceil(longest * ROOM / LENGTH_STEP)


def refuse_longer(statements: Iterable[str], length: int) -> None:
    """Raises ValueError naming a statement of more words than `length`."""
    longest = max(statements, key=lambda statement: len(words(statement)))
    count = len(words(longest))
    if count > length:
        raise ValueError(
            f"the statement {longest!r} has {count} words, length is {length}: choose length={count} or more,"
            " or truncate=True to cut what is longer"
        )


def statement_rows(tasks: TaskSet, vocabulary: Vocabulary, length: int) -> npt.NDArray[np.int64]:
    """(tasks, length) the token ids of each task's statement."""
    encoded = {statement: vocabulary.encode(statement, length) for statement in statements_of(tasks)}
    return np.stack([encoded[task.statement] for task in tasks])


class StatementArrays:
    """Word numbers by task, in the words and the length that the train split of the tasks' corpus gives."""

    def __init__(self, tasks: TaskSet) -> None:
        """Raises ValueError when a statement of `tasks` is longer than the train split gives room for."""
        training = training_statements(tasks)
        self.vocabulary = Vocabulary.from_statements(training)
        self.length = default_length(training)
        self.play(tasks)

    def play(self, tasks: TaskSet) -> None:
        """Gives the rows of other tasks from now on. Raises ValueError when a statement of theirs is too long."""
        refuse_longer(statements_of(tasks), self.length)
        self.rows = statement_rows(tasks, self.vocabulary, self.length)
