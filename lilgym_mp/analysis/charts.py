"""Horizontal bar charts of corpus statistics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from lilgym_mp.analysis.phenomena import PHENOMENA
from lilgym_mp.analysis.statistics import CorpusStatistics, StatementStatistics
from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.plotting import new_figure, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 760  # pixels
BAR_HEIGHT, GROUP_GAP, HEAD_HEIGHT = 11, 9, 100
BLUES, BROWNS = ("#1f4e9c", "#6f9bd8", "#b9cdec"), ("#8a5a00", "#d49a2a", "#efd59a")
MAX_WORDS = 30  # most program words shown


class Series(NamedTuple):
    """One bar per category, all in one colour."""

    name: str
    fill: str
    values: Sequence[float]


def bar_chart(title: str, categories: Sequence[str], series: Sequence[Series], unit: str = "") -> Figure:
    """One horizontal bar per category and series, labelled with its value and `unit`.

    Raises ValueError when a series does not have one value per category, ImportError without matplotlib.
    """
    for one in series:
        if len(one.values) != len(categories):
            raise ValueError(f"series {one.name!r} has {len(one.values)} values for {len(categories)} categories")
    group_height = BAR_HEIGHT * len(series) + GROUP_GAP
    figure: Any = new_figure(WIDTH, HEAD_HEIGHT + group_height * len(categories))
    axes: Any = figure.subplots()
    axes.set_title(title, loc="left", fontweight="bold")
    for bar_index, one in enumerate(series):
        tops = [index * group_height + bar_index * BAR_HEIGHT for index in range(len(categories))]
        bars = axes.barh(tops, one.values, BAR_HEIGHT - 1, align="edge", color=one.fill, label=one.name)
        axes.bar_label(bars, [_shown(value) + unit for value in one.values], fontsize=7, padding=3)
    middles = [(index + 0.5) * group_height - GROUP_GAP / 2 for index in range(len(categories))]
    axes.set_yticks(middles, labels=categories)
    axes.invert_yaxis()
    axes.spines[["top", "right", "bottom"]].set_visible(False)
    axes.set_xticks([])
    if series:
        figure.legend(loc="outside upper left", ncols=3, frameon=False, fontsize=8)
    return figure


def _shown(value: float) -> str:
    return f"{value:.0f}" if value >= 10 or value == int(value) else f"{value:.1f}"


def write_charts(statistics: CorpusStatistics, directory: Path) -> list[Path]:
    """Writes the corpus's charts as SVG files into the directory, which is created; returns their paths.

    Raises ImportError without matplotlib.
    """
    directory.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    for name, draw in _CHARTS.items():
        path = directory / f"{name}.svg"
        save(draw(statistics), path, "svg")
        written.append(path)
    return written


def _by_group(statistics: CorpusStatistics, counts: Callable[[StatementStatistics], Sequence[int]]) -> list[Series]:
    """One series per appearance and split: counts in per cent of the statements; one hue per appearance."""
    families = dict(zip(APPEARANCES, cycle((BLUES, BROWNS)), strict=False))
    return [
        Series(
            f"{group.appearance} {group.split}",
            families[group.appearance][list(SPLITS).index(group.split)],
            [_percent(count, group) for count in counts(group)],
        )
        for group in statistics.statements
    ]


def _phenomena(statistics: CorpusStatistics) -> Figure:
    series = _by_group(statistics, lambda group: [group.phenomena[phenomenon] for phenomenon in PHENOMENA])
    return bar_chart(f"Statements of {statistics.corpus} that show a phenomenon", list(PHENOMENA), series, " %")


def _program_words(statistics: CorpusStatistics) -> Figure:
    uses = Counter(name for group in statistics.statements for name in group.program_words.elements())
    common = [name for name, _ in uses.most_common(MAX_WORDS)]
    title = f"Programs of {statistics.corpus} that use a word (the {len(common)} most common)"
    return bar_chart(title, common, _by_group(statistics, lambda group: [group.program_words[w] for w in common]), " %")


def _statement_lengths(statistics: CorpusStatistics) -> Figure:
    found = {length for group in statistics.statements for length in group.word_counts}
    lengths = range(min(found), max(found) + 1)
    series = _by_group(statistics, lambda group: [group.word_counts.count(length) for length in lengths])
    return bar_chart(f"Statements of {statistics.corpus} by number of words", list(map(str, lengths)), series, " %")


def _seen_in_train(statistics: CorpusStatistics) -> Figure:
    later = [(group, statistics.overlap(group)) for group in statistics.statements if group.split != "train"]
    pairs = [(group, overlap) for group, overlap in later if overlap is not None]
    series = [
        Series("statement seen", BLUES[0], [_percent(overlap.seen, group) for group, overlap in pairs]),
        Series("form seen", BLUES[1], [_percent(overlap.seen_forms, group) for group, overlap in pairs]),
    ]
    categories = [f"{group.appearance} {group.split}" for group, _ in pairs]
    return bar_chart(f"Statements of {statistics.corpus} that occur in train", categories, series, " %")


_CHARTS: Mapping[str, Callable[[CorpusStatistics], Figure]] = {
    "phenomena": _phenomena,
    "program_words": _program_words,
    "statement_lengths": _statement_lengths,
    "seen_in_train": _seen_in_train,
}


def _percent(count: int, group: StatementStatistics) -> float:
    return 100 * count / len(group.programs)
