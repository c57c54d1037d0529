"""Terminal output: progress bars, tables, colours, and escaping of untrusted text."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress
    from rich.progress import ProgressColumn

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
    timer = threading.Timer(seconds, lambda: _write(f"{note} ...", sys.stderr))
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
            _write(", ".join(filter(None, parts)), sys.stderr)

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
    from rich.progress import MofNCompleteColumn, TextColumn

    columns = MofNCompleteColumn(), TextColumn("{task.description}")
    return _rich_progress(sys.stderr, *columns, note=True, auto_refresh=redraws_by_itself)


class DownloadBar:
    """`with DownloadBar() as bar: bar.show(name, bytes_so_far, total_bytes)`; without a terminal, one line per file."""

    def __init__(self, stream: TextIO | None = None) -> None:
        """`stream`: standard error by default."""
        self._stream = stream or sys.stderr
        self._bar: RichProgress | None = None  # set on a terminal by the first `show`

    def show(self, name: str, have: int, total: int | None) -> None:
        """Updates the bar. `total` is None if unknown."""
        if not self._stream.isatty():
            if have == total:
                _write(f"{name}: {have:,} bytes", self._stream)
            return
        if self._bar is None:
            self._bar = _download_bar(self._stream)
            self._bar.start()
        elif self._bar.tasks[-1].description != name:
            self._bar.remove_task(self._bar.task_ids[-1])
        if not self._bar.tasks:
            self._bar.add_task(name, total=total)
        self._bar.update(self._bar.task_ids[-1], completed=have, total=total)

    def __enter__(self) -> DownloadBar:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._bar is not None:
            self._bar.stop()


def _download_bar(stream: TextIO) -> RichProgress:
    from rich.progress import DownloadColumn, TextColumn, TransferSpeedColumn

    columns = DownloadColumn(), TransferSpeedColumn(), TextColumn("{task.description}")
    return _rich_progress(stream, *columns, transient=True)


def _rich_progress(
    stream: TextIO, *columns: ProgressColumn, note: bool = False, transient: bool = False, auto_refresh: bool = True
) -> RichProgress:
    """A bar with `columns`, the time left, and last, if `note`, the task's note."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as RichProgress

    last = [TextColumn("{task.fields[note]}")] if note else []
    return RichProgress(
        BarColumn(),
        *columns,
        TimeRemainingColumn(),
        *last,
        console=Console(file=stream),
        auto_refresh=auto_refresh,
        transient=transient,
        redirect_stdout=sys.stdout.isatty(),  # output on the same terminal goes above the bar
    )


def _write(line: str, stream: TextIO) -> None:
    stream.write(f"{line}\n")
    stream.flush()


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
