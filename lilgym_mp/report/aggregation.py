"""Means and deviations over runs; bootstrap intervals and paired tests over statements."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from statistics import mean, stdev
from typing import NamedTuple

import numpy as np

from lilgym_mp.evaluation.episodes import RecordedEpisode, Recording

RESAMPLES = 4_000
CONFIDENCE = 0.95


class MeanStd(NamedTuple):
    """Mean and standard deviation of a metric over runs."""

    mean: float
    deviation: float | None  # sample standard deviation (n - 1); None for a single run
    runs: int

    def __str__(self) -> str:
        return f"{self.mean:.2f}" if self.deviation is None else f"{self.mean:.2f} ± {self.deviation:.2f}"


def mean_std(values: Sequence[float]) -> MeanStd | None:
    """Mean and sample standard deviation of the values; None if there are none."""
    if not values:
        return None
    return MeanStd(mean(values), stdev(values) if len(values) > 1 else None, len(values))


def aggregate_runs(
    runs: Iterable[Recording], metric: Callable[[Sequence[RecordedEpisode]], float | None]
) -> MeanStd | None:
    """Mean and deviation over runs of a metric of each run's episodes; runs where it is None are left out."""
    return mean_std([value for run in runs if (value := metric(run.episodes)) is not None])


def accuracy(episodes: Sequence[RecordedEpisode]) -> float | None:
    """Task-completion rate in per cent; None for no episodes."""
    return share(episodes, lambda episode: episode.is_success)


def accuracy_where(runs: Iterable[Recording], predicate: Callable[[RecordedEpisode], bool]) -> MeanStd | None:
    """Accuracy over runs on the episodes that satisfy a predicate."""
    return aggregate_runs(runs, lambda episodes: accuracy(list(filter(predicate, episodes))))


def share(episodes: Sequence[RecordedEpisode], holds: Callable[[RecordedEpisode], bool]) -> float | None:
    """Per cent of the episodes that satisfy a predicate; None for no episodes."""
    return 100 * sum(map(holds, episodes)) / len(episodes) if episodes else None


def average(episodes: Sequence[RecordedEpisode], value: Callable[[RecordedEpisode], float]) -> float | None:
    return mean(map(value, episodes)) if episodes else None


class Difference(NamedTuple):
    """Difference between two agents' accuracies in percentage points, with its 95 % interval."""

    points: float
    low: float
    high: float
    p_value: float  # two-sided; null hypothesis: no difference


def successes_by_statement(runs: Iterable[Recording]) -> dict[str, tuple[int, int]]:
    """(successes, episodes) of each statement, pooled over runs."""
    counts: dict[str, tuple[int, int]] = {}
    for run in runs:
        for episode in run.episodes:
            successes, episodes = counts.get(episode.statement, (0, 0))
            counts[episode.statement] = successes + episode.is_success, episodes + 1
    return counts


def accuracy_interval(runs: Iterable[Recording]) -> tuple[float, float]:
    """The 95 % bootstrap interval of the accuracy in per cent, resampling statements with all of their episodes."""
    return _percentile_interval(_bootstrap_accuracies(np.array(list(successes_by_statement(runs).values()), float)))


def paired_difference(first: Iterable[Recording], second: Iterable[Recording]) -> Difference | None:
    """The first agent's accuracy minus the second's on their common statements; None if there are none."""
    one, other = successes_by_statement(first), successes_by_statement(second)
    shared = [statement for statement in one if statement in other]
    if not shared:
        return None
    counts = [np.array([by_statement[statement] for statement in shared], float) for by_statement in (one, other)]
    points = float(np.subtract(*(100 * array[:, 0].sum() / array[:, 1].sum() for array in counts)))
    differences = _bootstrap_accuracies(counts[0]) - _bootstrap_accuracies(counts[1])  # same resamples for both
    below, above = (differences <= 0).mean(), (differences >= 0).mean()
    p_value = min(1.0, 2 * max(min(below, above), 1 / RESAMPLES))
    return Difference(points, *_percentile_interval(differences), p_value)


def _bootstrap_accuracies(counts: np.ndarray) -> np.ndarray:
    """(RESAMPLES,) accuracies in per cent, from (statements, 2) counts of successes and episodes; fixed seed."""
    statements = len(counts)
    weights = np.random.default_rng(0).multinomial(statements, np.full(statements, 1 / statements), RESAMPLES)
    successes, episodes = (weights @ counts).T
    return 100 * successes / episodes


def _percentile_interval(values: np.ndarray) -> tuple[float, float]:
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(values, [tail, 100 - tail])
    return float(low), float(high)
