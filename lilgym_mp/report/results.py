"""Main results: accuracy, mean reward, accuracy by target; the recordings they are based on; corpus sizes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lilgym_mp.analysis.statistics import corpus_statistics
from lilgym_mp.corpus import CorpusError
from lilgym_mp.evaluation.episodes import RecordedEpisode
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.report import paper
from lilgym_mp.report.aggregation import MeanStd, accuracy, accuracy_where, aggregate_runs, average
from lilgym_mp.report.charts import BarPanel, bar_chart
from lilgym_mp.report.items import MISSING, Cell, Chart, Item, MissingItem, table
from lilgym_mp.report.report_data import AgentResults, ReportData

PAPER_NOTE = (
    f"Rows marked † are from the paper ({paper.SOURCE}), on the official corpus: trained from rewards alone, sampled"
    " actions, no mask. ± is the sample standard deviation over training runs."
)
PROVENANCE_TITLE = "Provenance of the recordings"


def results_items(data: ReportData) -> Iterator[Item]:
    yield table_2(data)
    yield from figure_3(data)
    yield from figure_5(data)
    yield basis(data)
    yield provenance(data)
    yield table_1(data)


def basis(data: ReportData) -> Item:
    """Runs, seeds, episodes and training of every row of the report."""
    rows: list[list[Cell]] = []
    for configuration in data.configurations:
        for split in data.splits:
            for agent in data.agents:
                entry = data.find(agent, configuration, split)
                if entry is not None:
                    rows.append(_basis_row(entry))
    note = (
        "Accuracy is the share of successful episodes, with one episode per start scene and pass. Rows of one learner"
        " may differ in their seeds."
    )
    columns = (
        *("agent", "configuration", "split", "runs", "training seeds", "evaluation seeds", "start scenes", "contexts"),
        *("episodes", "actions", "mask", "steps", "CPU minutes", "supervision"),
    )
    return table("Basis", "Runs behind the numbers", columns, rows, note)


def provenance(data: ReportData) -> Item:
    """When, where and with which commands and code the episodes were recorded."""
    if not data.metadata:
        return MissingItem(
            "Basis",
            PROVENANCE_TITLE,
            "the recordings come without metadata, which `lilgym-mp evaluate --record` writes",
        )
    rows: list[list[Cell]] = []
    for command in dict.fromkeys(made.command for made in data.metadata):
        made = sorted((one for one in data.metadata if one.command == command), key=lambda one: one.date)
        dates, commits, machines = (
            ", ".join(dict.fromkeys(str(getattr(one, name) or MISSING) for one in made))
            for name in ("date", "commit", "machine")
        )
        rows.append([command, dates, commits, machines, len(made)])
    note = "Dates are UTC. Commits are those of the checkout, 'with changes' if files differed from it."
    return table("Basis", PROVENANCE_TITLE, ("command", "date", "commit", "machine", "recordings"), rows, note)


def _basis_row(entry: AgentResults) -> list[Cell]:
    headers = [run.header for run in entry.runs]
    header = headers[0]
    seeds = [str(one.training_seed) for one in headers if one.training_seed is not None]
    totals = {
        key: sum(one.training[key] for one in headers) / len(headers)
        for key in ("steps", "cpu_minutes")
        if all(key in one.training for one in headers)
    }
    return [
        *(entry.agent, entry.configuration, entry.split, len(headers), ", ".join(seeds) or None),
        ", ".join(dict.fromkeys(str(one.seed) for one in headers)),
        *(header.start_scenes, header.contexts, sum(one.episodes for one in headers), header.actions),
        "yes" if header.mask else "no",
        round(totals["steps"]) if "steps" in totals else None,
        totals.get("cpu_minutes"),
        header.supervision,
    ]


def table_1(data: ReportData) -> Item:
    """Number of contexts (MDPs) and start scenes of the corpus, by configuration and split."""
    title = "Start scenes and contexts (MDPs) by split"
    corpus = data.header.settings.corpus
    try:
        counts = corpus_statistics(corpus).counts
    except CorpusError as fault:
        return MissingItem("Table 1", title, f"the corpus {corpus!r} is not available: {fault}")
    names = {pair: name for name, pair in CONFIGURATIONS.items()}
    rows = [
        (
            *(names[count.appearance, count.start], count.split, count.contexts, count.tasks),
            *((None, None) if count.paper is None else (count.paper.contexts, count.paper.tasks)),
        )
        for count in counts
    ]
    columns = ("configuration", "split", "contexts", "start scenes", "contexts †", "start scenes †")
    return table(
        "Table 1", title, columns, rows, f"Corpus: {data.header.corpus}. † from the paper, for the official corpus."
    )


def table_2(data: ReportData) -> Item:
    """Task-completion accuracy next to the paper's."""
    columns = [f"{name} {split}" for name in CONFIGURATIONS for split in ("dev", "test")]
    published = [(name, split) for name in CONFIGURATIONS for split in ("dev", "test")]
    extra = [(name, split) for name in data.configurations for split in data.splits if split not in ("dev", "test")]
    rows: list[list[Cell]] = []
    for agent in data.agents:
        entries = [data.find(agent, name, split) for name, split in (*published, *extra)]
        rows.append([agent, *(entry and aggregate_runs(entry.runs, accuracy) for entry in entries)])
    for model, cells in paper.ACCURACIES.items():
        accuracies: list[Cell] = [getattr(cells.get(name), split, None) for name, split in published]
        rows.append([f"{model} †", *accuracies, *([None] * len(extra))])
    heads = ("agent", *columns, *(f"{name} {split}" for name, split in extra))
    return table("Table 2 and Table 4", "Task-completion accuracy (%)", heads, rows, PAPER_NOTE)


def figure_3(data: ReportData) -> Iterator[Item]:
    """Mean reward of all agents on the main split."""
    panels: list[BarPanel] = []
    rows: list[list[Cell]] = []
    for configuration in data.configurations:
        entries = data.of(configuration)
        rewards = [aggregate_runs(entry.runs, mean_reward) for entry in entries]
        values: dict[str, list[MeanStd | float | None]] = {
            entry.agent: [reward] for entry, reward in zip(entries, rewards, strict=True)
        }
        panels.append(BarPanel(configuration, [""], values))
        rows += [[entry.agent, configuration, reward] for entry, reward in zip(entries, rewards, strict=True)]
    title = f"Mean reward on {data.main_split}"
    note = "The paper plots these values without printing them. The optimal expert is the upper bound."
    yield Chart("Figure 3", title, bar_chart(panels, "mean reward"), note)
    yield table("Figure 3", f"{title}, numbers", ("agent", "configuration", "mean reward"), rows)


def mean_reward(episodes: Sequence[RecordedEpisode]) -> float | None:
    return average(episodes, lambda episode: episode.reward)


def figure_5(data: ReportData) -> Iterator[Item]:
    """Accuracy by target truth value in the FlipIt configurations."""
    title = f"Accuracy by target value on {data.main_split}"
    configurations = [name for name in data.configurations if CONFIGURATIONS[name][1] == "flipit"]
    if not configurations:
        yield MissingItem("Figure 5", title, "no FlipIt configuration was evaluated")
        return
    panels: list[BarPanel] = []
    rows: list[list[Cell]] = []
    for configuration in configurations:
        values: dict[str, list[MeanStd | float | None]] = {}
        for entry in data.of(configuration):
            first = entry.runs[0].episodes
            values[entry.agent] = [
                accuracy_where(entry.runs, lambda episode, target=target: episode.target == target)
                for target in (True, False)
            ]
            starts = [sum(e.target == target for e in first) // entry.header.passes for target in (True, False)]
            published = paper.START_SCENES_BY_TARGET.get(configuration, (None, None))
            for index, target in enumerate(("True", "False")):
                cells = (
                    entry.agent,
                    configuration,
                    target,
                    starts[index],
                    published[index],
                    values[entry.agent][index],
                )
                rows.append(list(cells))
        panels.append(BarPanel(configuration, ["target True", "target False"], values))
    yield Chart("Figure 5", title, bar_chart(panels, "accuracy, %", top=109))
    columns = ("agent", "configuration", "target", "start scenes", "start scenes †", "accuracy (%)")
    yield table("Figure 5", f"{title}, numbers", columns, rows, f"† dev split of the paper ({paper.SOURCE}).")
