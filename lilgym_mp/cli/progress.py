"""Progress over a known number of things: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

LINES = 10  # printed from beginning to end, where there is no bar


class Progress:
    """Counts up to `total` on stderr. A context manager."""

    def __init__(self, total: int, unit: str, done: int = 0) -> None:
        """`done`: how many were done before."""
        self._total = total
        self._unit = unit
        self._begin = done
        self._done = done
        self._since = time.monotonic()
        self._bar = _bar() if sys.stderr.isatty() else None
        if self._bar is not None:
            self._bar.start()
            self._bar.add_task(unit, total=total, completed=done, note="")

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *fault: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def advance(self, count: int = 1, note: str = "") -> None:
        """`count` more are done; `note` says how it goes."""
        lines_before = self._lines()
        self._done += count
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=min(self._done, self._total), note=note)
        elif self._lines() > lines_before:
            told = [f"{self._done:,} of {self._total:,} {self._unit}", note, self._time_left()]
            print(", ".join(filter(None, told)), file=sys.stderr, flush=True)

    def _time_left(self) -> str:
        """How long what is left will take at the pace so far; nothing at the end."""
        left = self._total - self._done
        if left <= 0 or self._done <= self._begin:
            return ""
        seconds = round((time.monotonic() - self._since) * left / (self._done - self._begin))
        return f"{seconds // 60}:{seconds % 60:02} left"

    def _lines(self) -> int:
        """How many lines should have been printed by now."""
        return (self._done - self._begin) * LINES // max(1, self._total - self._begin)


def _bar() -> RichProgress:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as RichProgress

    columns = BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), TimeRemainingColumn()
    return RichProgress(*columns, TextColumn("{task.fields[note]}"), console=Console(file=sys.stderr))
