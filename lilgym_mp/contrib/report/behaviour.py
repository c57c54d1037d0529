"""Behaviour of agents: rollout statistics, error categories, and maps of actions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from lilgym_mp.contrib.report import paper
from lilgym_mp.contrib.report.aggregation import MeanStd, Value
from lilgym_mp.contrib.report.charts import BarPanel, bar_chart, heat_maps
from lilgym_mp.contrib.report.items import Cell, Chart, Item, MissingItem, table
from lilgym_mp.contrib.report.report_data import AgentResults, ReportData
from lilgym_mp.contrib.report.results import means_by_agent
from lilgym_mp.evaluation.episodes import RecordedEpisode
from lilgym_mp.scene.actions import AddBlock, AddItem, RemoveBlock, RemoveItem, Stop
from lilgym_mp.scene.appearances import InvalidReason

ADDS, REMOVES = (AddBlock, AddItem), (RemoveBlock, RemoveItem)
EDIT_TYPES: Mapping[str, tuple[type, ...]] = {"ADD": ADDS, "REMOVE": REMOVES}


def ends_with_stop(episode: RecordedEpisode) -> bool:
    """Whether the agent ended the episode with STOP."""
    return isinstance(episode.actions[-1], Stop)


def count_actions(episode: RecordedEpisode, types: tuple[type, ...]) -> int:
    return sum(isinstance(action, types) for action in episode.actions)


# By name, a value of each episode, of which the mean is shown.
ROLLOUT_STATISTICS: Mapping[str, Value] = {
    "without STOP (%)": lambda episode: 100.0 * (not ends_with_stop(episode)),
    "with an invalid action (%)": lambda episode: 100.0 * (episode.invalid_reason is not None),
    "mean actions": lambda episode: len(episode.actions),
    "mean ADD": lambda episode: count_actions(episode, ADDS),
    "mean REMOVE": lambda episode: count_actions(episode, REMOVES),
}


def behaviour_items(data: ReportData) -> Iterator[Item]:
    yield from figures_6_and_9(data)
    yield from errors(data)
    yield figure_10(data)


def figures_6_and_9(data: ReportData) -> Iterator[Item]:
    """Rollout statistics of all agents."""
    title = f"Rollout statistics on {data.main_split}"
    means = {name: means_by_agent(data, value) for name, value in ROLLOUT_STATISTICS.items()}
    rows = [
        [agent, configuration, *(values[agent][index] for values in means.values())]
        for agent in data.agents
        for index, configuration in enumerate(data.configurations)
        if data.find(agent, configuration) is not None
    ]
    panels = [
        BarPanel(name.removesuffix(" (%)"), data.configurations, values, "episodes, %" if "%" in name else "actions")
        for name, values in means.items()
    ]
    note = (
        "Episodes without STOP end with an invalid action or at the horizon. Means include the last action, even STOP."
    )
    yield Chart("Figure 6 and Figure 9", title, bar_chart(panels, "", data.looks), note)
    yield table("Figure 6 and Figure 9", f"{title}, numbers", ("agent", "configuration", *ROLLOUT_STATISTICS), rows)


INVALID_REASON_GROUPS: Mapping[str, tuple[InvalidReason, ...]] = {
    "separator": (InvalidReason.SEPARATOR,),
    "nothing to remove": (InvalidReason.NOTHING_TO_REMOVE, InvalidReason.EMPTY_TOWER),
    "does not fit": (InvalidReason.OUT_OF_BOX, InvalidReason.FULL_TOWER),
    "on top": (InvalidReason.OVERLAP,),
}
DIRECT, EARLY, ERRONEOUS, LATER = "direct", "early", "erroneous", "later"
STOP_NOTE = (
    "A wrong STOP is direct if it is the first action, early if the expert needs fewer actions from there than from the"
    " start, and otherwise erroneous. A later STOP is early or erroneous; the expert was not run (--optimal) or knows"
    " no solution."
)


def wrong_stop_kind(episode: RecordedEpisode) -> str | None:
    """The kind of wrong STOP that ended the episode; None if none did."""
    if episode.outcome != "wrong_stop":
        return None
    if len(episode.actions) == 1:
        return DIRECT
    if episode.actions_left is None or episode.optimal_actions is None:
        return LATER
    return EARLY if episode.actions_left < episode.optimal_actions else ERRONEOUS


def error_kind(episode: RecordedEpisode) -> str | None:
    """Reason of the invalid action, kind of wrong STOP, or "horizon"; None for a success."""
    if episode.is_success:
        return None
    if (stop := wrong_stop_kind(episode)) is not None:
        return f"{stop} stop"
    if episode.invalid_reason is not None:
        return next(name for name, reasons in INVALID_REASON_GROUPS.items() if episode.invalid_reason in reasons)
    return "horizon"


STOP_KINDS = tuple(f"{kind} stop" for kind in (DIRECT, EARLY, ERRONEOUS, LATER))
ERROR_KINDS = (*INVALID_REASON_GROUPS, *STOP_KINDS, "horizon")


def errors(data: ReportData) -> Iterator[Item]:
    """Failed episodes by kind of error, next to the paper's 50 manually analysed errors."""
    rows: list[list[Cell]] = []
    panels: list[BarPanel] = []
    for configuration in data.configurations:
        values: dict[str, list[MeanStd | float | None]] = {}
        for entry in data.of(configuration):
            failed = [e for run in entry.runs for e in run.episodes if not e.is_success]
            kinds = [error_kind(episode) for episode in failed]
            shares = [100 * kinds.count(kind) / len(failed) if failed else None for kind in ERROR_KINDS]
            rows.append([entry.agent, configuration, len(failed), *shares])
            if failed:
                values[entry.agent] = list(shares)
        rows += [list(row) for row in _published(configuration)]
        if values:
            panels.append(BarPanel(configuration, [kind.replace(" ", "\n") for kind in ERROR_KINDS], values))
    title = f"Errors on {data.main_split}, in per cent of failed episodes"
    note = f"{STOP_NOTE} † 50 errors read by hand ({paper.SOURCE}, section D.2), as shares of all 50."
    yield table("Section D.2", title, ("agent", "configuration", "errors", *ERROR_KINDS), rows, note)
    if panels:
        yield Chart("Section D.2", f"{title}, chart", bar_chart(panels, "% of errors", data.looks))


def _published(configuration: str) -> Iterator[Sequence[Cell]]:
    for (model, name), errors in paper.ERRORS.items():
        if name == configuration:
            shares = [None if part is None else whole * part / 100 for whole, parts in errors for part in parts]
            yield [f"{model} †", configuration, 50, *shares, None, None]


def figure_10(data: ReportData) -> Item:
    """Where actions go, by cell and type."""
    title = f"Where actions go on {data.main_split}, in per cent of the agent's edits"
    grid = data.header.settings.grid
    entries = [entry for entry in data.main_results if entry.header.settings.dynamics().appearance.grid is not None]
    if not entries or isinstance(grid, str):
        why = "the grid is native" if entries else "no configuration whose actions name cells was evaluated"
        return MissingItem("Figure 10", title, f"{why}, so there are no cells to map")
    panels = [_maps(entry, grid) for entry in entries]
    note = f"Cells of the {grid[0]} x {grid[1]} grid; each map has its own scale."
    return Chart("Figure 10", title, heat_maps(panels), note)


def _maps(entry: AgentResults, grid: tuple[int, int]) -> list[tuple[str, np.ndarray]]:
    """Titled maps of all edits and of each type, in per cent of all edits."""
    by_type = {name: action_map(entry, grid, types) for name, types in EDIT_TYPES.items()}
    all_edits = np.sum([*by_type.values()], axis=0)
    return [
        (f"{entry.agent}, {entry.configuration}: {name}", 100 * counts / max(1, all_edits.sum()))
        for name, counts in {"all": all_edits, **by_type}.items()
    ]


def action_map(entry: AgentResults, grid: tuple[int, int], types: tuple[type, ...]) -> np.ndarray:
    """(rows, columns) counts of actions of the given types by grid cell."""
    counts = np.zeros(grid[::-1], np.int64)
    for edit in (action for run in entry.runs for episode in run.episodes for action in episode.actions):
        if isinstance(edit, types) and isinstance(edit, AddItem | RemoveItem):
            counts[edit.row, edit.column] += 1
    return counts
