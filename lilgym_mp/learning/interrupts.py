"""Ctrl-C while training: the first asks for an end after what is being done, the second interrupts."""

from __future__ import annotations

import signal
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import current_thread, main_thread

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@dataclass
class StopRequest:
    """Whether somebody asked for an early end."""

    requested: bool = False


@contextmanager
def stop_on_signals() -> Generator[StopRequest, None, None]:
    """Within the block the first Ctrl-C or SIGTERM is a request; the second interrupts."""
    stop = StopRequest()

    def request(number: int, frame: object) -> None:
        if stop.requested:
            raise KeyboardInterrupt
        stop.requested = True

    heard = STOP_SIGNALS if current_thread() is main_thread() else ()
    before = {number: signal.signal(number, request) for number in heard}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
