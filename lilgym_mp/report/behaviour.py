"""Behaviour of agents: rollout statistics, errors, and positions of actions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from lilgym_mp.actions import AddBlock, AddItem, RemoveBlock, RemoveItem, Stop
from lilgym_mp.appearances import InvalidReason
from lilgym_mp.evaluation.episodes import RecordedEpisode
from lilgym_mp.report import paper
from lilgym_mp.report.aggregation import Spread, average, over_runs, share
from lilgym_mp.report.charts import Panel, bars, maps
from lilgym_mp.report.items import Cell, Chart, Item, Lacking, table
from lilgym_mp.report.report_data import Entry, Gathered

ADDS, REMOVES = (AddBlock, AddItem), (RemoveBlock, RemoveItem)
KINDS: Mapping[str, tuple[type, ...]] = {"ADD": ADDS, "REMOVE": REMOVES}


def stops(episode: RecordedEpisode) -> bool:
    """Whether the agent ended the episode with STOP."""
    return isinstance(episode.actions[-1], Stop)


def count_of(episode: RecordedEpisode, kinds: tuple[type, ...]) -> int:
    return sum(isinstance(action, kinds) for action in episode.actions)


# Statistics of the episodes of a run, by name.
ROLLOUT: Mapping[str, Callable[[Sequence[RecordedEpisode]], float | None]] = {
    "without STOP (%)": lambda kept: share(kept, lambda episode: not stops(episode)),
    "with an invalid action (%)": lambda kept: share(kept, lambda episode: episode.invalid_reason is not None),
    "mean actions": lambda kept: average(kept, lambda episode: len(episode.actions)),
    "mean ADD": lambda kept: average(kept, lambda episode: count_of(episode, ADDS)),
    "mean REMOVE": lambda kept: average(kept, lambda episode: count_of(episode, REMOVES)),
}


def behaviour(found: Gathered) -> Iterator[Item]:
    yield from figures_6_and_9(found)
    yield from errors(found)
    yield figure_10(found)


def figures_6_and_9(found: Gathered) -> Iterator[Item]:
    """Rollout statistics, including the expert's."""
    title = f"Rollout statistics on {found.main_split}"
    rows: list[list[Cell]] = []
    values: dict[str, dict[str, list[Spread | float | None]]] = {name: {} for name in ROLLOUT}
    for agent in found.agents:
        entries = [found.find(agent, name) for name in found.configurations]
        for name, number in ROLLOUT.items():
            values[name][agent] = [entry and over_runs(entry.runs, number) for entry in entries]
        for entry in entries:
            if entry is not None:
                rows.append([agent, entry.configuration, *(over_runs(entry.runs, f) for f in ROLLOUT.values())])
    panels = [Panel(name, found.configurations, series) for name, series in values.items()]
    note = (
        "Episodes without STOP end with an invalid action or at the horizon. Means include the last action, even STOP."
    )
    yield Chart("Figure 6 and Figure 9", title, bars(panels, ""), note)
    yield table("Figure 6 and Figure 9", f"{title}, numbers", ("agent", "configuration", *ROLLOUT), rows)


REASONS: Mapping[str, tuple[InvalidReason, ...]] = {
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


def stop_kind(episode: RecordedEpisode) -> str | None:
    """The kind of wrong STOP that ended the episode, or None."""
    if episode.outcome != "wrong_stop":
        return None
    if len(episode.actions) == 1:
        return DIRECT
    if episode.actions_left is None or episode.optimal_actions is None:
        return LATER
    return EARLY if episode.actions_left < episode.optimal_actions else ERRONEOUS


def error_kind(episode: RecordedEpisode) -> str | None:
    """The kind of error: an invalid-action reason, a kind of wrong STOP, or the horizon; None for a success."""
    if episode.is_success:
        return None
    if (stop := stop_kind(episode)) is not None:
        return f"{stop} stop"
    if episode.invalid_reason is not None:
        return next(name for name, reasons in REASONS.items() if episode.invalid_reason in reasons)
    return "horizon"


ERROR_KINDS = (*REASONS, f"{DIRECT} stop", f"{EARLY} stop", f"{ERRONEOUS} stop", f"{LATER} stop", "horizon")


def errors(found: Gathered) -> Iterator[Item]:
    """Failed episodes by kind of error, in per cent, with the 50 that the paper's authors classified."""
    rows: list[list[Cell]] = []
    panels: list[Panel] = []
    for configuration in found.configurations:
        values: dict[str, list[Spread | float | None]] = {}
        for entry in found.of(configuration):
            failed = [e for run in entry.runs for e in run.episodes if not e.is_success]
            kinds = [error_kind(episode) for episode in failed]
            shares = [100 * kinds.count(kind) / len(failed) if failed else None for kind in ERROR_KINDS]
            rows.append([entry.agent, configuration, len(failed), *shares])
            if failed:
                values[entry.agent] = list(shares)
        rows += [list(row) for row in _published(configuration)]
        if values:
            panels.append(Panel(configuration, [kind.replace(" ", "\n") for kind in ERROR_KINDS], values))
    title = f"Errors on {found.main_split}, in per cent of them"
    note = f"{STOP_NOTE} † 50 errors read by hand ({paper.SOURCE}, section D.2), as shares of all 50."
    yield table("Section D.2", title, ("agent", "configuration", "errors", *ERROR_KINDS), rows, note)
    if panels:
        yield Chart("Section D.2", f"{title}, drawn", bars(panels, "% of errors", columns=1))


def _published(configuration: str) -> Iterator[Sequence[Cell]]:
    for (model, name), told in paper.ERRORS.items():
        if name == configuration:
            reasons = (told.separator, told.empty, told.does_not_fit, told.on_top)
            shares: list[Cell] = [told.invalid * reason / 100 for reason in reasons]
            kinds = (told.direct, told.early, told.erroneous)
            shares += [None if kind is None else told.stops * kind / 100 for kind in kinds]
            yield [f"{model} †", configuration, 50, *shares, None, None]


def figure_10(found: Gathered) -> Item:
    """Positions of Scatter actions, by cell and type."""
    title = f"Where actions go on {found.main_split}, in per cent of the agent's edits"
    grid = found.header.settings.grid
    entries = [
        entry
        for configuration in found.configurations
        for entry in found.of(configuration)
        if entry.header.settings.appearance == "scatter"
    ]
    if not entries or isinstance(grid, str):
        why = "the grid is native" if entries else "no Scatter configuration was evaluated"
        return Lacking("Figure 10", title, f"{why}, so there are no cells to map")
    panels = [_maps(entry, grid) for entry in entries]
    note = f"Cells of the {grid[0]} x {grid[1]} grid; each map has its own scale."
    return Chart("Figure 10", title, maps(panels), note)


def _maps(entry: Entry, grid: tuple[int, int]) -> list[tuple[str, list[list[float]]]]:
    """Maps of an entry: all edits, then each type."""
    cells = {name: action_map(entry, grid, kinds) for name, kinds in KINDS.items()}
    everything = [[sum(both) for both in zip(*rows, strict=True)] for rows in zip(*cells.values(), strict=True)]
    total = sum(map(sum, everything)) or 1
    shown = {"all": everything, **cells}
    return [
        (f"{entry.agent}, {entry.configuration}: {name}", [[100 * cell / total for cell in row] for row in counts])
        for name, counts in shown.items()
    ]


def action_map(entry: Entry, grid: tuple[int, int], kinds: tuple[type, ...]) -> list[list[int]]:
    """The number of actions of those kinds per cell, as one list per row of the grid."""
    columns, rows = grid
    counts = [[0] * columns for _ in range(rows)]
    for run in entry.runs:
        for episode in run.episodes:
            for action in episode.actions:
                if isinstance(action, kinds):
                    placed: Any = action
                    counts[placed.row][placed.column] += 1
    return counts
