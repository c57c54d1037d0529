"""What a download shows of itself: a bar on a terminal, a line for each file elsewhere."""

from __future__ import annotations

import shutil
import sys
import time
from types import TracebackType
from typing import TextIO

BAR_WIDTH = 24  # characters
SECONDS_BETWEEN = 0.1
WIPE_LINE = "\r\x1b[K"


class DownloadBar:
    """`with DownloadBar() as bar: bar.show(name, bytes_so_far, bytes_of_all)`."""

    def __init__(self, stream: TextIO | None = None) -> None:
        """`stream`: standard error by default."""
        self._stream = stream or sys.stderr
        self._is_terminal = self._stream.isatty()
        self._due = 0.0  # when to draw again
        self._drawn = False

    def show(self, name: str, have: int, total: int | None) -> None:
        """Draws the bar, at most every tenth of a second. `total` is None where it is not known."""
        if not self._is_terminal:
            if have == total:
                print(f"{name}: {have:,} bytes", file=self._stream, flush=True)
            return
        now = time.monotonic()
        if now >= self._due or have == total:
            self._due = now + SECONDS_BETWEEN
            self._drawn = True
            line = f"{_bar(have, total)}  {name}"
            self._stream.write(WIPE_LINE + line[: shutil.get_terminal_size().columns - 1])
            self._stream.flush()

    def __enter__(self) -> DownloadBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._drawn:
            self._stream.write(WIPE_LINE)
            self._stream.flush()


def _bar(have: int, total: int | None) -> str:
    if not total:
        return f"{have:,} bytes"
    filled = min(BAR_WIDTH, BAR_WIDTH * have // total)
    return f"[{'#' * filled}{'.' * (BAR_WIDTH - filled)}] {have:,} of {total:,} bytes"
