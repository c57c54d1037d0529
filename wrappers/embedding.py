"""Statements as embeddings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.arrays import Float32Array
from lilgym_mp.task import Task
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.tokens import STATEMENT
from lilgym_mp.wrappers.transformation import Batch, EnvDescription, EnvState, Format

Encoder = Any  # a function of a statement that returns D numbers, or an object with sentence-transformers' `encode`


class Embedding(Format):
    """Replaces the statement by its embedding, cached by statement."""

    replaces = (STATEMENT,)

    def __init__(self, description: EnvDescription, *, encoder: Encoder, limit: float) -> None:
        super().__init__(description)
        self._limit = limit
        description.part(STATEMENT)
        if isinstance(encoder, str) or not (hasattr(encoder, "encode") or callable(encoder)):
            raise ValueError(f"encoder must be a function of a statement or have an encode method, not {encoder!r}")
        self._encoder = encoder
        self._by_statement: dict[str, Float32Array] = {}
        first = self._encode(description.tasks[0].statement)
        if first.ndim != 1 or not first.size:
            raise ValueError(f"encoder must return a vector, not an array of shape {first.shape}")
        self.dimension = first.size
        self._by_task = np.zeros((len(description.tasks), self.dimension), np.float32)
        self._is_filled = np.zeros(len(description.tasks), np.bool_)

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        return {STATEMENT: spaces.Box(-self._limit, self._limit, (self.dimension,), np.float32)}

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        indices = state.task_indices
        for index in indices[~self._is_filled.take(indices, mode="clip")].tolist():
            if index < len(self._by_task):
                self._by_task[index] = self._embedding(self.env_description.tasks[index])
                self._is_filled[index] = True
        return {STATEMENT: state.by_task(self._by_task, self._embedding)}

    def _embedding(self, task: Task) -> Float32Array:
        if task.statement not in self._by_statement:
            self._by_statement[task.statement] = self._checked(self._encode(task.statement), task.statement)
        return self._by_statement[task.statement]

    def _checked(self, vector: Float32Array, statement: str) -> Float32Array:
        if vector.shape != (self.dimension,):
            raise ValueError(
                f"encoder returned an array of shape {vector.shape} for {statement!r}, not ({self.dimension},)"
            )
        if not (np.abs(vector) <= self._limit).all():
            raise ValueError(f"encoder returned values beyond limit={self._limit} for {statement!r}: {vector}")
        return vector

    def _encode(self, statement: str) -> Float32Array:
        encoder = self._encoder
        vector = encoder.encode([statement])[0] if hasattr(encoder, "encode") else encoder(statement)
        return np.asarray(vector, np.float32)


class StatementEmbedding(EnvWrapper[Embedding]):
    """Replaces "statement" by the encoder's embedding, float32 (D,), computed once per statement.

    `encoder`: a function from a statement to D numbers, or an object with sentence-transformers' `encode`. `limit`: the
    largest absolute value allowed, the bound of the space. The wrapped environment's spec holds the encoder object, so
    it cannot be converted to JSON.
    """

    transformation_class = Embedding

    def __init__(self, env: gym.Env[Any, Any], encoder: Encoder, *, limit: float = 1000.0) -> None:
        super().__init__(env, encoder=encoder, limit=limit)
