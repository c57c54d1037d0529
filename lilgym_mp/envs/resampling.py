"""The bootstrap of all results: how often each statement or run is drawn, and intervals of what is computed of them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lilgym_mp.scene.arrays import Float64Array

INTERVAL = (2.5, 97.5)  # percentiles: 95 %


@lru_cache(maxsize=16)
def drawn_counts(count: int, resamples: int, seed: int = 0) -> Float64Array:
    """(resamples, count) how often each is drawn, with replacement; always the same draws. Read-only."""
    rng = np.random.default_rng(seed)
    return rng.multinomial(count, np.full(count, 1 / count), resamples).astype(np.float64)


def percentile_interval(values: Float64Array) -> tuple[float, float]:
    """The central 95 % of resampled values."""
    low, high = np.percentile(values, INTERVAL)
    return float(low), float(high)
