"""The time a training run has taken, over all its sessions."""

from __future__ import annotations

import os
import time
from collections.abc import Generator
from contextlib import contextmanager


class TrainingClock:
    """Seconds of training, excluding evaluations, and CPU seconds of this process, including them."""

    def __init__(self, earlier_seconds: float = 0.0, earlier_cpu_seconds: float = 0.0) -> None:
        self._seconds_before = earlier_seconds - time.monotonic()
        self._cpu_seconds_before = earlier_cpu_seconds - process_cpu_seconds()

    @property
    def seconds(self) -> float:
        return self._seconds_before + time.monotonic()

    @property
    def cpu_seconds(self) -> float:
        return self._cpu_seconds_before + process_cpu_seconds()

    @contextmanager
    def paused(self) -> Generator[None, None, None]:
        """Excludes the time spent in the block from `seconds`."""
        began = time.monotonic()
        yield
        self._seconds_before -= time.monotonic() - began


def process_cpu_seconds() -> float:
    times = os.times()
    return times.user + times.system
