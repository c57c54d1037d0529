"""Random actions and comparisons."""

from __future__ import annotations

from typing import Any

import numpy as np

STOP_SHARE, WILD_SHARE = 0.1, 0.05  # of random actions: STOP, and any at all; the others are legal


def equal(one: Any, other: Any) -> bool:
    """Whether two observations, or whatever holds such, are the same in every part."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(equal(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(equal, one, other))
    return np.array_equal(one, other) if isinstance(one, np.ndarray) else one == other


def random_actions(masks: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """(N,) mostly legal actions for masks (N, actions)."""
    actions: list[int] = []
    for mask in masks:
        chance = generator.random()
        if chance < STOP_SHARE:
            actions.append(0)
        elif chance < STOP_SHARE + WILD_SHARE:
            actions.append(int(generator.integers(len(mask))))
        else:
            actions.append(int(generator.choice(np.flatnonzero(mask))))
    return np.array(actions)
