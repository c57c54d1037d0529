"""What a download shows: a bar on a terminal, a line for each file elsewhere."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress


class DownloadBar:
    """`with DownloadBar() as bar: bar.show(name, bytes_so_far, bytes_of_all)`."""

    def __init__(self, stream: TextIO | None = None) -> None:
        """`stream`: standard error by default."""
        self._stream = stream or sys.stderr
        self._progress: Progress | None = None  # on a terminal, once there is something to show

    def show(self, name: str, have: int, total: int | None) -> None:
        """Updates the bar. `total` is None where it is not known."""
        if not self._stream.isatty():
            if have == total:
                print(f"{name}: {have:,} bytes", file=self._stream, flush=True)
            return
        if self._progress is None:
            self._progress = _new_progress(self._stream)
            self._progress.start()
        elif self._progress.tasks[-1].description != name:
            self._progress.remove_task(self._progress.task_ids[-1])
        if not self._progress.tasks:
            self._progress.add_task(name, total=total)
        self._progress.update(self._progress.task_ids[-1], completed=have, total=total)

    def __enter__(self) -> DownloadBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._progress is not None:
            self._progress.stop()


def _new_progress(stream: TextIO) -> Progress:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        DownloadColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
        TransferSpeedColumn,
    )

    columns = (
        BarColumn(),
        DownloadColumn(),
        TransferSpeedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    return Progress(*columns, console=Console(file=stream), transient=True)
