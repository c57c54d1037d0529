"""What terminals show: bars with the time left, tables, colours where wanted, texts of others made safe."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress
    from rich.progress import ProgressColumn

LINES = 10  # of progress from beginning to end, where there is no bar


def printable(text: str) -> str:
    """`text` with everything that could move a terminal's cursor, colour or title, but line ends, written out."""
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode("ascii") for c in text)


def shows_colours() -> bool:
    """Whether standard output is a terminal whose user has not asked for no colours (NO_COLOR)."""
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR")


class Progress:
    """Counts up to `total` on stderr: a bar with the time left on a terminal, elsewhere some lines with it.

    A context manager.
    """

    def __init__(
        self, total: int, unit: str, done: int | None = 0, *, redraws_by_itself: bool = True, lines: int = LINES
    ) -> None:
        """`done`: how many were done before; None where the first call of `reach` says so, as of a resumed run.

        `redraws_by_itself`: whether a thread redraws the bar between calls, so that its clock runs on. `lines`: how
        many lines there are without a terminal; 0 where what is counted prints lines of its own.
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
        """`count` more are done; `note` says how it goes."""
        self.reach(self._done + count, note)

    def reach(self, done: int, note: str = "") -> None:
        """`done` are done, those before among them; `note` says how it goes."""
        if self._begin is None:
            self._begin, self._done, self._since = min(done, self._total), done, time.monotonic()
        lines_before = self._lines(self._begin)
        self._done = done
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=min(done, self._total), note=note)
            if not self._bar.live.auto_refresh:
                self._bar.refresh()
        elif self._lines(self._begin) > lines_before:
            told = [f"{done:,} of {self._total:,} {self._unit}", note, self._time_left(self._begin)]
            _write(", ".join(filter(None, told)), sys.stderr)

    def _time_left(self, begin: int) -> str:
        """How long what is left will take at the pace so far; nothing at the end."""
        left = self._total - self._done
        if left <= 0 or self._done <= begin:
            return ""
        seconds = round((time.monotonic() - self._since) * left / (self._done - begin))
        return f"{seconds // 60}:{seconds % 60:02} left"

    def _lines(self, begin: int) -> int:
        """How many lines should have been printed by now."""
        return (self._done - begin) * self._line_count // max(1, self._total - begin)


def _bar(redraws_by_itself: bool) -> RichProgress:
    from rich.progress import MofNCompleteColumn, TextColumn

    columns = MofNCompleteColumn(), TextColumn("{task.description}")
    return _rich_progress(sys.stderr, *columns, note=True, auto_refresh=redraws_by_itself)


class DownloadBar:
    """`with DownloadBar() as bar: bar.show(name, bytes_so_far, bytes_of_all)`: a line for each file if no terminal."""

    def __init__(self, stream: TextIO | None = None) -> None:
        """`stream`: standard error by default."""
        self._stream = stream or sys.stderr
        self._bar: RichProgress | None = None  # on a terminal, once there is something to show

    def show(self, name: str, have: int, total: int | None) -> None:
        """Updates the bar. `total` is None where it is not known."""
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
    """What all bars have in common: the bar, `columns`, the time left, and last a task's note."""
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
        redirect_stdout=sys.stdout.isatty(),  # what is printed on the same terminal goes above the bar
    )


def _write(line: str, stream: TextIO) -> None:
    stream.write(f"{line}\n")
    stream.flush()


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Lines with aligned columns: numbers to the right with a comma every three digits, texts to the left."""
    cells = [[_cell(value) for value in row] for row in rows]
    right = [bool(cells) and all(row[place][1] for row in cells) for place in range(len(header))]
    texts = [list(header), *([text for text, _ in row] for row in cells)]
    widths = [max(len(row[place]) for row in texts) for place in range(len(header))]
    lines = [
        "  ".join(
            text.rjust(width) if to_right else text.ljust(width)
            for text, width, to_right in zip(row, widths, right, strict=True)
        ).rstrip()
        for row in texts
    ]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def _cell(value: object) -> tuple[str, bool]:
    """A value's text, and whether it is a number or stands for a lacking one."""
    if value is None:
        return "-", True
    if isinstance(value, float):
        return f"{value:,.1f}", True
    if isinstance(value, int):
        return f"{value:,}", True
    return str(value), False
