"""Statements as arrays of token ids."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.arrays import Int64Array
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.corpus.statement_arrays import (
    check_lengths,
    checked_length,
    default_length,
    statement_rows,
    statements_of,
    training_statements,
)
from lilgym_mp.wrappers.env_state import EnvDescription, EnvState
from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Batch, Format

STATEMENT = "statement"  # observation key


class Tokens(Format):
    """Replaces the statement by token ids, looked up by task."""

    replaces = (STATEMENT,)

    def __init__(
        self,
        description: EnvDescription,
        *,
        vocabulary: Vocabulary | str | os.PathLike[str] | None,
        length: int | None,
        truncate: bool,
    ) -> None:
        super().__init__(description)
        description.part(STATEMENT)
        if isinstance(vocabulary, str | os.PathLike):
            vocabulary = Vocabulary.load(vocabulary)
        if vocabulary is None:
            vocabulary = Vocabulary.from_statements(training_statements(description.tasks))
        self.vocabulary = vocabulary
        self.length = (
            default_length(training_statements(description.tasks)) if length is None else checked_length(length)
        )
        if not truncate:
            check_lengths(statements_of(description.tasks), self.length)

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        return {STATEMENT: spaces.Box(0, len(self.vocabulary) - 1, (self.length,), np.int64)}

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        return {STATEMENT: self._by_task.take(state.task_indices, axis=0)}

    @cached_property
    def _by_task(self) -> Int64Array:
        """(tasks, length) the token ids of each task's statement."""
        return statement_rows(self.env_description.tasks, self.vocabulary, self.length)


class TokenizedStatement(EnvWrapper[Tokens]):
    """Replaces "statement" by token ids, int64 (length,): 0 is padding, 1 any unknown word.

    `vocabulary`: a Vocabulary or the path of a saved one; None: the words of the corpus's train split.
    `length`: None: the longest statement of the train split and a quarter more.
    Raises ValueError if a statement of the environment's tasks is longer, unless `truncate`.
    """

    transformation_class = Tokens

    def __init__(
        self,
        env: gym.Env[Any, Any],
        vocabulary: Vocabulary | str | os.PathLike[str] | None = None,
        length: int | None = None,
        *,
        truncate: bool = False,
    ) -> None:
        super().__init__(env, vocabulary=vocabulary, length=length, truncate=truncate)

    @property
    def vocabulary(self) -> Vocabulary:
        return self.transformation.vocabulary


tokenized_statement_v0 = factory(TokenizedStatement)
