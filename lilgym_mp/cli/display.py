"""Shows how training goes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lilgym_mp.cli.progress import Progress

if TYPE_CHECKING:
    from lilgym_mp.learning.ppo.training import Progress as TrainingProgress


class TrainingDisplay:
    """Shows each update of a training from `begin` to `steps` steps. A context manager."""

    def __init__(self, begin: int, steps: int) -> None:
        self._shown = begin
        self._progress = Progress(steps, "steps", begin)

    def __enter__(self) -> TrainingDisplay:
        return self

    def __exit__(self, *fault: object) -> None:
        self._progress.__exit__(*fault)

    def __call__(self, update: TrainingProgress) -> None:
        accuracy = "-" if update.accuracy is None else f"{100 * update.accuracy:.0f} %"
        note = f"{update.steps_per_second:,.0f} a second, training accuracy {accuracy}"
        self._progress.advance(update.steps - self._shown, note)
        self._shown = update.steps
