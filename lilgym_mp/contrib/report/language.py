"""Accuracy by linguistic phenomenon, and by whether the statement or its form occurs in the training data."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from lilgym_mp.contrib.report import paper
from lilgym_mp.contrib.report.aggregation import accuracy_where
from lilgym_mp.contrib.report.charts import bar_chart
from lilgym_mp.contrib.report.items import Cell, Chart, Item, table
from lilgym_mp.contrib.report.phenomena import PHENOMENA, phenomena, syntactic_phenomena
from lilgym_mp.contrib.report.report_data import ReportData, ReportError
from lilgym_mp.contrib.report.results import accuracy_panels
from lilgym_mp.evaluation.episodes import RecordedEpisode

Tags = Mapping[str, Sequence[str]]  # hand-made tags: phenomena by statement
PHENOMENON_NAMES = tuple(phenomenon.value for phenomenon in PHENOMENA)
ITEM = "Table 3, Table 5 and Table 6"
RULE_MADE = "derived by rules from the program, or from the words of the statement for the two rows of syntax"
NOVELTY = ("statement seen", "form seen", "new")


def language_items(data: ReportData, tags: Tags | None) -> Iterator[Item]:
    yield from accuracy_by_phenomenon(data, tags)
    yield from accuracy_by_novelty(data)


def read_tags(path: Path) -> Tags:
    """Hand-made tags: a JSON object of statements, each with a list of phenomena. Raises ReportError."""
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as fault:
        raise ReportError(f"{path}: cannot be read: {fault.strerror or fault}") from None
    except ValueError as fault:
        raise ReportError(f"{path}: not JSON: {fault}") from None
    if not isinstance(data, dict):
        raise ReportError(f"{path}: must be an object that maps each statement to a list of phenomena")
    for statement, names in data.items():
        if not isinstance(names, list):
            raise ReportError(f"{path}: key {statement!r} must have a list of phenomena, not {names!r}")
        for name in names:
            if name not in PHENOMENON_NAMES:
                unknown = f"key {statement!r} has the unknown phenomenon {name!r}"
                raise ReportError(f"{path}: {unknown}; choose from {', '.join(PHENOMENON_NAMES)}")
    return data


def episode_phenomena(episode: RecordedEpisode, tags: Tags | None) -> Sequence[str] | None:
    """The phenomena of the episode's statement: from the hand-made tags (None if untagged), else derived by rules."""
    if tags is not None:
        return tags.get(episode.statement)
    return *phenomena(episode.program), *syntactic_phenomena(episode.statement)


def accuracy_by_phenomenon(data: ReportData, tags: Tags | None) -> Iterator[Item]:
    """Accuracy on the statements with each phenomenon, one table per configuration."""
    made = "rule-made tags" if tags is None else "hand-made tags"
    note = (
        f"Tags are {RULE_MADE if tags is None else 'from the file of hand-made tags'}; a statement may have several."
        f" † start scenes of the dev statements that the paper's authors tagged by hand ({paper.SOURCE})."
    )
    for configuration in data.configurations:
        entries = data.of(configuration)
        rows: list[list[Cell]] = []
        for name in PHENOMENON_NAMES:
            counts: dict[str, int] = dict(zip(paper.PLAYED, paper.START_SCENES_BY_PHENOMENON[name], strict=True))
            published = counts.get(configuration)

            def has_phenomenon(episode: RecordedEpisode, name: str = name) -> bool:
                return name in (episode_phenomena(episode, tags) or ())

            statements = {episode.statement for episode in entries[0].runs[0].episodes if has_phenomenon(episode)}
            scenes = len(statements), entries[0].start_scenes(has_phenomenon), published
            rows.append([name, *scenes, *(accuracy_where(entry.runs, has_phenomenon) for entry in entries)])
        columns = ("phenomenon", "statements", "start scenes", "start scenes †", *(entry.agent for entry in entries))
        yield table(ITEM, f"Accuracy (%) by phenomenon, {configuration} {data.main_split}, {made}", columns, rows, note)


def novelty(episode: RecordedEpisode) -> str:
    """Whether the statement, only its form, or neither occurs in the training data."""
    return NOVELTY[0] if episode.statement_seen else NOVELTY[1] if episode.form_seen else NOVELTY[2]


def accuracy_by_novelty(data: ReportData) -> Iterator[Item]:
    """Accuracy on statements seen in training, on unseen ones of a seen form, and on those of a new form."""
    title = f"Accuracy by novelty of the statement on {data.main_split}"
    panels = accuracy_panels(data, NOVELTY, novelty)
    rows: list[list[Cell]] = []
    for panel in panels:
        for entry in data.of(panel.title):
            starts = [entry.start_scenes(lambda episode, name=name: novelty(episode) == name) for name in NOVELTY]
            pairs = zip(starts, panel.values[entry.agent], strict=True)
            rows.append([entry.agent, panel.title, *(cell for pair in pairs for cell in pair)])
    note = (
        "Statement seen: occurs verbatim in training. Form seen: occurs with other colours, shapes, sizes or numbers."
    )
    yield Chart("Seen and new", title, bar_chart(panels, "accuracy, %", data.looks, top=109), note)
    pairs = [f"{head}{name}" for name in NOVELTY for head in ("start scenes, ", "accuracy (%), ")]
    columns = ("agent", "configuration", *pairs)
    yield table("Seen and new", f"{title}, numbers", columns, rows, note)
