"""Accuracy, also by target value, phenomenon, novelty and edits; mean reward and paired tests; their recordings."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations, product

from lilgym_mp.contrib.report import paper
from lilgym_mp.contrib.report.aggregation import (
    INTERVAL_NOTE,
    MeanStd,
    Value,
    accuracy_where,
    holm,
    mean_where,
    paired_difference,
)
from lilgym_mp.contrib.report.charts import BarPanel, bar_chart
from lilgym_mp.contrib.report.games import is_of_run, success
from lilgym_mp.contrib.report.items import PUBLISHED, Cell, Chart, Item, table
from lilgym_mp.contrib.report.phenomena import PHENOMENA, shows_phenomenon
from lilgym_mp.contrib.report.report_data import AgentResults, ReportData
from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.evaluation.episodes import Episode, outcome_words
from lilgym_mp.evaluation.results import rounded
from lilgym_mp.scene.grouping import grouped

Category = Callable[[Episode], str | None]
ERROR_BARS = "Error bars are 95 % intervals, as in Table 2."
TARGETS = ("target true", "target false")
NOVELTY = ("statement seen", "form seen", "new")
MAX_EDITS = 6  # episodes that need this many edits or more are grouped
EDITS = (*map(str, range(MAX_EDITS)), f"{MAX_EDITS} or more")
NEEDS_EXPERT = "this needs the expert: record with `lilgym-mp evaluate ... --record DIR --optimal`"
BASIS = "Runs behind the numbers"
PAPER_NOTE = (
    f"n: start scenes. ± is the sample standard deviation over training runs. Brackets: {INTERVAL_NOTE} Supervision is"
    f" shortened; {BASIS!r} has all of it. Rows marked {PUBLISHED} are from the paper ({paper.SOURCE}), on the official"
    " corpus: no mask."
)
ELSEWHERE = "‡"  # ends the name of an agent without recordings
ELSEWHERE_NOTE = f" Rows marked {ELSEWHERE} have no recordings: they are games of a run's two agents."
ENDINGS = {
    "wrong_stop": "end with a wrong STOP",
    "invalid_action": "end with an invalid action",
    "horizon": "run out of steps",
}  # of episodes, in sentences


def summary(data: ReportData) -> list[str]:
    """Three sentences: which trained agent solves most, what comes second, and how the first fails."""
    trained = data.trained or set(data.agents)
    ranks = sorted(trained, key=lambda agent: -_mean_accuracy(data, agent))
    best = ranks[0]
    parts = [
        f"{_percent(entry)} of {entry.configuration} (n = {entry.header.start_scenes:,})"
        for entry in data.of_agent(best)
    ]
    sentences = [f"{best} solves {', '.join(parts)} on {data.main_split}."]
    if len(ranks) > 1:
        others = (f"{_percent(entry)} of {entry.configuration}" for entry in data.of_agent(ranks[1]))
        sentences.append(f"The second of {len(ranks)} trained agents, {ranks[1]}, solves {', '.join(others)}.")
    else:
        sentences.append("No other trained agent was recorded.")
    episodes = [episode for entry in data.of_agent(best) for run in entry.runs for episode in run.episodes]
    failed = Counter(episode.outcome for episode in episodes if not episode.is_success)
    if failed:
        outcome, count = failed.most_common(1)[0]
        ending = ENDINGS.get(outcome, f"end as “{outcome_words(outcome)}”")
        sentences.append(f"Of the episodes that {best} fails, {100 * count / failed.total():.0f} % {ending}.")
    else:
        sentences.append(f"{best} solves every episode.")
    return sentences


def _mean_accuracy(data: ReportData, agent: str) -> float:
    means = [found.mean for entry in data.of_agent(agent) if (found := accuracy_where(entry.runs)) is not None]
    return sum(means) / len(means) if means else 0.0


def _percent(entry: AgentResults) -> str:
    found = accuracy_where(entry.runs)
    return "–" if found is None else f"{rounded(found.mean, 1)} %"


def table_2(data: ReportData) -> Iterator[Item]:
    """Task-completion accuracy with its interval, next to the paper's."""
    starts = {(entry.configuration, entry.split): entry.header.start_scenes for entry in data.entries}
    played = [place for place in product(CONFIGURATIONS, data.splits) if place in starts]
    rows: list[list[Cell]] = []
    for agent in data.agents:
        found = [data.find(agent, *place) for place in played]
        headers = [entry.header for entry in found if entry is not None]
        supervision = dict.fromkeys(re.split(r" ?[(;:]", header.supervision)[0] for header in headers)
        actions = dict.fromkeys(f"{header.actions}{', masked' if header.mask else ''}" for header in headers)
        runs = max(len(entry.runs) for entry in found if entry is not None)
        accuracies = [entry and accuracy_where(entry.runs) for entry in found]
        rows.append([agent, "; ".join(supervision), "; ".join(actions), runs, *accuracies])
    games = [game for game in data.games if is_of_run(game) and game["corpus"] == str(data.header.settings.corpus)]
    for (agent, actions), those in grouped(((game["proposer"], game["actions"]), game) for game in games).items():
        own = {(game["configuration"], game["split"]): success(game) for game in those}
        rows.append([f"{agent} {ELSEWHERE}", "rewards of the game", actions, 1, *map(own.get, played)])
    for model, published in paper.ACCURACIES.items():
        accuracies = [published.get(place) for place in played]
        runs = max((cell.runs for cell in accuracies if cell is not None), default=None)
        rows.append([f"{model} {PUBLISHED}", "rewards alone", "sampled", runs, *accuracies])
    heads = (f"{name} {split}, n = {starts[name, split]:,}" for name, split in played)
    columns = ("agent", "supervision", "actions", "runs", *heads)
    note = PAPER_NOTE + (ELSEWHERE_NOTE if games else "")
    yield table("Table 2 and Table 4", "Task-completion accuracy (%)", columns, rows, note)


def figure_3(data: ReportData) -> Iterator[Item]:
    """Mean reward of all agents on the main split."""
    rewards = means_by_agent(data, lambda episode: episode.reward)
    title = f"Mean reward on {data.main_split}"
    note = f"The paper plots these values without printing them. The optimal expert is the upper bound. {ERROR_BARS}"
    chart = bar_chart([BarPanel("", data.configurations, rewards)], "mean reward", data.looks)
    yield Chart("Figure 3", title, chart, note=note)
    rows = [[agent, *values] for agent, values in rewards.items()]
    yield table("Figure 3", f"{title}, numbers", ("agent", *data.configurations), rows)


def means_by_agent(data: ReportData, value: Value) -> dict[str, list[MeanStd | None]]:
    """The mean of a value of the episodes in each configuration, by agent."""
    found = {agent: [data.find(agent, name) for name in data.configurations] for agent in data.agents}
    return {agent: [entry and mean_where(entry.runs, value) for entry in row] for agent, row in found.items()}


def basis(data: ReportData) -> Iterator[Item]:
    """Runs, seeds, episodes and training of every row of the report."""
    note = (
        "Episodes: one per start scene and pass of each run."
        " Tasks: the first digits of the SHA-256 of the file that they come from."
    )
    if any(entry.commits for entry in data.results):
        note += " Commit: of the code that played."
    columns = (
        "agent",
        "configuration",
        "split",
        "runs",
        "training seeds",
        "evaluation seeds",
        "start scenes",
        "contexts",
        "episodes",
        "actions",
        "mask",
        "steps",
        "CPU minutes",
        "supervision",
        "tasks",
        "commit",
    )
    yield table("Basis", BASIS, columns, map(_basis_row, data.results), note)


def _basis_row(entry: AgentResults) -> list[Cell]:
    header = entry.header
    headers = [run.header for run in entry.runs]

    def mean_of(key: str) -> float | None:
        values = [one.training[key] for one in headers if key in one.training]
        return sum(values) / len(headers) if len(values) == len(headers) else None

    steps = mean_of("steps")
    return [
        entry.agent,
        entry.configuration,
        entry.split,
        len(headers),
        ", ".join(str(one.training_seed) for one in headers if one.training_seed is not None) or None,
        ", ".join(map(str, dict.fromkeys(one.seed for one in headers))),
        header.start_scenes,
        header.contexts,
        sum(one.episodes for one in headers),
        header.actions,
        "yes" if header.mask else "no",
        None if steps is None else round(steps),
        mean_of("cpu_minutes"),
        header.supervision,
        header.tasks_sha256[:10],
        ", ".join(entry.commits) or None,
    ]


def paired_tests(data: ReportData) -> Iterator[Item]:
    """Differences in accuracy between any two agents, with p-values."""
    pairs = [
        (entry, other, difference)
        for place in product(data.configurations, data.splits)
        for entry, other in combinations(data.of(*place), 2)
        if (difference := paired_difference(entry.runs, other.runs)) is not None
    ]
    if not pairs:
        return
    corrected = holm([difference.p_value for *_, difference in pairs])
    rows: list[list[Cell]] = []
    for (entry, other, difference), p_value in zip(pairs, corrected, strict=True):
        p_text = f"{p_value:.4f}" if p_value >= 1e-4 else "< 0.0001"
        rows.append([entry.agent, other.agent, entry.configuration, entry.split, *difference[:3], p_text])
    columns = ("agent", "other agent", "configuration", "split", "difference (points)", "from", "to", "p")
    note = (
        f"{INTERVAL_NOTE} Both agents have the same resampled statements. p is two-sided, from the standard deviation"
        f" of the resamples, and corrected for the {len(pairs)} tests of this table (Holm)."
    )
    yield table("Paired tests", "Differences in accuracy between agents", columns, rows, note)


# Accuracy by category


def _by_category(
    data: ReportData,
    item: str,
    title: str,
    names: Sequence[str],
    category: Category,
    note: str = "",
    configurations: Sequence[str] | None = None,
) -> Iterator[Item]:
    """A chart and a table of the accuracy by category of the episode; nothing if no episode has one.

    `configurations`: by default all.
    """
    panels: list[BarPanel] = []
    rows: list[list[Cell]] = []
    for configuration in configurations or data.configurations:
        entries = data.of(configuration)
        by_name: dict[str, list[MeanStd | None]] = {}  # one for each entry
        for name in names:

            def belongs(episode: Episode, name: str = name) -> bool:
                return category(episode) == name

            accuracies = [accuracy_where(entry.runs, belongs) for entry in entries]
            if any(accuracies):
                by_name[name] = accuracies
                for entry, accuracy in zip(entries, accuracies, strict=True):
                    rows.append([entry.agent, configuration, name, entry.start_scenes(belongs), accuracy])
        by_entry = zip(entries, zip(*by_name.values(), strict=True), strict=False)
        values = {entry.agent: accuracies for entry, accuracies in by_entry if any(accuracies)}
        if values:
            panels.append(BarPanel(configuration, list(by_name), values))
    if panels:
        yield Chart(
            item, title, bar_chart(panels, "accuracy, %", data.looks, top=109), note=f"{note} {ERROR_BARS}".strip()
        )
        columns = ("agent", "configuration", "episodes", "start scenes", "accuracy (%)")
        yield table(item, f"{title}, numbers", columns, rows, f"{note} {INTERVAL_NOTE}".strip())


def by_target(data: ReportData) -> Iterator[Item]:
    """Figure 5: accuracy by target truth value in the FlipIt configurations."""
    title = f"Accuracy by target value on {data.main_split}"
    configurations = [name for name in data.configurations if CONFIGURATIONS[name][1] == FLIPIT]
    if not configurations:
        yield Item("Figure 5", title, note="no FlipIt configuration was evaluated")
        return

    def target(episode: Episode) -> str:
        return TARGETS[0] if episode.target else TARGETS[1]

    yield from _by_category(data, "Figure 5", title, TARGETS, target, configurations=configurations)


def by_phenomenon(data: ReportData) -> Iterator[Item]:
    """Accuracy on the statements with each phenomenon, one table per configuration."""
    note = (
        "Tags are derived by rules from the program, or from the words of the statement for the two rows of syntax; a"
        " statement may have several."
    )
    for configuration in data.configurations:
        if not (entries := data.of(configuration)):
            continue
        rows: list[list[Cell]] = []
        for name in PHENOMENA:
            shows = partial(shows_phenomenon, name)
            statements = {episode.statement for episode in entries[0].runs[0].episodes if shows(episode)}
            scenes = len(statements), entries[0].start_scenes(shows)
            rows.append([name, *scenes, *(accuracy_where(entry.runs, shows) for entry in entries)])
        title = f"Accuracy (%) by phenomenon, {configuration} {data.main_split}, rule-made tags"
        columns = ("phenomenon", "statements", "start scenes", *(entry.agent for entry in entries))
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
