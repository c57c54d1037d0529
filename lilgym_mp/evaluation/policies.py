"""What a policy is to an evaluation: a function. And the two that know nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.observation import Observation

UInt8Array = NDArray[np.uint8]
Int64Array = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class Observations(NamedTuple):
    """What B agents see."""

    images: UInt8Array  # (B, 50, 190, 3)
    statements: tuple[str, ...]  # B
    targets: Int64Array  # (B,) 1: make the statement true, 0: make it false

    @classmethod
    def of(cls, observations: Sequence[Observation]) -> Observations:
        """B observations of the environments as one."""
        return cls(
            np.stack([seen["image"] for seen in observations]),
            tuple(seen["statement"] for seen in observations),
            np.array([seen["target"] for seen in observations], np.int64),
        )


class Policy(Protocol):
    """Chooses an action for each of B agents. All chance comes from `rng`."""

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        """`legal`: (B, actions) the exact masks; a policy may ignore them. Gives (B,) action numbers."""
        ...


def random_legal(observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
    """Any legal action, all equally likely."""
    chosen = rng.integers(legal.sum(1))  # which of the legal actions, by row
    return (legal.cumsum(1) > chosen[:, None]).argmax(1)


def random_unmasked(observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
    """Any action, all equally likely."""
    return rng.integers(legal.shape[1], size=len(legal))
