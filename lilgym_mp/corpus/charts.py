"""Bar charts as SVG, written without a plotting library, and those that show a corpus's statistics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.corpus.phenomena import Phenomenon
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.corpus.statistics import CorpusStatistics, StatementStatistics

WIDTH = 760  # pixels
LABEL_WIDTH, VALUE_WIDTH = 200, 60
BAR_HEIGHT, GROUP_GAP, HEAD_HEIGHT, LEGEND_HEIGHT = 11, 9, 40, 22
FONT = 'font-family="Helvetica, Arial, sans-serif"'
INK, RULE = "#222222", "#cccccc"
BLUES, BROWNS = ("#1f4e9c", "#6f9bd8", "#b9cdec"), ("#8a5a00", "#d49a2a", "#efd59a")
MOST_WORDS = 30  # program words shown


class Series(NamedTuple):
    """One bar a category, all in one colour."""

    name: str
    fill: str
    values: Sequence[float]


def bar_chart(title: str, categories: Sequence[str], series: Sequence[Series], unit: str = "") -> str:
    """An SVG document: for each category one horizontal bar a series, from 0, with its value and `unit`.

    Raises ValueError when a series has not one value a category.
    """
    for one in series:
        if len(one.values) != len(categories):
            raise ValueError(f"series {one.name!r} has {len(one.values)} values for {len(categories)} categories")
    group_height = BAR_HEIGHT * len(series) + GROUP_GAP
    height = HEAD_HEIGHT + LEGEND_HEIGHT + group_height * len(categories) + GROUP_GAP
    greatest = max((value for one in series for value in one.values), default=0) or 1
    scale = (WIDTH - LABEL_WIDTH - VALUE_WIDTH) / greatest
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}">',
        f'<rect width="{WIDTH}" height="{height}" fill="white"/>',
        _text(14, 25, title, size=16, weight="bold"),
        *_legend(series),
    ]
    for number, category in enumerate(categories):
        top = HEAD_HEIGHT + LEGEND_HEIGHT + number * group_height
        lines.append(_text(LABEL_WIDTH - 8, top + (group_height - GROUP_GAP) / 2 + 4, category, anchor="end"))
        for place, one in enumerate(series):
            lines += _bar(top + place * BAR_HEIGHT, one.values[number], scale, one.fill, unit)
    lines.append(
        f'<line x1="{LABEL_WIDTH}" y1="{HEAD_HEIGHT + LEGEND_HEIGHT - 4}" x2="{LABEL_WIDTH}" y2="{height - 6}" '
        f'stroke="{RULE}"/>'
    )
    return "\n".join([*lines, "</svg>", ""])


def write_charts(statistics: CorpusStatistics, directory: Path) -> list[Path]:
    """Writes the corpus's charts as SVG files; gives their paths. Makes the directory."""
    directory.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    for name, draw in _CHARTS.items():
        path = directory / f"{name}.svg"
        path.write_text(draw(statistics), encoding="utf-8")
        written.append(path)
    return written


def _by_group(statistics: CorpusStatistics, counts: Callable[[StatementStatistics], Sequence[int]]) -> list[Series]:
    """A series for each appearance and split: the counts in per cent of the statements; a family of colours each."""
    families = dict(zip(APPEARANCES, (BLUES, BROWNS), strict=True))
    return [
        Series(
            f"{group.appearance} {group.split}",
            families[group.appearance][list(SPLITS).index(group.split)],
            [_percent(count, group) for count in counts(group)],
        )
        for group in statistics.statements
    ]


def _phenomena(statistics: CorpusStatistics) -> str:
    series = _by_group(statistics, lambda group: [group.phenomena[phenomenon] for phenomenon in Phenomenon])
    return bar_chart(f"Statements of {statistics.corpus} that show a phenomenon", list(Phenomenon), series, " %")


def _program_words(statistics: CorpusStatistics) -> str:
    uses = Counter(name for group in statistics.statements for name in group.program_words.elements())
    common = [name for name, _ in uses.most_common(MOST_WORDS)]
    title = f"Programs of {statistics.corpus} that use a word (the {len(common)} commonest)"
    return bar_chart(title, common, _by_group(statistics, lambda group: [group.program_words[w] for w in common]), " %")


def _statement_lengths(statistics: CorpusStatistics) -> str:
    found = {length for group in statistics.statements for length in group.word_counts}
    lengths = range(min(found), max(found) + 1)
    series = _by_group(statistics, lambda group: [group.word_counts.count(length) for length in lengths])
    return bar_chart(f"Statements of {statistics.corpus} by number of words", list(map(str, lengths)), series, " %")


def _seen_in_train(statistics: CorpusStatistics) -> str:
    later = [(group, statistics.overlap(group)) for group in statistics.statements if group.split != "train"]
    pairs = [(group, overlap) for group, overlap in later if overlap is not None]
    series = [
        Series("statement seen", BLUES[0], [_percent(overlap.seen, group) for group, overlap in pairs]),
        Series("form seen", BLUES[1], [_percent(overlap.seen_forms, group) for group, overlap in pairs]),
    ]
    categories = [f"{group.appearance} {group.split}" for group, _ in pairs]
    return bar_chart(f"Statements of {statistics.corpus} that stand in train", categories, series, " %")


_CHARTS: Mapping[str, Callable[[CorpusStatistics], str]] = {
    "phenomena": _phenomena,
    "program_words": _program_words,
    "statement_lengths": _statement_lengths,
    "seen_in_train": _seen_in_train,
}


def _percent(count: int, group: StatementStatistics) -> float:
    return 100 * count / len(group.programs)


def _text(x: float, y: float, text: str, size: int = 12, anchor: str = "start", weight: str = "normal") -> str:
    return (
        f'<text x="{x:g}" y="{y:g}" {FONT} font-size="{size}" font-weight="{weight}" text-anchor="{anchor}" '
        f'fill="{INK}">{escape(text)}</text>'
    )


def _legend(series: Sequence[Series]) -> Iterator[str]:
    step = (WIDTH - 28) / max(1, len(series))
    for place, one in enumerate(series):
        x = 14 + place * step
        yield f'<rect x="{x:g}" y="{HEAD_HEIGHT}" width="10" height="10" fill="{one.fill}"/>'
        yield _text(x + 15, HEAD_HEIGHT + 9, one.name, size=11)


def _bar(top: float, value: float, scale: float, fill: str, unit: str) -> list[str]:
    length = value * scale
    shown = f"{value:.0f}" if value >= 10 or value == int(value) else f"{value:.1f}"
    return [
        f'<rect x="{LABEL_WIDTH}" y="{top:g}" width="{length:.1f}" height="{BAR_HEIGHT - 1}" fill="{fill}"/>',
        _text(LABEL_WIDTH + length + 4, top + BAR_HEIGHT - 2, shown + unit, size=9),
    ]
