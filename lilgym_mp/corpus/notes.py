"""Text for people: control characters escaped, and notes on stderr about what takes long."""

from __future__ import annotations

import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager

LONGEST_MESSAGE = 2_000  # characters of an error message


def printable(text: str) -> str:
    """The text with all control characters except line ends escaped, and its middle left out if it is very long."""
    if len(text) > LONGEST_MESSAGE:
        half = LONGEST_MESSAGE // 2
        text = f"{text[:half]} ... ({len(text) - 2 * half:,} characters left out) ... {text[-half:]}"
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode("ascii") for c in text)


@contextmanager
def note_after(note: str, seconds: float = 5.0) -> Generator[None, None, None]:
    """Prints a line on stderr if the block takes longer."""
    timer = threading.Timer(seconds, lambda: write_note(f"{note} ..."))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()  # a process forked meanwhile would have another thread


def write_note(line: str) -> None:
    """Writes a line to standard error at once."""
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()
