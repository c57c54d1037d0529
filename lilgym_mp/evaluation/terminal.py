"""Terminal output: progress bars, tables and colours."""

from __future__ import annotations

import os
import re
import sys
import textwrap
import threading
import time
from collections.abc import Iterable, Sequence
from shutil import get_terminal_size
from typing import TYPE_CHECKING

from lilgym_mp.corpus.notes import write_note

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

LINES = 10  # printed in total when there is no bar
LINE_SECONDS = 1.0  # least time between them
SILENT_SECONDS = 10.0  # longest time without a line
GAP = 2  # blanks between the columns of a table
NUMBER = re.compile(r"(< )?[-+]?\d[\d.,]*( ?[%(±[].*)?|[-–]")  # with its share, of how many, or its spread


def shows_colours() -> bool:
    """Tells whether standard output is a terminal and NO_COLOR is not set."""
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR")


class Progress:
    """Progress up to `total` with the time left, on stderr: as a bar on a terminal, elsewhere as a few lines.

    A context manager. In its block a thread redraws the bar, or prints a line whenever there was none for ten seconds.
    """

    def __init__(
        self,
        total: int,
        unit: str,
        done: int | None = 0,
        *,
        doing: str = "",
        redraws_by_itself: bool = True,
        lines: int = LINES,
    ) -> None:
        """`done`: progress at the beginning; None if the first call of `reach` sets it, as in a resumed run.

        `doing`: shown at once and until the first progress. `redraws_by_itself`: whether the thread runs; not while
        speed is measured. `lines`: number of lines without a terminal; 0 if the caller prints its own.
        """
        self._total = total
        self._unit = unit
        self._begin = done
        self._line_count = lines
        self._done = done or 0
        self._since = self._printed = time.monotonic()
        self._note = doing
        self._entered = self._since
        self._over = threading.Event()
        self._bar = _bar(redraws_by_itself) if sys.stderr.isatty() else None
        self._beats = self._bar is None and redraws_by_itself and lines > 0
        if self._bar is not None:
            self._bar.start()
            self._bar.add_task(unit, total=total, completed=self._done, note=doing)
        elif doing:
            write_note(doing)

    def __enter__(self) -> Progress:
        if self._beats:
            threading.Thread(target=self._beat, daemon=True).start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._over.set()
        if self._bar is not None:
            self._bar.stop()

    def _beat(self) -> None:
        """Prints a line whenever there was none for half of SILENT_SECONDS."""
        while not self._over.wait(SILENT_SECONDS / 20):
            now = time.monotonic()
            if now - self._printed >= SILENT_SECONDS / 2:  # early: other threads may hold the interpreter
                self._printed = now
                seconds = round(now - self._entered)
                reached = f"{self._done:,} of {self._total:,} {self._unit}" if self._done else ""
                write_note(", ".join(filter(None, [reached, self._note, f"{seconds // 60}:{seconds % 60:02} so far"])))

    def advance(self, count: int = 1, note: str = "") -> None:
        """Adds `count` to the progress; `note` is shown with it."""
        self.reach(self._done + count, note)

    def reach(self, done: int, note: str = "") -> None:
        """Sets the progress, including what was done before; `note` is shown with it."""
        if self._begin is None:
            self._begin, self._done, self._since = min(done, self._total), done, time.monotonic()
        lines_before = self._lines(self._begin)
        self._done, self._note = done, note
        now = time.monotonic()
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=min(done, self._total), note=note)
            if not self._bar.live.auto_refresh:
                self._bar.refresh()
        elif self._lines(self._begin) > lines_before and (now - self._printed > LINE_SECONDS or done >= self._total):
            self._printed = now
            seconds = round((now - self._since) * (self._total - done) / (done - self._begin))  # at the mean rate
            left = "" if done >= self._total else f"{seconds // 60}:{seconds % 60:02} left"
            write_note(", ".join(filter(None, [f"{done:,} of {self._total:,} {self._unit}", note, left])))

    def _lines(self, begin: int) -> int:
        """Number of lines that should have been printed by now."""
        return (self._done - begin) * self._line_count // max(1, self._total - begin)


def _bar(redraws_by_itself: bool) -> RichProgress:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as RichProgress

    return RichProgress(
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("left {task.fields[note]}"),
        console=Console(file=sys.stderr),
        auto_refresh=redraws_by_itself,
        redirect_stdout=sys.stdout.isatty(),  # output on the same terminal goes above the bar
    )


def table(header: Sequence[str], rows: Iterable[Sequence[object]], width: int | None = None) -> str:
    """Lines with aligned columns: numbers right-aligned with thousands separators, text left-aligned.

    `width`: columns of the terminal, by default that of standard output if it is one. What does not fit follows as
    further tables with the same first column; words are never split.
    """
    cells = [[_cell(value) for value in row] for row in rows]
    widths = [max(len(name), *(len(row[column][0]) for row in cells), 0) for column, name in enumerate(header)]
    if width is None:
        width = get_terminal_size().columns if sys.stdout.isatty() else sum(widths) + GAP * len(header)
    blocks = [[0]]
    for column in range(1, len(header)):
        if sum(widths[other] + GAP for other in blocks[-1]) + widths[column] > width and len(blocks[-1]) > 1:
            blocks.append([0])
        blocks[-1].append(column)
    padded: list[list[str]] = []  # by column
    for column, name in enumerate(header):
        right = bool(cells) and all(row[column][1] for row in cells)
        texts = [name, "-" * widths[column], *(row[column][0] for row in cells)]
        padded.append([text.rjust(widths[column]) if right else text.ljust(widths[column]) for text in texts])
    parts: list[str] = []
    for block in blocks:
        head, rule, *rows = ((" " * GAP).join(line).rstrip() for line in zip(*(padded[i] for i in block), strict=True))
        parts.append("\n".join([head, "-" * len(rule), *rows]))
    return "\n\n".join(parts)


def hanging(line: str, width: int) -> str:
    """The line, wrapped between words. Further lines begin below the last column of text after two blanks, or after a
    colon and a blank, if there is one in the first half."""
    starts = [match.end() for match in re.finditer(r" {2,}|: ", line[: width // 2])]
    indent = " " * (starts[-1] if starts else 2)
    return textwrap.fill(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def _cell(value: object) -> tuple[str, bool]:
    """A value's text, and whether it is a number or missing."""
    if value is None:
        return "-", True
    if isinstance(value, float):
        return f"{value:,.1f}", True
    if isinstance(value, int):
        return f"{value:,}", True
    text = str(value)
    return text, NUMBER.fullmatch(text) is not None
