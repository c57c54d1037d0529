"""Means and deviations over runs; bootstrap intervals and paired tests over runs and statements."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import erfc, sqrt
from statistics import mean, stdev
from typing import NamedTuple

import numpy as np

from lilgym_mp.envs.resampling import drawn_counts, percentile_interval
from lilgym_mp.evaluation.episode_files import Recording
from lilgym_mp.evaluation.episodes import Episode
from lilgym_mp.evaluation.results import rounded

RESAMPLES = 4_000
INTERVAL_NOTE = (
    f"95 % intervals by a hierarchical bootstrap: runs, and statements with all of their start scenes, are resampled"
    f" {RESAMPLES:,} times. With one run they express the choice of statements alone; with three they underestimate the"
    " spread between runs by up to a fifth."
)
Predicate = Callable[[Episode], bool]
Value = Callable[[Episode], float]


class MeanStd(NamedTuple):
    """Mean and standard deviation of a metric over runs, with its 95 % interval if that was computed."""

    mean: float
    deviation: float | None  # sample standard deviation (n - 1); None for a single run
    runs: int
    low: float | None = None
    high: float | None = None
    episodes: int | None = None  # of a run, if known
    printed_places: int | None = None  # decimals of a published figure, which are kept

    def text(self, places: int = 2) -> str:
        """The mean, the deviation and the interval, as far as they are known."""
        places = places if self.printed_places is None else self.printed_places
        deviation = "" if self.deviation is None else f" ± {rounded(self.deviation, places)}"
        interval = ""
        if self.low is not None and self.high is not None:
            interval = f" [{rounded(self.low, places)}, {rounded(self.high, places)}]"
        return f"{rounded(self.mean, places)}{deviation}{interval}"

    __str__ = text


def success(episode: Episode) -> float:
    """100 for a success, 0 otherwise."""
    return 100.0 if episode.is_success else 0.0


def mean_std(values: Sequence[float]) -> MeanStd:
    """Mean and sample standard deviation of the values."""
    return MeanStd(mean(values), stdev(values) if len(values) > 1 else None, len(values))


def accuracy_where(runs: Iterable[Recording], predicate: Predicate | None = None) -> MeanStd | None:
    """Accuracy over runs in per cent on all episodes, or those that satisfy a predicate, with its interval."""
    return mean_where(runs, success, predicate)


def mean_where(runs: Iterable[Recording], value: Value, predicate: Predicate | None = None) -> MeanStd | None:
    """Mean over runs of a value of all episodes, or those that satisfy a predicate, with its interval; None of none."""
    chosen = ([(e.statement, value(e)) for e in filter(predicate, run.episodes)] for run in runs)
    kept = [values for values in chosen if values]
    if not kept:
        return None
    found = mean_std([mean(number for _, number in values) for values in kept])
    low, high = percentile_interval(resampled_means(add_up(kept)))
    return found._replace(low=low, high=high, episodes=min(map(len, kept)))


class Difference(NamedTuple):
    """Difference between two agents' accuracies in percentage points, with its 95 % interval."""

    points: float
    low: float
    high: float
    p_value: float  # two-sided; null hypothesis: no difference


def add_up(runs: Sequence[Sequence[tuple[str, float]]]) -> np.ndarray:
    """(2, runs, statements) sums and numbers of the values of each run, which have a statement each."""
    statements = sorted({statement for values in runs for statement, _ in values})
    column = {statement: index for index, statement in enumerate(statements)}
    totals = np.zeros((2, len(runs), len(statements)))
    for row, values in enumerate(runs):
        for statement, value in values:
            totals[:, row, column[statement]] += value, 1
    return totals


def paired_difference(first: Iterable[Recording], second: Iterable[Recording]) -> Difference | None:
    """The first agent's accuracy minus the second's on their common statements; None if there are none.

    Each resample draws one set of statements for both agents, and runs for each. p is that of a normal distribution
    with the resamples' standard deviation; if they are all equal, that of the sign test.
    """
    recorded = [[run.episodes for run in runs] for runs in (first, second)]
    shared = set.intersection(*({e.statement for episodes in runs for e in episodes} for runs in recorded))
    if not shared:
        return None
    kept = [
        add_up([[(e.statement, success(e)) for e in episodes if e.statement in shared] for episodes in runs])
        for runs in recorded
    ]
    points = float(np.subtract(*(values.sum() / episodes.sum() for values, episodes in kept)))
    differences = np.subtract(*(resampled_means(each, seed) for seed, each in enumerate(kept, start=1)))
    deviation = float(differences.std())
    if deviation > 0:
        p_value = erfc(abs(points) / deviation / sqrt(2))
    else:
        p_value = min(1.0, 2.0 ** (1 - len(shared))) if points else 1.0
    return Difference(points, *percentile_interval(differences), p_value)


def holm(p_values: Sequence[float]) -> list[float]:
    """The p-values corrected for their number (Holm, 1979)."""
    order = np.argsort(p_values)
    corrected = np.zeros(len(order))
    scaled = np.asarray(p_values)[order] * np.arange(len(order), 0, -1)
    corrected[order] = np.minimum(1, np.maximum.accumulate(scaled))
    return corrected.tolist()


def resampled_means(totals: np.ndarray, run_seed: int = 1) -> np.ndarray:
    """(RESAMPLES,) means by a hierarchical bootstrap: of the runs, and of the statements with all of their episodes."""
    _, runs, statements = totals.shape
    by_run = (drawn_counts(statements, RESAMPLES) @ each.T for each in totals)
    values, episodes = ((each * drawn_counts(runs, RESAMPLES, run_seed)).sum(1) for each in by_run)
    return values / np.maximum(episodes, 1)
