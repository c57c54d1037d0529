"""Flattened observations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.spaces.utils import flatten_space

from lilgym_mp.arrays import Float32Array
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Batch, EnvDescription, EnvState, Transformation, WrongEnvironment


class Flattening(Transformation):
    """Concatenates all parts to one vector."""

    changes_observations = True

    def __init__(self, description: EnvDescription) -> None:
        super().__init__(description)
        self._parts = description.parts()
        for name, space in self._parts.items():
            if not isinstance(space, spaces.Box | spaces.Discrete):
                raise WrongEnvironment(
                    f"{description.wrapper} needs numeric parts, but {name!r} is {space};"
                    f" for a statement apply TokenizedStatement or StatementEmbedding first"
                )

    def observation_space(self) -> spaces.Box:
        flat = flatten_space(self.env_description.observation_space)
        assert isinstance(flat, spaces.Box)
        return spaces.Box(flat.low.astype(np.float32), flat.high.astype(np.float32), dtype=np.float32)

    def observations(self, observations: Mapping[str, Batch], state: EnvState) -> Batch:
        return np.concatenate([_rows(space, observations[name]) for name, space in self._parts.items()], axis=1)


def _rows(space: spaces.Space[Any], values: Batch) -> Float32Array:
    """(B, size) the flattened values of one part."""
    if isinstance(space, spaces.Discrete):
        return (values[:, None] == np.arange(space.n)).astype(np.float32)
    return values.reshape(len(values), -1).astype(np.float32)


class FlatObservation(EnvWrapper[Flattening]):
    """Flattens the observation to one float32 vector: the parts in alphabetical order, Discrete ones one-hot. Image
    values and token ids keep their scale.

    Raises WrongEnvironment for a text statement.
    """

    transformation_class = Flattening
