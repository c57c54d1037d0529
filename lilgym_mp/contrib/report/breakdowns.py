"""Accuracy by target value, phenomenon, novelty of the statement, and edits needed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from lilgym_mp.contrib.report import paper
from lilgym_mp.contrib.report.aggregation import INTERVAL_NOTE, MeanStd, accuracy_where
from lilgym_mp.contrib.report.charts import BarPanel, bar_chart
from lilgym_mp.contrib.report.items import Cell, Chart, Item, MissingItem, table
from lilgym_mp.contrib.report.phenomena import PHENOMENA, phenomena, syntactic_phenomena
from lilgym_mp.contrib.report.report_data import ReportData
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.evaluation.episodes import Episode, Recording

Category = Callable[[Episode], str | None]
ERROR_BARS = "Error bars are 95 % intervals, as in Table 2."
NOVELTY = ("statement seen", "form seen", "new")
MAX_EDITS = 6  # episodes that need this many edits or more are grouped
NEEDS_EXPERT = "this needs the expert: record with `lilgym-mp evaluate ... --record DIR --optimal`"


def accuracy_panels(
    data: ReportData, names: Sequence[str], category: Category, configurations: Sequence[str] | None = None
) -> list[BarPanel]:
    """The accuracy of each agent by category of the episode, one panel per configuration."""

    def accuracies(runs: Sequence[Recording]) -> list[MeanStd | float | None]:
        return [accuracy_where(runs, lambda episode, name=name: category(episode) == name) for name in names]

    return [
        BarPanel(configuration, names, {entry.agent: accuracies(entry.runs) for entry in data.of(configuration)})
        for configuration in configurations or data.configurations
    ]


def _used_panels(data: ReportData, names: Sequence[str], category: Category) -> list[BarPanel]:
    """The same without categories that no episode has and agents without an episode in any."""
    panels: list[BarPanel] = []
    for title, _, values, _ in accuracy_panels(data, names, category):
        kept = {agent: row for agent, row in values.items() if any(value is not None for value in row)}
        used = [index for index in range(len(names)) if any(row[index] is not None for row in kept.values())]
        if used:
            rows = {agent: [row[index] for index in used] for agent, row in kept.items()}
            panels.append(BarPanel(title, [names[index] for index in used], rows))
    return panels


def by_target(data: ReportData) -> Iterator[Item]:
    """Figure 5: accuracy by target truth value in the FlipIt configurations."""
    title = f"Accuracy by target value on {data.main_split}"
    configurations = [name for name in data.configurations if CONFIGURATIONS[name][1] == "flipit"]
    if not configurations:
        yield MissingItem("Figure 5", title, "no FlipIt configuration was evaluated")
        return
    names = ("target true", "target false")
    panels = accuracy_panels(data, names, lambda episode: f"target {episode.target}".lower(), configurations)
    rows: list[list[Cell]] = []
    for panel in panels:
        scenes = paper.START_SCENES_BY_TARGET.get(panel.title, (None, None))
        for entry in data.of(panel.title):
            for target, published, accuracy in zip((True, False), scenes, panel.values[entry.agent], strict=True):
                starts = entry.start_scenes(lambda episode, target=target: episode.target == target)
                rows.append([entry.agent, panel.title, str(target).lower(), starts, published, accuracy])
    yield Chart("Figure 5", title, bar_chart(panels, "accuracy, %", data.looks, top=109), ERROR_BARS)
    columns = ("agent", "configuration", "target", "start scenes", "start scenes †", "accuracy (%)")
    note = f"† dev split of the paper ({paper.SOURCE}). {INTERVAL_NOTE}"
    yield table("Figure 5", f"{title}, numbers", columns, rows, note)


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


def novelty(episode: Episode) -> str:
    """Whether the statement, only its form, or neither occurs in the training data."""
    return NOVELTY[0] if episode.statement_seen else NOVELTY[1] if episode.form_seen else NOVELTY[2]


def by_novelty(data: ReportData) -> Iterator[Item]:
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


def edits_category(episode: Episode) -> str | None:
    """The number of edits of a shortest solution; None if unknown."""
    if episode.edits is None:
        return None
    return str(episode.edits) if episode.edits < MAX_EDITS else f"{MAX_EDITS} or more"


def by_edits(data: ReportData) -> Iterator[Item]:
    """Accuracy by the number of edits in the expert's solution."""
    title = f"Accuracy by number of edits needed on {data.main_split}"
    panels = _used_panels(data, [*map(str, range(MAX_EDITS)), f"{MAX_EDITS} or more"], edits_category)
    if panels:
        chart = bar_chart(panels, "accuracy, %", data.looks, top=109)
        yield Chart("Edits needed", title, chart, "Edits in the expert's shortest solution.")
    else:
        yield MissingItem("Edits needed", title, NEEDS_EXPERT)
