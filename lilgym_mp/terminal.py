"""Terminal output: progress bars, tables, colours, and escaping of untrusted text."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

LONGEST_MESSAGE = 2_000  # characters of an error message
LINES = 10  # printed in total when there is no bar


def printable(text: str) -> str:
    """The text with all control characters except line ends escaped, and its middle left out if it is very long."""
    if len(text) > LONGEST_MESSAGE:
        half = LONGEST_MESSAGE // 2
        text = f"{text[:half]} ... ({len(text) - 2 * half:,} characters left out) ... {text[-half:]}"
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode("ascii") for c in text)


def shows_colours() -> bool:
    """Whether standard output is a terminal and NO_COLOR is not set."""
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR")


@contextmanager
def note_after(note: str, seconds: float = 5.0) -> Generator[None, None, None]:
    """Prints a line on stderr if the block takes longer."""
    timer = threading.Timer(seconds, lambda: _write(f"{note} ..."))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


class Progress:
    """Progress up to `total` with the time left, on stderr: as a bar on a terminal, elsewhere as a few lines.

    A context manager.
    """

    def __init__(
        self, total: int, unit: str, done: int | None = 0, *, redraws_by_itself: bool = True, lines: int = LINES
    ) -> None:
        """`done`: progress at the beginning; None if the first call of `reach` sets it, as in a resumed run.

        `redraws_by_itself`: whether a thread redraws the bar between calls, which updates its clock. `lines`: number of
        lines without a terminal; 0 if the caller prints its own.
        """
        self._total = total
        self._unit = unit
        self._begin = done
        self._line_count = lines
        self._done = done or 0
        self._since = time.monotonic()
        self._bar = _bar(redraws_by_itself) if sys.stderr.isatty() else None
        if self._bar is not None:
            self._bar.start()
            self._bar.add_task(unit, total=total, completed=self._done, note="")

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def advance(self, count: int = 1, note: str = "") -> None:
        """Adds `count` to the progress; `note` is shown with it."""
        self.reach(self._done + count, note)

    def reach(self, done: int, note: str = "") -> None:
        """Sets the progress, including what was done before; `note` is shown with it."""
        if self._begin is None:
            self._begin, self._done, self._since = min(done, self._total), done, time.monotonic()
        lines_before = self._lines(self._begin)
        self._done = done
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=min(done, self._total), note=note)
            if not self._bar.live.auto_refresh:
                self._bar.refresh()
        elif self._lines(self._begin) > lines_before:
            parts = [f"{done:,} of {self._total:,} {self._unit}", note, self._time_left(self._begin)]
            _write(", ".join(filter(None, parts)))

    def _time_left(self, begin: int) -> str:
        """The estimated time left, from the mean rate so far; empty if done or unknown."""
        left = self._total - self._done
        if left <= 0 or self._done <= begin:
            return ""
        seconds = round((time.monotonic() - self._since) * left / (self._done - begin))
        return f"{seconds // 60}:{seconds % 60:02} left"

    def _lines(self, begin: int) -> int:
        """Number of lines that should have been printed by now."""
        return (self._done - begin) * self._line_count // max(1, self._total - begin)


def _bar(redraws_by_itself: bool) -> RichProgress:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as RichProgress

    return RichProgress(
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.description}"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
        console=Console(file=sys.stderr),
        auto_refresh=redraws_by_itself,
        redirect_stdout=sys.stdout.isatty(),  # output on the same terminal goes above the bar
    )


def _write(line: str) -> None:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Lines with aligned columns: numbers right-aligned with thousands separators, text left-aligned."""
    cells = [[_cell(value) for value in row] for row in rows]
    right = [bool(cells) and all(row[column][1] for row in cells) for column in range(len(header))]
    texts = [list(header), *([text for text, _ in row] for row in cells)]
    widths = [max(len(row[column]) for row in texts) for column in range(len(header))]
    lines = [
        "  ".join(
            text.rjust(width) if to_right else text.ljust(width)
            for text, width, to_right in zip(row, widths, right, strict=True)
        ).rstrip()
        for row in texts
    ]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def _cell(value: object) -> tuple[str, bool]:
    """A value's text, and whether it is a number or missing."""
    if value is None:
        return "-", True
    if isinstance(value, float):
        return f"{value:,.1f}", True
    if isinstance(value, int):
        return f"{value:,}", True
    return str(value), False
