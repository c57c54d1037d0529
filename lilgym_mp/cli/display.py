"""Progress of training: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lilgym_mp.learning.training import Progress

LINES = 10  # printed over a whole training, where there is no terminal


class TrainingDisplay:
    """Shows each update of a training from `begin` to `steps` steps. A context manager."""

    def __init__(self, begin: int, steps: int) -> None:
        self._steps = steps
        self._bar: Any = None
        self._next_line = begin + (steps - begin) / LINES
        self._line_every = (steps - begin) / LINES
        if sys.stderr.isatty():
            from tqdm import tqdm

            self._bar = tqdm(total=steps, initial=begin, unit=" steps", dynamic_ncols=True, smoothing=0.1)

    def __enter__(self) -> TrainingDisplay:
        return self

    def __exit__(self, *fault: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def __call__(self, progress: Progress) -> None:
        accuracy = "-" if progress.accuracy is None else f"{100 * progress.accuracy:.0f} %"
        if self._bar is not None:
            self._bar.set_postfix_str(f"training accuracy {accuracy}", refresh=False)
            self._bar.update(min(progress.steps, self._steps) - self._bar.n)
        elif progress.steps >= self._next_line:
            self._next_line += self._line_every
            print(
                f"{progress.steps:>9,} of {self._steps:,} steps, {progress.steps_per_second:,.0f} a second,"
                f" training accuracy {accuracy}",
                file=sys.stderr,
                flush=True,
            )
