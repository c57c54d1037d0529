"""Measures all cases once per round, so that temporary load on the machine affects all of them alike."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from statistics import median
from typing import NamedTuple

from lilgym_mp.benchmark.catalogue import COPY_GROUP, BenchmarkCase
from lilgym_mp.benchmark.players import Play, Timing
from lilgym_mp.benchmark.traces import ACTIONS, Workload

OPTIONAL_PACKAGES = ("stable_baselines3", "torch", "pettingzoo")


class Effort(NamedTuple):
    """How long to measure."""

    repeats: int  # rounds
    seconds: float  # minimum time of one measurement
    actions: int = ACTIONS  # actions of a workload, over all environments


EFFORTS: Mapping[str, Effort] = {"full": Effort(9, 0.1), "quick": Effort(3, 0.01, ACTIONS // 8)}


@dataclass
class Measurement:
    """The steps (or calls) per second of a case in each round."""

    configuration: str
    case: BenchmarkCase
    rates: list[float] = field(default_factory=list)

    @property
    def median(self) -> float:
        return median(self.rates)


def load_average() -> float:
    """Load average of the last minute, NaN if unknown."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")


class Bench:
    """Collects the measurements of any number of configurations."""

    def __init__(self, effort: Effort) -> None:
        self.effort = effort
        self.results: list[Measurement] = []
        self.notes: list[str] = []
        self.is_interrupted = False
        self.load_averages = (load_average(), float("nan"))  # before the first and after the last measurement

    def measure(
        self, workload: Workload, benchmark_cases: Sequence[BenchmarkCase], on_round: Callable[[], object]
    ) -> None:
        """Measures the cases on a workload; Ctrl-C stops, and keeps the measurements made so far.

        Cases whose packages are not installed are skipped, with a note.
        """
        measured = [Measurement(workload.configuration, case) for case in benchmark_cases]
        try:
            with ExitStack() as stack:
                plays = [
                    (measurement, play)
                    for measurement in measured
                    if (play := self._opened(measurement, workload, stack)) is not None
                ]
                for round_index in range(self.effort.repeats):
                    for measurement, play in plays if round_index % 2 == 0 else reversed(plays):
                        measurement.rates.append(self._rate(play))
                    on_round()
        except KeyboardInterrupt:
            self.is_interrupted = True
        self.results += [measurement for measurement in measured if measurement.rates]
        self.load_averages = (self.load_averages[0], load_average())

    def _opened(self, measurement: Measurement, workload: Workload, stack: ExitStack) -> Play | None:
        try:
            return stack.enter_context(measurement.case.open(workload))
        except ImportError as missing:
            if (missing.name or "").partition(".")[0] not in OPTIONAL_PACKAGES:
                raise
            note = f"not measured: {measurement.case.group} (needs {missing.name})"
            if note not in self.notes:
                self.notes.append(note)
            return None

    def _rate(self, play: Play) -> float:
        play()  # refills the CPU caches after the other cases
        total = Timing(0, 0.0)
        while total.seconds < self.effort.seconds:
            steps, seconds = play()
            assert steps, "would loop forever"
            total = Timing(total.steps + steps, total.seconds + seconds)
        return total.steps / total.seconds

    def find(self, configuration: str, name: str, num_envs: int) -> Measurement | None:
        wanted = configuration, name, num_envs
        found = (one for one in self.results if (one.configuration, one.case.name, one.case.num_envs) == wanted)
        return next(found, None)

    def ratio_to_copying(self, measurement: Measurement) -> float | None:
        """The median over the rounds of the speed relative to copying the images of as many environments."""
        limit = self.find(measurement.configuration, "memory copy", measurement.case.num_envs)
        if limit is None or measurement.case.group == COPY_GROUP or measurement.case.is_part:
            return None
        return median(ours / theirs for ours, theirs in zip(measurement.rates, limit.rates, strict=False))

    @property
    def configurations(self) -> list[str]:
        return list(dict.fromkeys(measurement.configuration for measurement in self.results))
