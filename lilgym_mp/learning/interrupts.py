"""Ctrl-C while training: the first asks for an end after what is being done, the second interrupts."""

from __future__ import annotations

import signal
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import current_thread, main_thread

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
SAME_REQUEST_SECONDS = 5.0  # a SIGTERM that follows so soon is the same request: Linux sends one for each thread of a
# killed parent, to a child that asked for it (PR_SET_PDEATHSIG)


@dataclass
class StopRequest:
    """Whether somebody asked for an early end."""

    requested: bool = False


@contextmanager
def stop_on_signals() -> Generator[StopRequest, None, None]:
    """Within the block the first Ctrl-C or SIGTERM is a request; a second Ctrl-C, or a later SIGTERM, interrupts."""
    stop = StopRequest()
    requested_at = -SAME_REQUEST_SECONDS

    def request(number: int, frame: object) -> None:
        nonlocal requested_at
        is_same = number == signal.SIGTERM and time.monotonic() - requested_at < SAME_REQUEST_SECONDS
        if stop.requested and not is_same:
            raise KeyboardInterrupt
        if not stop.requested:
            stop.requested, requested_at = True, time.monotonic()

    heard = STOP_SIGNALS if current_thread() is main_thread() else ()
    before = {number: signal.signal(number, request) for number in heard}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
