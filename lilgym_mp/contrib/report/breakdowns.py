"""Accuracy by target value, phenomenon, novelty of the statement, and edits needed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from lilgym_mp.contrib.report import paper
from lilgym_mp.contrib.report.aggregation import INTERVAL_NOTE, MeanStd, accuracy_where
from lilgym_mp.contrib.report.charts import BarPanel, bar_chart
from lilgym_mp.contrib.report.items import Cell, Chart, Item, table
from lilgym_mp.contrib.report.phenomena import PHENOMENA, phenomena, syntactic_phenomena
from lilgym_mp.contrib.report.report_data import ReportData
from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.evaluation.episodes import Episode

Category = Callable[[Episode], str | None]
ERROR_BARS = "Error bars are 95 % intervals, as in Table 2."
TARGETS = ("target true", "target false")
NOVELTY = ("statement seen", "form seen", "new")
MAX_EDITS = 6  # episodes that need this many edits or more are grouped
EDITS = (*map(str, range(MAX_EDITS)), f"{MAX_EDITS} or more")
NEEDS_EXPERT = "this needs the expert: record with `lilgym-mp evaluate ... --record DIR --optimal`"


def _by_category(
    data: ReportData,
    item: str,
    title: str,
    names: Sequence[str],
    category: Category,
    note: str = "",
    *,
    configurations: Sequence[str] | None = None,
    published: Mapping[str, Sequence[int]] | None = None,
) -> Iterator[Item]:
    """A chart and a table of the accuracy by category of the episode; nothing if no episode has one.

    `configurations`: by default all; `published`: the paper's start scenes by configuration, in the order of `names`.
    """
    panels: list[BarPanel] = []
    rows: list[list[Cell]] = []
    for configuration in configurations or data.configurations:
        counts = dict(zip(names, (published or {}).get(configuration, ()), strict=False))
        entries = data.of(configuration)
        by_name: dict[str, list[MeanStd | None]] = {}  # one for each entry
        for name in names:

            def belongs(episode: Episode, name: str = name) -> bool:
                return category(episode) == name

            accuracies = [accuracy_where(entry.runs, belongs) for entry in entries]
            if any(accuracies):
                by_name[name] = accuracies
                for entry, accuracy in zip(entries, accuracies, strict=True):
                    scenes = entry.start_scenes(belongs), counts.get(name)
                    rows.append([entry.agent, configuration, name, *scenes, accuracy])
        by_entry = zip(entries, zip(*by_name.values(), strict=True), strict=False)
        values = {entry.agent: accuracies for entry, accuracies in by_entry if any(accuracies)}
        if values:
            panels.append(BarPanel(configuration, list(by_name), values))
    if panels:
        yield Chart(
            item, title, bar_chart(panels, "accuracy, %", data.looks, top=109), note=f"{note} {ERROR_BARS}".strip()
        )
        columns = ("agent", "configuration", "episodes", "start scenes", "start scenes †", "accuracy (%)")
        source = f"† dev split of the paper ({paper.SOURCE}). " if published else ""
        yield table(item, f"{title}, numbers", columns, rows, f"{note} {source}{INTERVAL_NOTE}".strip())


def by_target(data: ReportData) -> Iterator[Item]:
    """Figure 5: accuracy by target truth value in the FlipIt configurations."""
    title = f"Accuracy by target value on {data.main_split}"
    configurations = [name for name in data.configurations if CONFIGURATIONS[name][1] == FLIPIT]
    if not configurations:
        yield Item("Figure 5", title, note="no FlipIt configuration was evaluated")
        return

    def target(episode: Episode) -> str:
        return TARGETS[0] if episode.target else TARGETS[1]

    options = {"configurations": configurations, "published": paper.START_SCENES_BY_TARGET}
    yield from _by_category(data, "Figure 5", title, TARGETS, target, **options)


def by_phenomenon(data: ReportData) -> Iterator[Item]:
    """Accuracy on the statements with each phenomenon, one table per configuration."""
    note = (
        "Tags are derived by rules from the program, or from the words of the statement for the two rows of syntax; a"
        " statement may have several."
        f" † start scenes of the dev statements that the paper's authors tagged by hand ({paper.SOURCE})."
    )
    for configuration in data.configurations:
        entries = data.of(configuration)
        rows: list[list[Cell]] = []
        for name in PHENOMENA:

            def shows(episode: Episode, name: str = name) -> bool:
                return name in phenomena(episode.program) or name in syntactic_phenomena(episode.statement)

            counts: dict[str, int] = dict(zip(paper.PLAYED, paper.START_SCENES_BY_PHENOMENON[name], strict=True))
            statements = {episode.statement for episode in entries[0].runs[0].episodes if shows(episode)}
            scenes = len(statements), entries[0].start_scenes(shows), counts.get(configuration)
            rows.append([name, *scenes, *(accuracy_where(entry.runs, shows) for entry in entries)])
        title = f"Accuracy (%) by phenomenon, {configuration} {data.main_split}, rule-made tags"
        columns = ("phenomenon", "statements", "start scenes", "start scenes †", *(entry.agent for entry in entries))
        yield table("Table 3, Table 5 and Table 6", title, columns, rows, note)


def by_novelty(data: ReportData) -> Iterator[Item]:
    """Accuracy on statements seen in training, on unseen ones of a seen form, and on those of a new form."""

    def novelty(episode: Episode) -> str:
        return NOVELTY[0] if episode.statement_seen else NOVELTY[1] if episode.form_seen else NOVELTY[2]

    title = f"Accuracy by novelty of the statement on {data.main_split}"
    note = (
        "Statement seen: occurs verbatim in training. Form seen: occurs with other colours, shapes, sizes or numbers."
    )
    yield from _by_category(data, "Seen and new", title, NOVELTY, novelty, note)


def by_edits(data: ReportData) -> Iterator[Item]:
    """Accuracy by the number of edits in the expert's solution."""

    def edits(episode: Episode) -> str | None:
        return None if episode.edits is None else EDITS[min(episode.edits, MAX_EDITS)]

    title = f"Accuracy by number of edits needed on {data.main_split}"
    note = "Edits in the expert's shortest solution."
    found = [*_by_category(data, "Edits needed", title, EDITS, edits, note)]
    yield from found or [Item("Edits needed", title, note=NEEDS_EXPERT)]
