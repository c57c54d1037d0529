"""Progress over a known number of things: a bar on a terminal that has tqdm, a line now and then elsewhere."""

from __future__ import annotations

import sys
from typing import Any

LINES = 10  # printed from beginning to end, where there is no bar


class Progress:
    """Counts up to `total` on stderr. A context manager."""

    def __init__(self, total: int, unit: str, done: int = 0) -> None:
        """`done`: how many were done before."""
        self._total = total
        self._unit = unit
        self._begin = done
        self._done = done
        self._bar = _bar(total, unit, done)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *fault: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def advance(self, count: int = 1, note: str = "") -> None:
        """`count` more are done; `note` tells how it goes."""
        lines_before = self._lines()
        self._done += count
        if self._bar is not None:
            self._bar.set_postfix_str(note, refresh=False)
            self._bar.update(min(self._done, self._total) - self._bar.n)
        elif self._lines() > lines_before:
            told = f"{self._done:,} of {self._total:,} {self._unit}"
            print(f"{told}, {note}" if note else told, file=sys.stderr, flush=True)

    def _lines(self) -> int:
        """How many lines should have been printed by now."""
        return (self._done - self._begin) * LINES // max(1, self._total - self._begin)


def _bar(total: int, unit: str, done: int) -> Any:
    if not sys.stderr.isatty():
        return None
    try:
        from tqdm import tqdm
    except ImportError:
        return None
    return tqdm(total=total, initial=done, unit=f" {unit}", dynamic_ncols=True)
