"""What a policy is to an evaluation: a function. And the two that know nothing."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from lilgym_mp.arrays import BoolArray, Int64Array, UInt8Array


class Observations(NamedTuple):
    """What B agents see, each in an episode of its own."""

    images: UInt8Array  # (B, 50, 190, 3)
    statements: tuple[str, ...]  # B
    targets: Int64Array  # (B,) 1: make the statement true, 0: make it false
    steps: Int64Array  # (B,) actions taken so far in the episode: 0 at its start
    episodes: Int64Array  # (B,) index of the episode within the evaluation, for policies that keep a plan


class Policy(Protocol):
    """Chooses an action for each of B agents. All chance comes from `rng`.

    A policy that never looks at the masks may have an attribute `needs_masks = False`: none are made for it then, and
    `legal` is an array of shape (B, 0).
    """

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        """`legal`: (B, actions) the exact masks; a policy may ignore them. Gives (B,) action indices."""
        ...


def random_legal(observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
    """Any legal action, all equally likely."""
    chosen = rng.integers(legal.sum(1))  # which of the legal actions, by row
    return (legal.cumsum(1) > chosen[:, None]).argmax(1)


def random_unmasked(observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
    """Any action, all equally likely."""
    return rng.integers(legal.shape[1], size=len(legal))
