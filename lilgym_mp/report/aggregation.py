"""Means over runs, intervals and tests over statements."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import mean, stdev
from typing import NamedTuple

import numpy as np

from lilgym_mp.evaluation.episodes import RecordedEpisode, Recording

RESAMPLES = 4_000
CONFIDENCE = 0.95


class Spread(NamedTuple):
    """A number over runs."""

    mean: float
    deviation: float | None  # of a sample (n - 1); None of one run
    runs: int

    def __str__(self) -> str:
        return f"{self.mean:.2f}" if self.deviation is None else f"{self.mean:.2f} ± {self.deviation:.2f}"


def spread(values: Sequence[float]) -> Spread | None:
    """Mean and sample standard deviation, None of nothing."""
    if not values:
        return None
    return Spread(mean(values), stdev(values) if len(values) > 1 else None, len(values))


def over_runs(runs: Iterable[Recording], value: Callable[[Sequence[RecordedEpisode]], float | None]) -> Spread | None:
    """The spread of a number of each run's episodes; runs for which there is none are left out."""
    return spread([found for run in runs if (found := value(run.episodes)) is not None])


def accuracy(episodes: Sequence[RecordedEpisode]) -> float | None:
    """Task completion in per cent, None of no episodes."""
    return share(episodes, lambda episode: episode.is_success)


def share(episodes: Sequence[RecordedEpisode], holds: Callable[[RecordedEpisode], bool]) -> float | None:
    """Per cent of the episodes for which something holds, None of no episodes."""
    return 100 * sum(map(holds, episodes)) / len(episodes) if episodes else None


def average(episodes: Sequence[RecordedEpisode], value: Callable[[RecordedEpisode], float]) -> float | None:
    return mean(map(value, episodes)) if episodes else None


class Difference(NamedTuple):
    """One agent's accuracy less another's, in points."""

    points: float
    low: float  # of the 95 % interval
    high: float
    p_value: float  # two-sided, of there being no difference


def by_statement(runs: Iterable[Recording]) -> dict[str, tuple[int, int]]:
    """Successes and episodes of each statement, all runs together."""
    found: dict[str, tuple[int, int]] = {}
    for run in runs:
        for episode in run.episodes:
            successes, episodes = found.get(episode.statement, (0, 0))
            found[episode.statement] = successes + episode.is_success, episodes + 1
    return found


def accuracy_interval(runs: Iterable[Recording]) -> tuple[float, float]:
    """The 95 % interval of the accuracy in per cent: statements are drawn again, with all that belongs to them."""
    return _interval(_resampled(np.array(list(by_statement(runs).values()), float)))


def paired_difference(first: Iterable[Recording], second: Iterable[Recording]) -> Difference | None:
    """The first agent's accuracy less the second's on the statements of both, None where they share none."""
    one, other = by_statement(first), by_statement(second)
    shared = [statement for statement in one if statement in other]
    if not shared:
        return None
    counts = [np.array([found[statement] for statement in shared], float) for found in (one, other)]
    points = float(np.subtract(*(100 * both[:, 0].sum() / both[:, 1].sum() for both in counts)))
    drawn = _resampled(counts[0]) - _resampled(counts[1])  # the same draws for both
    below, above = (drawn <= 0).mean(), (drawn >= 0).mean()
    p_value = min(1.0, 2 * max(min(below, above), 1 / RESAMPLES))
    return Difference(points, *_interval(drawn), p_value)


def _resampled(counts: np.ndarray) -> np.ndarray:
    """(RESAMPLES,) accuracies in per cent of (statements, 2) successes and episodes, from a generator of one seed."""
    statements = len(counts)
    drawn = np.random.default_rng(0).multinomial(statements, np.full(statements, 1 / statements), RESAMPLES)
    successes, episodes = (drawn @ counts).T
    return 100 * successes / episodes


def _interval(values: np.ndarray) -> tuple[float, float]:
    rest = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(values, [rest, 100 - rest])
    return float(low), float(high)


def grouped(
    episodes: Iterable[RecordedEpisode], key: Callable[[RecordedEpisode], str | None]
) -> Mapping[str, list[RecordedEpisode]]:
    """The episodes by key; those whose key is None are left out."""
    found: dict[str, list[RecordedEpisode]] = {}
    for episode in episodes:
        if (name := key(episode)) is not None:
            found.setdefault(name, []).append(episode)
    return found
