"""Accuracy by phenomenon, and by whether the statement or its form occurs in training."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from lilgym_mp.analysis.phenomena import PHENOMENA, syntactic_phenomena
from lilgym_mp.evaluation.episodes import RecordedEpisode, Recording
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.report import paper
from lilgym_mp.report.aggregation import Spread, accuracy, over_runs
from lilgym_mp.report.charts import Panel, bars
from lilgym_mp.report.items import Cell, Chart, Item, Lacking, table
from lilgym_mp.report.report_data import Gathered, ReportError

Tags = Mapping[str, Sequence[str]]  # phenomena by statement, from hand-made tags
CHOICES = tuple(phenomenon.value for phenomenon in PHENOMENA)
# The paper's tables of phenomena, by configuration.
ITEM = "Table 3, Table 5 and Table 6"
RULE_MADE = "derived by rules from the program, or from the words of the statement for the two rows of syntax"
SEEN = ("statement seen", "form seen", "new")


def language(found: Gathered, tags: Tags | None) -> Iterator[Item]:
    yield from by_phenomenon(found, tags)
    yield from by_novelty(found)


def read_tags(path: Path) -> Tags:
    """Hand-made tags: a JSON object of statements, each with a list of phenomena. Raises ReportError."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as fault:
        raise ReportError(f"{path}: cannot be read: {fault.strerror or fault}") from None
    except ValueError as fault:
        raise ReportError(f"{path}: not JSON: {fault}") from None
    if not isinstance(data, dict):
        raise ReportError(f"{path}: must be an object with a list of phenomena for each statement")
    for statement, names in data.items():
        if not isinstance(names, list):
            raise ReportError(f"{path}: key {statement!r} must have a list of phenomena, not {names!r}")
        for name in names:
            if name not in CHOICES:
                raise ReportError(
                    f"{path}: key {statement!r} holds the unknown phenomenon {name!r}; choose from {', '.join(CHOICES)}"
                )
    return data


def tagged(episode: RecordedEpisode, tags: Tags | None) -> Sequence[str] | None:
    """The phenomena of the statement, from rules or hand-made tags; None if it has no hand-made tags."""
    if tags is not None:
        return tags.get(episode.statement)
    return *episode.phenomena, *(found.value for found in syntactic_phenomena(episode.statement))


def by_phenomenon(found: Gathered, tags: Tags | None) -> Iterator[Item]:
    """Accuracy on the statements with each phenomenon, one table per configuration."""
    made = "rule-made tags" if tags is None else "hand-made tags"
    note = (
        f"Tags are {RULE_MADE if tags is None else 'from the file of hand-made tags'}; a statement may have several."
        f" † start scenes of the dev statements that the paper's authors tagged by hand ({paper.SOURCE})."
    )
    for configuration in found.configurations:
        entries = found.of(configuration)
        first = entries[0].runs[0].episodes
        rows: list[list[Cell]] = []
        for name in CHOICES:
            published = paper.START_SCENES_BY_PHENOMENON[name][list(CONFIGURATIONS).index(configuration)]
            chosen = [episode for episode in first if name in (tagged(episode, tags) or ())]
            rows.append(
                [
                    name,
                    len({episode.statement for episode in chosen}),
                    len(chosen) // entries[0].header.passes,
                    published,
                    *(_accuracy_of(entry.runs, name, tags) for entry in entries),
                ]
            )
        columns = ("phenomenon", "statements", "start scenes", "start scenes †", *(entry.agent for entry in entries))
        yield table(
            ITEM, f"Accuracy (%) by phenomenon, {configuration} {found.main_split}, {made}", columns, rows, note
        )


def _accuracy_of(runs: Sequence[Recording], name: str, tags: Tags | None) -> Spread | None:
    return over_runs(
        runs, lambda kept: accuracy([episode for episode in kept if name in (tagged(episode, tags) or ())])
    )


def novelty(episode: RecordedEpisode) -> str:
    """Whether the statement, only its form, or neither occurs in training."""
    return SEEN[0] if episode.statement_seen else SEEN[1] if episode.form_seen else SEEN[2]


def by_novelty(found: Gathered) -> Iterator[Item]:
    """Accuracy on statements seen in training, on new statements of a seen form, and on those of a new form."""
    title = f"Accuracy by statement seen, form seen, new, on {found.main_split}"
    rows: list[list[Cell]] = []
    panels: list[Panel] = []
    for configuration in found.configurations:
        values: dict[str, list[Spread | float | None]] = {}
        for entry in found.of(configuration):
            first = entry.runs[0].episodes
            values[entry.agent] = [
                over_runs(entry.runs, lambda kept, name=name: accuracy([e for e in kept if novelty(e) == name]))
                for name in SEEN
            ]
            starts = [sum(novelty(e) == name for e in first) // entry.header.passes for name in SEEN]
            pairs = zip(starts, values[entry.agent], strict=True)
            rows.append([entry.agent, configuration, *(cell for pair in pairs for cell in pair)])
        panels.append(Panel(configuration, SEEN, values))
    if not panels:
        yield Lacking("Seen and new", title, "no configuration was evaluated")
        return
    note = (
        "Statement seen: occurs verbatim in training. Form seen: occurs with other colours, shapes, sizes or numbers."
    )
    yield Chart("Seen and new", title, bars(panels, "accuracy, %", top=109), note)
    columns = (
        "agent",
        "configuration",
        *(f"{head}{name}" for name in SEEN for head in ("start scenes, ", "accuracy (%), ")),
    )
    yield table("Seen and new", f"{title}, numbers", columns, rows, note)
