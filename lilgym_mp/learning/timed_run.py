"""Base of training runs whose budget is CPU time or optimiser steps: when to report, to save and to stop."""

from __future__ import annotations

import math
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any, Generic, NamedTuple, TypeVar

from lilgym_mp.learning.training_run import TrainingError, TrainingRun

SAVE_SECONDS = 60.0  # CPU time between checkpoints
REPORT_SECONDS = 15.0

Measured = TypeVar("Measured")


def cpu_seconds() -> float:
    """CPU time of this process and its terminated children."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@dataclass
class Counters:
    """The counters in a checkpoint; field names are part of its format."""

    steps: int = 0  # of the optimiser
    cpu_seconds: float = 0.0  # over all sessions of the run
    exploring_seconds: float = 0.0  # part of them for data collection


class Budget(NamedTuple):
    """`minutes` of CPU time, everything included, or `steps` of the optimiser; the other one is None."""

    minutes: float | None
    steps: int | None

    def check(self) -> None:
        """Raises ValueError unless there is one positive budget."""
        if (self.minutes is None) == (self.steps is None):
            raise ValueError("give a budget: either minutes or steps")
        if not 0 < (self.minutes or self.steps or 0) < math.inf:
            raise ValueError(f"the budget must be positive, not {self.minutes or self.steps}")


class TimedRun(ABC, Generic[Measured]):
    """A run in memory."""

    files: TrainingRun
    counters: Counters

    def __init__(self, budget: Budget) -> None:
        budget.check()
        self.budget = budget
        self._start_cpu_seconds = cpu_seconds()

    @abstractmethod
    def state(self) -> dict[str, Any]:
        """What a checkpoint has besides the counters."""

    @abstractmethod
    def restore(self, state: dict[str, Any]) -> None:
        """Inverse of `state`; the counters have been restored."""

    @abstractmethod
    def step(self) -> Measured:
        """One optimiser step, with data collection when it is due."""

    @abstractmethod
    def report(self, recent: Sequence[Measured]) -> None:
        """Reports the steps since the last report."""

    def seconds(self) -> float:
        return self.counters.cpu_seconds + cpu_seconds() - self._start_cpu_seconds

    def progress(self) -> float:
        """The fraction of the budget spent."""
        if self.budget.steps is not None:
            return self.counters.steps / self.budget.steps
        assert self.budget.minutes is not None
        return self.seconds() / (60 * self.budget.minutes)

    def optimise(self) -> None:
        """Takes steps until the budget is spent."""
        recent: list[Measured] = []
        saved = reported = self.seconds()
        while self.progress() < 1:
            recent.append(self.step())
            now = self.seconds()
            if now - reported > REPORT_SECONDS:
                self.report(recent)
                recent, reported = [], now
            if now - saved > SAVE_SECONDS:
                self.save()
                saved = now
        if recent:
            self.report(recent)

    @contextmanager
    def saved_on_interrupt(self) -> Iterator[None]:
        try:
            yield
        except KeyboardInterrupt:
            self.save()
            raise

    @contextmanager
    def exploring(self) -> Iterator[None]:
        """Counts the time spent in the block as data collection."""
        began = self.seconds()
        yield
        self.counters.exploring_seconds += self.seconds() - began

    def not_finite(self, parts: str = "") -> TrainingError:
        """The error for a loss that is not finite; `parts`: the losses that it adds up."""
        return TrainingError(
            f"the loss is not finite at step {self.counters.steps}{parts and f' ({parts})'};"
            f" the last good checkpoint is kept in {self.files.path}; try a lower learning rate"
        )

    def save(self) -> None:
        counters = {**asdict(self.counters), "cpu_seconds": self.seconds()}
        self.files.save_checkpoint({**self.state(), "counters": counters})

    def load(self, device: Any) -> None:
        """Continues from the checkpoint, if there is one. Raises TrainingRunError."""
        if self.files.has_checkpoint:
            with self.files.checkpoint(device) as state:
                self.counters = type(self.counters)(**state["counters"])
                self.restore(state)

    def statistics(self) -> dict[str, float]:
        """Details of the model file."""
        minutes, exploring = self.seconds() / 60, self.counters.exploring_seconds / 60
        return {"cpu_minutes": round(minutes, 2), "exploring_cpu_minutes": round(exploring, 2)}
