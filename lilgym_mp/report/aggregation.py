"""Means and deviations over runs; bootstrap intervals and paired tests over runs and statements."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import erfc, sqrt
from statistics import mean, stdev
from typing import NamedTuple

import numpy as np

from lilgym_mp.evaluation.episodes import RecordedEpisode, Recording

RESAMPLES = 4_000
CONFIDENCE = 0.95
INTERVAL_NOTE = (
    f"95 % intervals by a hierarchical bootstrap: runs, and statements with all of their start scenes, are resampled"
    f" {RESAMPLES:,} times. With one run they express the choice of statements alone; with three they underestimate the"
    " spread between runs by up to a fifth."
)


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


class Counts(NamedTuple):
    """Successes and episodes by run and statement."""

    statements: tuple[str, ...]
    successes: np.ndarray  # (runs, statements)
    episodes: np.ndarray  # (runs, statements)


def count_successes(runs: Iterable[Recording], target: bool | None = None) -> Counts:
    """`target`: count only episodes with this target value."""
    counts: dict[tuple[int, str], list[int]] = {}
    runs = list(runs)
    for index, run in enumerate(runs):
        for episode in run.episodes:
            if target is None or episode.target == target:
                cell = counts.setdefault((index, episode.statement), [0, 0])
                cell[0] += episode.is_success
                cell[1] += 1
    statements = tuple(dict.fromkeys(statement for _, statement in counts))
    column = {statement: index for index, statement in enumerate(statements)}
    arrays = np.zeros((2, len(runs), len(statements)))
    for (row, statement), cell in counts.items():
        arrays[:, row, column[statement]] = cell
    return Counts(statements, *arrays)


def accuracy_interval(runs: Iterable[Recording], target: bool | None = None) -> tuple[float, float] | None:
    """The 95 % interval of the accuracy in per cent by a hierarchical bootstrap; None without episodes.

    Both the training runs and the statements, with all of their episodes, are resampled.
    """
    counts = count_successes(runs, target)
    if not counts.statements:
        return None
    rng = np.random.default_rng(0)
    return _percentile_interval(_resampled_accuracies(counts, _resampled(rng, len(counts.statements)), rng))


def paired_difference(first: Iterable[Recording], second: Iterable[Recording]) -> Difference | None:
    """The first agent's accuracy minus the second's on their common statements; None if there are none.

    Each resample draws one set of statements for both agents, and runs for each. p is that of a normal distribution
    with the resamples' standard deviation; if they are all equal, that of the sign test.
    """
    counts = [count_successes(first), count_successes(second)]
    shared = [statement for statement in counts[0].statements if statement in set(counts[1].statements)]
    if not shared:
        return None
    kept = [_of_statements(each, shared) for each in counts]
    points = float(np.subtract(*(100 * each.successes.sum() / each.episodes.sum() for each in kept)))
    rng = np.random.default_rng(0)
    weights = _resampled(rng, len(shared))
    differences = np.subtract(*(_resampled_accuracies(each, weights, rng) for each in kept))
    deviation = float(differences.std())
    if deviation > 0:
        p_value = erfc(abs(points) / deviation / sqrt(2))
    else:
        p_value = min(1.0, 2.0 ** (1 - len(shared))) if points else 1.0
    return Difference(points, *_percentile_interval(differences), p_value)


def holm(p_values: Sequence[float]) -> list[float]:
    """The p-values corrected for their number (Holm, 1979)."""
    corrected = [0.0] * len(p_values)
    largest = 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=lambda index: p_values[index])):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        corrected[index] = largest
    return corrected


def _of_statements(counts: Counts, statements: Sequence[str]) -> Counts:
    column = {statement: index for index, statement in enumerate(counts.statements)}
    chosen = [column[statement] for statement in statements]
    return Counts(tuple(statements), counts.successes[:, chosen], counts.episodes[:, chosen])


def _resampled(rng: np.random.Generator, count: int) -> np.ndarray:
    """(RESAMPLES, count) how often each is drawn, with replacement."""
    return rng.multinomial(count, np.full(count, 1 / count), RESAMPLES)


def _resampled_accuracies(counts: Counts, statement_weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(RESAMPLES,) accuracies in per cent."""
    run_weights = _resampled(rng, len(counts.successes))
    successes, episodes = ((run_weights @ each * statement_weights).sum(1) for each in counts[1:])
    return 100 * successes / np.maximum(episodes, 1)


def _percentile_interval(values: np.ndarray) -> tuple[float, float]:
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(values, [tail, 100 - tail])
    return float(low), float(high)
