"""What terminals show: texts of others made safe, and whether colours are wanted."""

from __future__ import annotations

import os
import sys


def printable(text: str) -> str:
    """`text` with everything that could move a terminal's cursor, colour or title, but line ends, written out."""
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode("ascii") for c in text)


def shows_colours() -> bool:
    """Whether standard output is a terminal whose user has not asked for no colours (NO_COLOR)."""
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR")
