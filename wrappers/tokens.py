"""Statements as arrays of token ids."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.corpus.statement_arrays import StatementArrays, VocabularyOrPath
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Batch, EnvDescription, EnvState, Format

STATEMENT = "statement"  # observation key


class Tokens(Format):
    """Replaces the statement by token ids, looked up by task."""

    replaces = (STATEMENT,)

    def __init__(
        self, description: EnvDescription, *, vocabulary: VocabularyOrPath | None, length: int | None, truncate: bool
    ) -> None:
        super().__init__(description)
        description.part(STATEMENT)
        self.arrays = StatementArrays(description.tasks, vocabulary, length, truncate=truncate)

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        return {STATEMENT: spaces.Box(0, len(self.arrays.vocabulary) - 1, (self.arrays.length,), np.int64)}

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        return {STATEMENT: state.by_task(self.arrays.rows, lambda task: self.arrays.row(task.statement))}


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
        vocabulary: VocabularyOrPath | None = None,
        length: int | None = None,
        *,
        truncate: bool = False,
    ) -> None:
        super().__init__(env, vocabulary=vocabulary, length=length, truncate=truncate)

    @property
    def vocabulary(self) -> Vocabulary:
        return self.transformation.arrays.vocabulary
