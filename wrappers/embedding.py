"""Statements as vectors from an encoder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from lilgym_mp.arrays import Float32Array, Int64Array
from lilgym_mp.wrappers.env_state import EnvDescription, EnvState
from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.tokens import STATEMENT
from lilgym_mp.wrappers.transformation import Batch, Format


@runtime_checkable
class SentenceEncoder(Protocol):
    """What sentence-transformers' models are, among others."""

    def encode(self, sentences: Sequence[str], /) -> ArrayLike:
        """(sentences, D) one vector each."""
        ...


Encoder = Callable[[str], ArrayLike] | SentenceEncoder


class Embedding(Format):
    """The encoder's vector of the statement, computed once per statement."""

    replaces = (STATEMENT,)

    def __init__(self, description: EnvDescription, *, encoder: Encoder, limit: float) -> None:
        super().__init__(description)
        self._limit = limit
        description.part(STATEMENT)
        if isinstance(encoder, str) or not (isinstance(encoder, SentenceEncoder) or callable(encoder)):
            raise ValueError(f"encoder must be a function of a statement or have a method encode, not {encoder!r}")
        self._encoder = encoder
        self._by_statement: dict[str, Float32Array] = {}
        first = self._encoded(description.tasks[0].statement)
        if first.ndim != 1 or not first.size:
            raise ValueError(f"encoder must give one vector of a statement, not an array of shape {first.shape}")
        self.dimension = first.size
        self._by_task = np.zeros((len(description.tasks), self.dimension), np.float32)
        self._known = np.zeros(len(description.tasks), np.bool_)

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        return {STATEMENT: spaces.Box(-self._limit, self._limit, (self.dimension,), np.float32)}

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        numbers = state.task_numbers
        self._learn(numbers[~self._known[numbers]])
        return {STATEMENT: self._by_task[numbers]}

    def _learn(self, task_numbers: Int64Array) -> None:
        for number in task_numbers.tolist():
            statement = self.env_description.tasks[number].statement
            vector = self._by_statement.get(statement)
            if vector is None:
                vector = self._by_statement[statement] = self._encoded(statement)
            self._by_task[number] = self._checked(vector, statement)
            self._known[number] = True

    def _checked(self, vector: Float32Array, statement: str) -> Float32Array:
        if vector.shape != (self.dimension,):
            expected = f"the first had ({self.dimension},)"
            raise ValueError(f"encoder gave an array of shape {vector.shape} for {statement!r}; {expected}")
        if not (np.abs(vector) <= self._limit).all():
            raise ValueError(f"encoder gave numbers beyond limit={self._limit} for {statement!r}: {vector}")
        return vector

    def _encoded(self, statement: str) -> Float32Array:
        encoder = self._encoder
        vector = (
            np.asarray(encoder.encode([statement]))[0] if isinstance(encoder, SentenceEncoder) else encoder(statement)
        )
        return np.asarray(vector, np.float32)


class StatementEmbedding(EnvWrapper[Embedding]):
    """Turns "statement" into the encoder's vector, float32 (D,), computed once per statement.

    `encoder`: a function from a statement to D numbers, or an object with sentence-transformers' `encode`. `limit`:
    the largest absolute value that it may give, the bound of the space. The
    spec of the wrapped environment holds the encoder itself, so it has no JSON form.
    """

    transformation_class = Embedding

    def __init__(self, env: gym.Env[Any, Any], encoder: Encoder, *, limit: float = 1000.0) -> None:
        super().__init__(env, encoder=encoder, limit=limit)


statement_embedding_v0 = factory(StatementEmbedding)
