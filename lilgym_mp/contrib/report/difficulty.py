"""Analyses beyond the paper: accuracy by difficulty, timing and calibration of STOP, extra actions, comparisons."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, product

from lilgym_mp.contrib.report.aggregation import INTERVAL_NOTE, every, holm, mean_where, paired_difference
from lilgym_mp.contrib.report.behaviour import ends_with_stop
from lilgym_mp.contrib.report.charts import BarPanel, Line, bar_chart, line_chart
from lilgym_mp.contrib.report.items import Cell, Chart, Item, MissingItem, table
from lilgym_mp.contrib.report.report_data import AgentResults, ReportData
from lilgym_mp.contrib.report.results import accuracy_panels
from lilgym_mp.evaluation.episodes import RecordedEpisode
from lilgym_mp.evaluation.runs import scenes
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.programs import compile_program

MAX_EDITS = 6  # episodes that need this many edits or more are grouped
BINS = 10  # bins of the probability of STOP
NEEDS_EXPERT = "this needs the expert: record with `lilgym-mp evaluate ... --record DIR --optimal`"


def difficulty_items(data: ReportData) -> Iterator[Item]:
    yield accuracy_by_edits(data)
    yield stop_accuracy_by_actions_left(data)
    yield calibration(data)
    yield regret(data)


def edits_category(episode: RecordedEpisode) -> str | None:
    """The number of edits of a shortest solution; None if unknown."""
    if episode.edits is None:
        return None
    return str(episode.edits) if episode.edits < MAX_EDITS else f"{MAX_EDITS} or more"


def accuracy_by_edits(data: ReportData) -> Item:
    """Accuracy by the number of edits in the expert's solution."""
    title = f"Accuracy by number of edits needed on {data.main_split}"
    panels = _used_panels(data, [*map(str, range(MAX_EDITS)), f"{MAX_EDITS} or more"], edits_category)
    if not panels:
        return MissingItem("Edits needed", title, NEEDS_EXPERT)
    chart = bar_chart(panels, "accuracy, %", data.looks, top=109)
    return Chart("Edits needed", title, chart, "Edits in the expert's shortest solution.")


def stop_accuracy_by_actions_left(data: ReportData) -> Item:
    """How often STOP is right, by the number of actions left until the horizon."""
    title = f"Accuracy of STOP by actions left on {data.main_split}"
    horizon = data.header.settings.dynamics().horizon

    def left(episode: RecordedEpisode) -> str | None:
        return str(horizon - len(episode.actions)) if ends_with_stop(episode) else None

    note = f"Episodes that end with STOP, by the number of actions left of the horizon of {horizon}."
    panels = _used_panels(data, [*map(str, range(horizon))], left)
    if not panels:
        return MissingItem("Horizon left at STOP", title, "no recorded episode ends with STOP")
    return Chart("Horizon left at STOP", title, bar_chart(panels, "right STOPs, %", data.looks, top=109), note)


def _used_panels(
    data: ReportData, names: Sequence[str], category: Callable[[RecordedEpisode], str | None]
) -> list[BarPanel]:
    """Accuracy by category, without the categories of no episode and the agents without any of them."""
    panels: list[BarPanel] = []
    for title, _, values, _ in accuracy_panels(data, names, category):
        kept = {agent: row for agent, row in values.items() if any(value is not None for value in row)}
        used = [index for index in range(len(names)) if any(row[index] is not None for row in kept.values())]
        if used:
            rows = {agent: [row[index] for index in used] for agent, row in kept.items()}
            panels.append(BarPanel(title, [names[index] for index in used], rows))
    return panels


def calibration(data: ReportData) -> Item:
    """How often STOP would have been right, by the probability that the agent assigned to STOP."""
    title = f"Calibration of STOP on {data.main_split}"
    panels: list[tuple[str, str, str, list[Line]]] = []
    for configuration in data.configurations:
        drawn = [line for entry in data.of(configuration) if (line := calibration_line(entry)) is not None]
        if drawn:
            panels.append((configuration, "probability of STOP", "share of scenes that are solved", drawn))
    if not panels:
        return MissingItem("Calibration of STOP", title, "no agent here reports its probability of STOP")
    note = f"All scenes in which an agent chose an action, in {BINS} equal bins of its probability of STOP."
    return Chart("Calibration of STOP", title, line_chart(panels, data.looks, diagonal=True), note)


def calibration_line(entry: AgentResults) -> Line | None:
    """Mean probability of STOP and share of solved scenes per non-empty bin; None without any probabilities."""
    bins: list[list[tuple[float, bool]]] = [[] for _ in range(BINS)]
    for run in entry.runs:
        for episode in run.episodes:
            solved = stop_would_succeed(run.header.settings, episode)
            for pair in zip(episode.stop_probabilities or (), solved, strict=True):
                bins[min(BINS - 1, int(pair[0] * BINS))].append(pair)
    points = [[sum(values) / len(pairs) for values in zip(*pairs, strict=True)] for pairs in bins if pairs]
    return Line(entry.agent, [x for x, _ in points], [y for _, y in points]) if points else None


def stop_would_succeed(settings: Settings, episode: RecordedEpisode) -> list[bool]:
    """For each action, whether STOP would have succeeded instead; empty without recorded probabilities."""
    if episode.stop_probabilities is None:
        return []
    program = compile_program(episode.program)
    visited = scenes(settings.dynamics(), episode.start, episode.actions)[:-1]
    return [program(scene) == episode.target for scene in visited]


def regret(data: ReportData) -> Item:
    """Extra actions of successes compared with the expert, and the share of optimal episodes."""
    title = f"Extra actions compared with the expert on {data.main_split}"
    rows = [[entry.agent, entry.configuration, *_regret(entry)] for entry in data.main_results if entry.header.expert]
    if not rows:
        return MissingItem("Regret", title, NEEDS_EXPERT)
    note = "Compared with the expert's shortest solutions; in Scatter it may miss shorter ones."
    columns = ("agent", "configuration", "extra actions of a success", "successes optimal (%)", "episodes optimal (%)")
    return table("Regret", title, columns, rows, note)


def _regret(entry: AgentResults) -> Sequence[Cell]:
    def solved(episode: RecordedEpisode) -> bool:
        return episode.is_success and episode.optimal_actions is not None

    def optimal(episode: RecordedEpisode) -> float:
        return 100.0 * (solved(episode) and extra_actions(episode) <= 0)

    means = ((extra_actions, solved), (optimal, solved), (optimal, every))
    return [mean_where(entry.runs, value, predicate) for value, predicate in means]


def extra_actions(episode: RecordedEpisode) -> int:
    """For a success whose shortest solution is known."""
    assert episode.optimal_actions is not None
    return len(episode.actions) - episode.optimal_actions


def comparison_items(data: ReportData) -> Iterator[Item]:
    """Paired tests between agents."""
    pairs = [
        (entry, other, difference)
        for configuration, split in product(data.configurations, data.splits)
        for entry, other in combinations(data.results([configuration], [split]), 2)
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
