"""Statistics of the builtin corpus for docs/corpus.md, inserted there by scripts/build_builtin_corpus.py."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from lilgym_mp.corpus import words
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.corpus.tokens import statement_form
from lilgym_mp.generator import StartScene
from lilgym_mp.generator.meanings.statement_grammar import parse_statement
from lilgym_mp.report.phenomena import PHENOMENA, phenomena, syntactic_phenomena

BEGIN, END = "<!-- figures by scripts/build_builtin_corpus.py: begin -->", "<!-- figures: end -->"
MOST_STEPS = 12


@dataclass(frozen=True)
class SolvedEntry:
    """An entry of the file with the data of the report."""

    split: str
    statement: str
    program: str
    level: int  # 0: hand-written
    steps: int  # of the expert's solution from the empty scene, STOP included
    steps_proven: bool  # whether that is proven shortest
    starts: tuple[StartScene, ...]
    start_steps: tuple[int, ...]  # the same for each start scene
    starts_proven: int  # number of start scenes with a proven shortest solution
    mistyped: bool = False


def write_report(by_appearance: Mapping[str, Sequence[SolvedEntry]], corpus: Path, page: Path) -> None:
    """Replace the figures in the page. Raises ValueError if the markers around them are missing."""
    text = page.read_text(encoding="utf-8")
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{page}: missing the line {BEGIN!r} or {END!r}")
    page.write_text(f"{before}{BEGIN}\n{figures(by_appearance, corpus)}\n{END}{after}", encoding="utf-8")


def figures(by_appearance: Mapping[str, Sequence[SolvedEntry]], corpus: Path) -> str:
    """All tables, in Markdown."""
    size = f"The file has {corpus.stat().st_size:,} bytes."
    tables = (table(by_appearance) for table in (_sizes, _overlaps, _lengths, _phenomena, _origins))
    return "\n\n".join((size, *tables))


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *([str(cell) for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _columns(by_appearance: Mapping[str, Sequence[SolvedEntry]]) -> dict[str, list[SolvedEntry]]:
    return {
        f"{appearance.capitalize()} {split}": [entry for entry in entries if entry.split == split]
        for appearance, entries in by_appearance.items()
        for split in SPLITS
    }


def _sizes(by_appearance: Mapping[str, Sequence[SolvedEntry]]) -> str:
    columns = _columns(by_appearance)
    rows: dict[str, list[object]] = {
        "statements": [len(entries) for entries in columns.values()],
        "start scenes": [sum(len(entry.starts) for entry in entries) for entries in columns.values()],
        "forms": [len(_forms(entries)) for entries in columns.values()],
        "distinct words": [len(_words(entries)) for entries in columns.values()],
        "words per statement, mean (max)": [_word_counts(entries) for entries in columns.values()],
        "distinct programs": [len({entry.program for entry in entries}) for entries in columns.values()],
        "true in the empty scene": [sum(entry.steps == 1 for entry in entries) for entries in columns.values()],
    }
    every = {appearance: len(_forms(entries)) for appearance, entries in by_appearance.items()}
    text = ", ".join(f"{number} in {appearance.capitalize()}" for appearance, number in every.items())
    return f"{_table(['', *columns], ([name, *row] for name, row in rows.items()))}\n\nForms in all splits: {text}."


def _word_counts(entries: Sequence[SolvedEntry]) -> str:
    counts = [len(words(entry.statement)) for entry in entries]
    return f"{sum(counts) / len(counts):.1f} ({max(counts)})"


def _forms(entries: Iterable[SolvedEntry]) -> set[str]:
    return {statement_form(entry.statement) for entry in entries}


def _words(entries: Iterable[SolvedEntry]) -> set[str]:
    return {word for entry in entries for word in words(entry.statement)}


def _overlaps(by_appearance: Mapping[str, Sequence[SolvedEntry]]) -> str:
    rows: list[list[object]] = []
    for appearance, entries in by_appearance.items():
        train = [entry for entry in entries if entry.split == "train"]
        forms, known, programs = _forms(train), _words(train), {entry.program for entry in train}
        for split in ("dev", "test"):
            own = [entry for entry in entries if entry.split == split]
            seen = sum(statement_form(entry.statement) in forms for entry in own)
            same = sum(entry.program in programs for entry in own)
            rows.append([f"{appearance.capitalize()} {split}", seen, len(own) - seen, same, len(_words(own) - known)])
    head = ["", "form seen in train", "form unseen", "program seen in train", "words not in train"]
    return _table(head, rows)


def _lengths(by_appearance: Mapping[str, Sequence[SolvedEntry]]) -> str:
    rows: list[list[object]] = []
    for appearance, entries in by_appearance.items():
        scratch = Counter(entry.steps for entry in entries)
        flipit = Counter(steps for entry in entries for steps in entry.start_steps)
        proven = {
            "Scratch": sum(entry.steps_proven for entry in entries),
            "FlipIt": sum(entry.starts_proven for entry in entries),
        }
        for name, counts in (("Scratch", scratch), ("FlipIt", flipit)):
            steps = [counts[number] for number in range(1, MOST_STEPS + 1)]
            share = f"{100 * proven[name] / sum(counts.values()):.1f} %"
            rows.append([f"{appearance.capitalize()}{name}", *steps, share])
    head = ["actions, STOP included", *map(str, range(1, MOST_STEPS + 1)), "proven shortest"]
    return _table(head, rows)


def _phenomena(by_appearance: Mapping[str, Sequence[SolvedEntry]]) -> str:
    counts = {
        appearance: Counter(
            found for entry in entries for found in (*phenomena(entry.program), *syntactic_phenomena(entry.statement))
        )
        for appearance, entries in by_appearance.items()
    }
    head = ["phenomenon (statements)", *(appearance.capitalize() for appearance in by_appearance)]
    return _table(head, ([phenomenon, *(counts[a][phenomenon] for a in by_appearance)] for phenomenon in PHENOMENA))


def _origins(by_appearance: Mapping[str, Sequence[SolvedEntry]]) -> str:
    levels = sorted({entry.level for entries in by_appearance.values() for entry in entries})
    rows: list[list[object]] = [
        [
            "hand-written" if level == 0 else f"level {level}",
            *(sum(e.level == level for e in es) for es in by_appearance.values()),
        ]
        for level in levels
    ]
    rows.append(["mistyped", *(sum(entry.mistyped for entry in entries) for entries in by_appearance.values())])
    rows.append(
        [
            "hand-written, parsed by the grammar",
            *(sum(map(_is_parsed_hand_written, es)) for es in by_appearance.values()),
        ]
    )
    return _table(["statements", *(appearance.capitalize() for appearance in by_appearance)], rows)


def _is_parsed_hand_written(entry: SolvedEntry) -> bool:
    return entry.level == 0 and bool(parse_statement(entry.statement))
