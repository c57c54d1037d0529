"""The loop of a training run in memory: steps, reports and checkpoints until its budget is spent, or Ctrl-C."""

from __future__ import annotations

import math
import os
import signal
import time
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from threading import current_thread, main_thread
from typing import Any, Generic, NamedTuple, TypeVar

import torch

from lilgym_mp.learning.common.run_directory import NotFiniteError, RunDirectory, TrainingError, TrainingRunError

SAVE_SECONDS = 60.0  # CPU time between checkpoints
REPORT_SECONDS = 15.0
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
SAME_REQUEST_SECONDS = 5.0  # SIGTERMs this close together are one request: with PR_SET_PDEATHSIG Linux sends a child
# one for each thread of a killed parent

Measured = TypeVar("Measured")


def cpu_seconds() -> float:
    """CPU time of this process and its terminated children."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@dataclass
class Counters:
    """What a checkpoint counts, for any learner; field names are part of its format."""

    updates: int = 0  # of the optimiser
    seconds: float = 0.0  # wall-clock time over all sessions of the run, without evaluations
    cpu_seconds: float = 0.0  # over all sessions of the run
    collection_seconds: float = 0.0  # part of them for data collection


class Budget(NamedTuple):
    """`amount` of `unit`, or `minutes` of CPU time, everything included, whichever is spent first."""

    unit: str  # the counter that measures progress: "steps" of the environments or "updates" of the optimiser
    amount: int | None
    minutes: float | None = None

    def options(self) -> dict[str, float | None]:
        """The budget as arguments of the function that trains."""
        return {self.unit: self.amount, "minutes": self.minutes}

    def check(self) -> None:
        """Raises ValueError unless there is a positive budget."""
        if self.amount is None and self.minutes is None:
            raise ValueError(f"give a budget: {self.unit}, minutes, or both")
        for name, value in self.options().items():
            if value is not None and not 0 < value < math.inf:
                raise ValueError(f"the budget in {name} must be above 0, not {value:g}")


class Every(NamedTuple):
    """An interval between reports or between checkpoints; the default is one step of the algorithm."""

    amount: int = 0  # of the budget's unit
    seconds: float = 0.0  # CPU time


class TimedRun(ABC, Generic[Measured]):
    """A run in memory."""

    files: RunDirectory
    counters: Counters  # the learner's own

    def __init__(self, budget: Budget, report_every: Every | None = None, save_every: Every | None = None) -> None:
        budget.check()
        self.budget = budget
        self._report_every = report_every or Every(seconds=REPORT_SECONDS)
        self._save_every = save_every or Every(seconds=SAVE_SECONDS)
        self._start_seconds, self._start_cpu_seconds = time.monotonic(), cpu_seconds()

    @abstractmethod
    def state(self) -> dict[str, Any]:
        """What a checkpoint has besides the counters."""

    @abstractmethod
    def restore(self, state: dict[str, Any]) -> None:
        """Inverse of `state`; the counters have been restored."""

    @abstractmethod
    def step(self) -> Measured:
        """One step of the algorithm, with data collection when it is due. Raises NotFiniteError."""

    @abstractmethod
    def report(self, recent: Sequence[Measured]) -> None:
        """Reports the steps since the last report."""

    def seconds(self) -> float:
        """CPU time."""
        return self.counters.cpu_seconds + cpu_seconds() - self._start_cpu_seconds

    def wall_seconds(self) -> float:
        return self.counters.seconds + time.monotonic() - self._start_seconds

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Excludes the time spent in the block from `wall_seconds`."""
        began = time.monotonic()
        yield
        self._start_seconds += time.monotonic() - began

    def spent(self) -> int:
        """The steps or updates so far, whichever the budget counts."""
        return getattr(self.counters, self.budget.unit)

    def progress(self) -> float:
        """The fraction of the budget spent."""
        _, amount, minutes = self.budget
        by_amount = 0.0 if amount is None else self.spent() / amount
        return max(by_amount, 0.0 if minutes is None else self.seconds() / (60 * minutes))

    def is_over(self) -> bool:
        return self.progress() >= 1

    def check_unspent(self) -> None:
        """Raises TrainingRunError if a resumed run has spent the budget."""
        if self.spent() and self.is_over():
            given = " or ".join(f"--{name}" for name, value in self.budget.options().items() if value is not None)
            raise TrainingRunError(
                f"the run in {self.files.path} already has {self.spent():,} {self.budget.unit};"
                f" request more with {given}"
            )

    def optimise(self, stop: StopRequest | None = None) -> None:
        """Takes steps until the budget is spent, or a stop is requested. Raises TrainingRunError if it allows none."""
        recent: list[Measured] = []
        saved = reported = Every(self.spent(), self.seconds())
        while not self.is_over() and not (stop is not None and stop.requested):
            with self.errors_located():
                recent.append(self.step())
            now = Every(self.spent(), self.seconds())
            if _is_due(now, reported, self._report_every):
                self.report(recent)
                recent, reported = [], now
            if _is_due(now, saved, self._save_every):
                self.save()
                saved = now
        if recent:
            self.report(recent)
        if not self.spent() and self.is_over():
            raise TrainingRunError(
                f"{self.budget.minutes:g} minutes were spent before the first update; give more minutes"
            )

    @contextmanager
    def errors_located(self) -> Iterator[None]:
        """Adds the step and the last checkpoint to a NotFiniteError."""
        try:
            yield
        except NotFiniteError as error:
            parts, kept = str(error), f"the last good checkpoint is kept in {self.files.path}"
            raise TrainingError(
                f"the loss is not finite after {self.spent()} {self.budget.unit}{parts and f' ({parts})'};"
                f" {kept if self.files.has_checkpoint else 'nothing was saved yet'}; try a lower learning-rate"
            ) from None

    @contextmanager
    def saved_on_interrupt(self) -> Iterator[None]:
        try:
            yield
        except KeyboardInterrupt:
            self.save()
            raise

    @contextmanager
    def collecting(self) -> Iterator[None]:
        """Counts the time spent in the block as data collection."""
        began = self.seconds()
        yield
        self.counters.collection_seconds += self.seconds() - began

    def save(self) -> None:
        spent = {"seconds": self.wall_seconds(), "cpu_seconds": self.seconds()}
        self.files.save_checkpoint({**self.state(), "counters": {**asdict(self.counters), **spent}})

    def load(self, device: Any) -> None:
        """Continues from the checkpoint, if there is one. Raises TrainingRunError."""
        if self.files.has_checkpoint:
            with self.files.checkpoint(device) as state:
                counted = state["counters"]  # older checkpoints have those of all learners
                for field in fields(self.counters):
                    setattr(self.counters, field.name, counted[field.name])
                self.restore(state)
                for name, tensor in (state.get("network") or state["networks"]).items():
                    if not torch.isfinite(tensor).all():
                        raise ValueError(f"{name} holds non-finite values")

    def statistics(self) -> dict[str, float]:
        """Details of the model file."""
        minutes, exploring = self.seconds() / 60, self.counters.collection_seconds / 60
        return {"cpu_minutes": round(minutes, 2), "collection_cpu_minutes": round(exploring, 2)}


def _is_due(now: Every, last: Every, interval: Every) -> bool:
    return now.amount - last.amount >= interval.amount and now.seconds - last.seconds >= interval.seconds


@dataclass
class StopRequest:
    requested: bool = False


@contextmanager
def stop_on_signals() -> Generator[StopRequest, None, None]:
    """Within the block the first Ctrl-C or SIGTERM sets `requested`; a second Ctrl-C or a later SIGTERM raises
    KeyboardInterrupt. Outside the main thread no handler is installed."""
    stop = StopRequest()
    requested_at = -SAME_REQUEST_SECONDS

    def request(signal_number: int, frame: object) -> None:
        nonlocal requested_at
        is_same = signal_number == signal.SIGTERM and time.monotonic() - requested_at < SAME_REQUEST_SECONDS
        if stop.requested and not is_same:
            raise KeyboardInterrupt
        if not stop.requested:
            stop.requested, requested_at = True, time.monotonic()

    handled = STOP_SIGNALS if current_thread() is main_thread() else ()
    before = {signal_number: signal.signal(signal_number, request) for signal_number in handled}
    try:
        yield stop
    finally:
        for signal_number, handler in before.items():
            signal.signal(signal_number, handler)
