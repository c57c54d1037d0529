"""Ctrl-C during training: the first requests a clean stop, the second interrupts."""

from __future__ import annotations

import signal
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import current_thread, main_thread

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
SAME_REQUEST_SECONDS = 5.0  # SIGTERMs this close together are one request: with PR_SET_PDEATHSIG Linux sends a child
# one for each thread of a killed parent


@dataclass
class StopRequest:
    requested: bool = False


@contextmanager
def stop_on_signals() -> Generator[StopRequest, None, None]:
    """Within the block the first Ctrl-C or SIGTERM sets `requested`; a second Ctrl-C or a later SIGTERM raises
    KeyboardInterrupt. Outside the main thread no handler is installed."""
    stop = StopRequest()
    requested_at = -SAME_REQUEST_SECONDS

    def request(signal_number: int, frame: object) -> None:
        nonlocal requested_at
        is_same = signal_number == signal.SIGTERM and time.monotonic() - requested_at < SAME_REQUEST_SECONDS
        if stop.requested and not is_same:
            raise KeyboardInterrupt
        if not stop.requested:
            stop.requested, requested_at = True, time.monotonic()

    handled = STOP_SIGNALS if current_thread() is main_thread() else ()
    before = {signal_number: signal.signal(signal_number, request) for signal_number in handled}
    try:
        yield stop
    finally:
        for signal_number, handler in before.items():
            signal.signal(signal_number, handler)
