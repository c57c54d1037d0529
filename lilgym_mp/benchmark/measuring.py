"""Rounds in which every subject is measured once, so that what slows the machine for a while slows all alike."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from statistics import median
from typing import NamedTuple

from lilgym_mp.benchmark.catalogue import LIMIT, Subject
from lilgym_mp.benchmark.players import Play, Timed
from lilgym_mp.benchmark.traces import ACTIONS, Workload

OPTIONAL_PACKAGES = ("stable_baselines3", "torch", "pettingzoo")


class Effort(NamedTuple):
    """How thoroughly to measure."""

    repeats: int
    seconds: float  # that one measurement lasts at least
    actions: int = ACTIONS  # of a course's play


EFFORTS: Mapping[str, Effort] = {"full": Effort(9, 0.1), "quick": Effort(3, 0.01, ACTIONS // 8)}


@dataclass
class Measurement:
    """A subject's steps (or calls) per second in each round."""

    configuration: str
    subject: Subject
    rates: list[float] = field(default_factory=list)

    @property
    def median(self) -> float:
        return median(self.rates)

    def ratio_to(self, other: Measurement) -> float:
        """The median of what this is of the other, round by round."""
        return median(ours / theirs for ours, theirs in zip(self.rates, other.rates, strict=False))


def load_average() -> float:
    """Processes that ran or waited to run over the last minute; not a number where that is not known."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")


class Bench:
    """Measurements of any number of configurations, as far as they have come."""

    def __init__(self, effort: Effort) -> None:
        self.effort = effort
        self.results: list[Measurement] = []
        self.notes: list[str] = []
        self.is_interrupted = False
        self.load_averages = (load_average(), float("nan"))  # at the beginning and after the last measurement

    def measure(self, workload: Workload, subjects: Sequence[Subject], on_round: Callable[[], object]) -> None:
        """Measures the subjects on a course; Ctrl-C ends that, and what has been measured stays.

        Subjects whose packages are not installed are noted and left out.
        """
        measured = [Measurement(workload.configuration, subject) for subject in subjects]
        try:
            with ExitStack() as stack:
                plays = [(one, play) for one in measured if (play := self._opened(one, workload, stack)) is not None]
                for number in range(self.effort.repeats):
                    for one, play in plays if number % 2 == 0 else reversed(plays):
                        one.rates.append(self._rate(play))
                    on_round()
        except KeyboardInterrupt:
            self.is_interrupted = True
        self.results += [one for one in measured if one.rates]
        self.load_averages = (self.load_averages[0], load_average())

    def _opened(self, one: Measurement, workload: Workload, stack: ExitStack) -> Play | None:
        try:
            return stack.enter_context(one.subject.open(workload))
        except ImportError as missing:
            if (missing.name or "").partition(".")[0] not in OPTIONAL_PACKAGES:
                raise
            note = f"not measured: {one.subject.group} (needs {missing.name})"
            if note not in self.notes:
                self.notes.append(note)
            return None

    def _rate(self, play: Play) -> float:
        play()  # warms up what other subjects have driven out of the processor's caches
        total = Timed(0, 0.0)
        while total.seconds < self.effort.seconds:
            steps, seconds = play()
            assert steps, "a play without a step would be repeated for ever"
            total = Timed(total.steps + steps, total.seconds + seconds)
        return total.steps / total.seconds

    def find(self, configuration: str, name: str, num_envs: int) -> Measurement | None:
        for one in self.results:
            if (one.configuration, one.subject.name, one.subject.num_envs) == (configuration, name, num_envs):
                return one
        return None

    def of_copying(self, one: Measurement) -> float | None:
        """How fast the subject is, compared with copying the images of as many environments in the same rounds."""
        limit = self.find(one.configuration, "memory copy", one.subject.num_envs)
        return None if limit is None or one.subject.group == LIMIT or one.subject.is_part else one.ratio_to(limit)

    @property
    def configurations(self) -> list[str]:
        return list(dict.fromkeys(one.configuration for one in self.results))
