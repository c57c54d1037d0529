"""Main results: accuracy, mean reward, accuracy by target; the recordings they are based on; corpus sizes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence

from lilgym_mp.contrib.report import paper
from lilgym_mp.contrib.report.aggregation import INTERVAL_NOTE, MeanStd, Value, accuracy_where, mean_where
from lilgym_mp.contrib.report.charts import BarPanel, bar_chart
from lilgym_mp.contrib.report.corpus_statistics import corpus_statistics
from lilgym_mp.contrib.report.items import MISSING, PUBLISHED, Cell, Chart, Item, MissingItem, table
from lilgym_mp.contrib.report.report_data import CHECKSUM_DIGITS, AgentResults, ReportData, format_setting
from lilgym_mp.corpus import CorpusError
from lilgym_mp.evaluation.episodes import RecordedEpisode
from lilgym_mp.evaluation.settings import CONFIGURATIONS

BASIS = "Runs behind the numbers"
PAPER_NOTE = (
    f"n: start scenes. ± is the sample standard deviation over training runs. Brackets: {INTERVAL_NOTE} Supervision is"
    f" shortened; {BASIS!r} has all of it. Rows marked {PUBLISHED} are from the paper ({paper.SOURCE}), on the official"
    " corpus: no mask."
)
ERROR_BARS = "Error bars are 95 % intervals, as in Table 2."
PROVENANCE_TITLE = "Provenance of the recordings"


def results_items(data: ReportData) -> Iterator[Item]:
    yield table_2(data)
    yield from figure_3(data)
    yield from figure_5(data)
    yield basis(data)
    yield training_runs(data)
    yield provenance(data)
    yield table_1(data)


def basis(data: ReportData) -> Item:
    """Runs, seeds, episodes and training of every row of the report."""
    note = (
        "Accuracy is the share of successful episodes, with one episode per start scene, pass and evaluation seed."
        " Tasks: the first digits of the SHA-256 of the file that they come from. Commit: of the code that played."
    )
    columns = (
        *("agent", "configuration", "split", "runs", "training seeds", "evaluation seeds", "start scenes", "contexts"),
        *("episodes", "actions", "mask", "steps", "CPU minutes", "supervision", "tasks", "commit"),
    )
    rows = map(_basis_row, data.results(data.configurations, data.splits))
    return table("Basis", BASIS, columns, rows, note)


def training_runs(data: ReportData) -> Item:
    """What each training run in the directories learnt from, with its whole recipe."""
    title = "Training runs and their recipes"
    if not data.curves:
        return MissingItem("Basis", title, "the directories contain no training run; add one")
    columns = ("run", "learner", "configuration", "trained on", "checksum", "commit", "recipe")
    note = "Checksum: the first digits of the SHA-256 of the training tasks' file. Commit: of the code that trained."
    rows = [
        [
            *(curve.run.name, curve.learner, curve.configuration or "all", curve.corpus, curve.checksum, curve.commit),
            ", ".join(f"{key} {format_setting(value)}" for key, value in curve.recipe.items()),
        ]
        for curve in data.curves
    ]
    return table("Basis", title, columns, rows, note)


def provenance(data: ReportData) -> Item:
    """When, where and with which commands and code the episodes were recorded."""
    if not data.metadata:
        why = "the recordings come without metadata, which `lilgym-mp evaluate --record` writes"
        return MissingItem("Basis", PROVENANCE_TITLE, why)
    rows: list[list[Cell]] = []
    for command in dict.fromkeys(made.command for made in data.metadata):
        made = sorted((one for one in data.metadata if one.command == command), key=lambda one: one.date)
        columns = [[str(getattr(one, name) or MISSING) for one in made] for name in ("date", "commit", "machine")]
        rows.append([command, *(", ".join(dict.fromkeys(column)) for column in columns), len(made)])
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
        ", ".join(map(str, entry.evaluation_seeds)),
        *(header.start_scenes, header.contexts, sum(one.episodes for one in headers), header.actions),
        "yes" if header.mask else "no",
        round(totals["steps"]) if "steps" in totals else None,
        totals.get("cpu_minutes"),
        header.supervision,
        header.tasks_sha256[:CHECKSUM_DIGITS],
        ", ".join(dict.fromkeys(one.commit for one in entry.metadata if one.commit)) or None,
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
    note = f"Corpus: {data.header.corpus}. † from the paper, for the official corpus."
    return table("Table 1", title, columns, rows, note)


def table_2(data: ReportData) -> Item:
    """Task-completion accuracy with its interval, next to the paper's."""
    starts = {(entry.configuration, entry.split): entry.header.start_scenes for entry in data.entries}
    played = [(name, split) for name in CONFIGURATIONS for split in data.splits if (name, split) in starts]
    rows: list[list[Cell]] = []
    for agent in data.agents:
        found = [data.find(agent, *place) for place in played]
        headers = [entry.header for entry in found if entry is not None]
        supervision = "; ".join(dict.fromkeys(re.split(r" ?[(;:]", header.supervision)[0] for header in headers))
        actions = dict.fromkeys(f"{header.actions}{', masked' if header.mask else ''}" for header in headers)
        runs = max(len(entry.runs) for entry in found if entry is not None)
        rows.append(
            [agent, supervision, "; ".join(actions), runs, *(entry and accuracy_where(entry.runs) for entry in found)]
        )
    for model, published in paper.ACCURACIES.items():
        accuracies = [published.get(place) for place in played]
        runs = max((cell.runs for cell in accuracies if cell is not None), default=None)
        rows.append([f"{model} {PUBLISHED}", "rewards alone", "sampled", runs, *accuracies])
    heads = (f"{name} {split}, n = {starts[name, split]:,}" for name, split in played)
    columns = ("agent", "supervision", "actions", "runs", *heads)
    return table("Table 2 and Table 4", "Task-completion accuracy (%)", columns, rows, PAPER_NOTE)


def figure_3(data: ReportData) -> Iterator[Item]:
    """Mean reward of all agents on the main split."""
    rewards = means_by_agent(data, lambda episode: episode.reward)
    title = f"Mean reward on {data.main_split}"
    note = f"The paper plots these values without printing them. The optimal expert is the upper bound. {ERROR_BARS}"
    chart = bar_chart([BarPanel("", data.configurations, rewards)], "mean reward", data.looks)
    yield Chart("Figure 3", title, chart, note)
    rows = [[agent, *values] for agent, values in rewards.items()]
    yield table("Figure 3", f"{title}, numbers", ("agent", *data.configurations), rows)


def figure_5(data: ReportData) -> Iterator[Item]:
    """Accuracy by target truth value in the FlipIt configurations."""
    title = f"Accuracy by target value on {data.main_split}"
    configurations = [name for name in data.configurations if CONFIGURATIONS[name][1] == "flipit"]
    if not configurations:
        yield MissingItem("Figure 5", title, "no FlipIt configuration was evaluated")
        return
    panels = accuracy_panels(
        data, ("target true", "target false"), lambda e: f"target {e.target}".lower(), configurations
    )
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


def accuracy_panels(
    data: ReportData,
    categories: Sequence[str],
    category: Callable[[RecordedEpisode], str | None],
    configurations: Sequence[str] | None = None,
) -> list[BarPanel]:
    """The accuracy of each agent by category of the episode, one panel per configuration."""
    return [
        BarPanel(
            configuration,
            categories,
            {
                entry.agent: [
                    accuracy_where(entry.runs, lambda e, name=name: category(e) == name) for name in categories
                ]
                for entry in data.of(configuration)
            },
        )
        for configuration in configurations or data.configurations
    ]


def means_by_agent(data: ReportData, value: Value) -> dict[str, list[MeanStd | float | None]]:
    """The mean of a value of the episodes in each configuration, by agent."""
    return {
        agent: [
            entry and mean_where(entry.runs, value)
            for entry in (data.find(agent, configuration) for configuration in data.configurations)
        ]
        for agent in data.agents
    }
