"""Random draws of tasks, the same for an environment in any process or batch."""

from __future__ import annotations

import numpy as np

DRAWS = 16  # drawn per call of the generator: the same numbers as drawn singly, in a quarter of the time


def next_draws(generator: np.random.Generator, task_count: int) -> list[int]:
    """Indices of the next uniformly drawn tasks, in reverse: `pop` returns them in order."""
    return generator.integers(task_count, size=DRAWS)[::-1].tolist()
