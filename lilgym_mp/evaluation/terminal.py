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
from typing import TYPE_CHECKING, TextIO

from lilgym_mp.corpus.notes import write_note

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

SILENT_SECONDS = 10.0  # longest time without a line, where there is no bar
GAP = 2  # blanks between the columns of a table
NUMBER = re.compile(r"(< )?[-−+]?\d[\d.,]*( ?[%(±[].*)?|[-–]")  # with its share, of how many, or its spread


def takes_escapes(stream: TextIO) -> bool:
    """Whether the stream is a terminal that understands escape sequences, unlike TERM=dumb."""
    return stream.isatty() and os.environ.get("TERM") != "dumb"


def shows_colours() -> bool:
    """Whether standard output is a terminal with colours and NO_COLOR is not set."""
    return takes_escapes(sys.stdout) and not os.environ.get("NO_COLOR")


class Progress:
    """Progress up to `total` with the time left, on stderr: as a bar on a terminal, elsewhere as a few lines.

    A context manager. In its block a thread redraws the bar, or prints a line before there was none for ten seconds.
    """

    def __init__(
        self,
        total: int,
        unit: str,
        done: int | None = 0,
        *,
        doing: str = "",
        prints: bool = True,
    ) -> None:
        """`done`: progress at the beginning; None if the first call of `reach` sets it, as in a resumed run.

        `doing`: shown at once and until the first progress. `prints`: whether to print lines without a terminal; not if
        the caller prints its own.
        """
        self._total = total
        self._unit = unit
        self._begin = done
        self._done = done or 0
        self._since = self._printed = time.monotonic()
        self._note = doing
        self._over = threading.Event()
        self._bar = _bar() if takes_escapes(sys.stderr) else None
        self._prints = self._bar is None and prints
        if self._bar is not None:
            self._bar.start()
            self._bar.add_task(unit, total=total, completed=self._done, note=doing)
        elif doing:
            write_note(doing)

    def __enter__(self) -> Progress:
        if self._prints:
            threading.Thread(target=self._beat, daemon=True).start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._over.set()
        if self._bar is not None:
            self._bar.stop()

    def _beat(self) -> None:
        while not self._over.wait(SILENT_SECONDS / 20):
            self._print_if_due()

    def advance(self, count: int = 1, note: str = "") -> None:
        """Adds `count` to the progress; `note` is shown with it."""
        self.reach(self._done + count, note)

    def reach(self, done: int, note: str = "") -> None:
        """Sets the progress, including what was done before; `note` is shown with it."""
        if self._begin is None:
            self._begin = min(done, self._total)
            self._done = done
            self._since = self._printed = time.monotonic()
        completes = self._done < self._total <= done
        self._done = done
        self._note = note
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=min(done, self._total), note=note)
        elif self._prints:
            self._print_if_due(at_once=completes)

    def _print_if_due(self, *, at_once: bool = False) -> None:
        """Prints a line if there was none for half of SILENT_SECONDS: early, as other threads may hold the interpreter.

        It ends with the time left at the mean rate, or early on with the time so far.
        """
        now = time.monotonic()
        if now - self._printed < SILENT_SECONDS / 2 and not at_once:
            return
        self._printed = now
        done = self._done
        seconds = now - self._since
        ends = "so far"
        if (worked := done - (self._begin or 0)) and 20 * worked >= self._total:
            seconds = seconds * (self._total - done) / worked
            ends = "left"
        clock = f"{round(seconds) // 60}:{round(seconds) % 60:02} {ends}" if done < self._total else ""
        reached = f"{done:,} of {self._total:,} {self._unit}" if done else ""
        write_note(", ".join(filter(None, [reached, self._note, clock])))


def _bar() -> RichProgress:
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
        redirect_stdout=sys.stdout.isatty(),  # output on the same terminal goes above the bar
    )


def table(header: Sequence[str], rows: Iterable[Sequence[object]], width: int | None = None, *, keys: int = 1) -> str:
    """Lines with aligned columns: numbers right-aligned with thousands separators, text left-aligned.

    `width`: columns of the terminal, by default COLUMNS if it is set, or those of standard output if it is one. What
    does not fit follows as further tables with the same `keys` first columns; words are never split.
    """
    cells = [[_cell(value) for value in row] for row in rows]
    widths = [max(len(name), *(len(row[column][0]) for row in cells), 0) for column, name in enumerate(header)]
    if width is None:
        fits = sys.stdout.isatty() or os.environ.get("COLUMNS")
        width = get_terminal_size().columns if fits else sum(widths) + GAP * len(header)
    blocks = [list(range(keys))]
    for column in range(keys, len(header)):
        if sum(widths[other] + GAP for other in blocks[-1]) + widths[column] > width and len(blocks[-1]) > keys:
            blocks.append(list(range(keys)))
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
