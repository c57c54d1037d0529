"""Behaviour of agents: rollout statistics, errors with examples, and how well they stop."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from dataclasses import replace
from urllib.parse import urlencode

import numpy as np

from lilgym_mp.contrib.report import paper
from lilgym_mp.contrib.report.aggregation import Value
from lilgym_mp.contrib.report.charts import BarPanel, Line, bar_chart, film_strips, heat_maps, line_chart
from lilgym_mp.contrib.report.items import Cell, Chart, Item, table
from lilgym_mp.contrib.report.report_data import AgentResults, ReportData
from lilgym_mp.contrib.report.results import means_by_agent
from lilgym_mp.corpus.locations import BUILTIN
from lilgym_mp.evaluation.episode_files import Recording
from lilgym_mp.evaluation.episodes import FINAL_OUTCOMES, Episode, outcome_words, scenes
from lilgym_mp.programs import compile_program
from lilgym_mp.scene.actions import AddBlock, AddItem, RemoveBlock, RemoveItem, Stop, describe
from lilgym_mp.scene.appearances import InvalidReason
from lilgym_mp.scene.appearances.grids import checked_grid
from lilgym_mp.scene.arrays import Float64Array, UInt8Array
from lilgym_mp.scene.render import draw

ROLLOUT_STATISTICS: Mapping[str, Value] = {
    "without STOP (%)": lambda episode: 0.0 if Stop in map(type, episode.actions[-1:]) else 100.0,
    "with an invalid action (%)": lambda episode: 0.0 if episode.invalid_reason is None else 100.0,
    "mean actions": lambda episode: len(episode.actions),
    "mean ADD": lambda episode: sum(isinstance(action, AddBlock | AddItem) for action in episode.actions),
    "mean REMOVE": lambda episode: sum(isinstance(action, RemoveBlock | RemoveItem) for action in episode.actions),
}
"""By name, a value of each episode, of which the mean is shown."""


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
    yield Chart("Figure 6 and Figure 9", title, bar_chart(panels, "", data.looks), note=note)
    yield table("Figure 6 and Figure 9", f"{title}, numbers", ("agent", "configuration", *ROLLOUT_STATISTICS), rows)


def figure_10(data: ReportData) -> Iterator[Item]:
    """For each agent, the share of its edits that name each cell of the scene's grid."""
    title = f"Where edits go on {data.main_split}"
    maps: dict[str, Float64Array] = {}
    for entry in (entry for configuration in data.configurations for entry in data.of(configuration)):
        actions = [action for run in entry.runs for episode in run.episodes for action in episode.actions]
        for name, kind in (("ADD", AddItem), ("REMOVE", RemoveItem)):
            cells = [(action.row, action.column) for action in actions if isinstance(action, kind)]
            if cells:
                columns, rows = checked_grid(entry.header.settings.grid)
                counts = np.zeros((rows, columns))
                np.add.at(counts, tuple(np.transpose(cells)), 1)
                maps[f"{entry.agent}, {entry.configuration}, {len(cells):,} {name}"] = 100 * counts / len(cells)
    if maps:
        unit = "share of the edits of this kind, %"
        yield Chart("Figure 10", title, heat_maps(maps, unit), note="Illegal edits count, too.")
    else:
        yield Item("Figure 10", title, note="no recorded edit names a cell of a grid")


INVALID_REASON_GROUPS = {
    "separator": (InvalidReason.SEPARATOR,),
    "nothing to remove": (InvalidReason.NOTHING_TO_REMOVE, InvalidReason.EMPTY_TOWER),
    "does not fit": (InvalidReason.OUT_OF_BOX, InvalidReason.FULL_TOWER),
    "on top": (InvalidReason.OVERLAP,),
}
NO_ACTION = "no action"  # of a language model's last answer
ERROR_KINDS = (*INVALID_REASON_GROUPS, "direct stop", "early stop", "erroneous stop", "later stop", "horizon")
STOP_NOTE = (
    "A wrong STOP is direct if it is the first action, early if the expert needs fewer actions from there than from the"
    " start, and otherwise erroneous. A later STOP is early or erroneous; the expert was not run (--optimal) or knows"
    " no solution."
)


def error_kind(episode: Episode) -> str | None:
    """Reason of the invalid action, kind of wrong STOP, or "horizon"; None for a success."""
    if episode.is_success:
        return None
    if episode.outcome == "wrong_stop":
        if len(episode.actions) == 1:
            return "direct stop"
        if episode.actions_left is None or episode.optimal_actions is None:
            return "later stop"
        return "early stop" if episode.actions_left < episode.optimal_actions else "erroneous stop"
    if episode.outcome not in FINAL_OUTCOMES:
        return NO_ACTION
    groups = (name for name, reasons in INVALID_REASON_GROUPS.items() if episode.invalid_reason in reasons)
    return next(groups, "horizon")


def errors(data: ReportData) -> Iterator[Item]:
    """Failed episodes by kind of error, next to the paper's 50 manually analysed errors."""
    rows: list[list[Cell]] = []
    for configuration in data.configurations:
        for entry in data.of(configuration):
            kinds = [kind for run in entry.runs for episode in run.episodes if (kind := error_kind(episode))]
            shares = [100 * kinds.count(kind) / len(kinds) if kinds else None for kind in (*ERROR_KINDS, NO_ACTION)]
            if NO_ACTION not in kinds:
                shares[-1] = None
            rows.append([entry.agent, configuration, len(kinds), *shares])
        for (model, name), published in paper.ERRORS.items():
            if name == configuration:
                shares = [None if part is None else whole * part / 100 for whole, parts in published for part in parts]
                rows.append([f"{model} †", configuration, 50, *shares, None, None, None])
    title = f"Errors on {data.main_split}, in per cent of failed episodes"
    note = f"{STOP_NOTE} † 50 errors read by hand ({paper.SOURCE}, section D.2), as shares of all 50."
    yield table("Section D.2", title, ("agent", "configuration", "errors", *ERROR_KINDS, NO_ACTION), rows, note)


SERVED = "http://127.0.0.1:8000"
BINS = 10  # bins of the probability of STOP


def calibration(data: ReportData) -> Iterator[Item]:
    """How often STOP would have been right, by the probability that the agent assigned to STOP."""
    title = f"Calibration of STOP on {data.main_split}"
    panels: list[tuple[str, str, str, list[Line]]] = []
    for configuration in data.configurations:
        drawn = [line for entry in data.of(configuration) if (line := calibration_line(entry)) is not None]
        if drawn:
            panels.append((configuration, "probability of STOP", "share of scenes that are solved", drawn))
    if panels:
        note = f"All scenes in which an agent chose an action, in {BINS} equal bins of its probability of STOP."
        yield Chart("Calibration of STOP", title, line_chart(panels, data.looks, diagonal=True), note=note)
    else:
        yield Item("Calibration of STOP", title, note="no agent here reports its probability of STOP")


def calibration_line(entry: AgentResults) -> Line | None:
    """Mean probability of STOP and share of solved scenes per non-empty bin; None without any probabilities."""
    bins: list[list[tuple[float, bool]]] = [[] for _ in range(BINS)]
    for run in entry.runs:
        for episode in run.episodes:
            if episode.stop_probabilities is not None:
                program = compile_program(episode.program)
                *visited, _ = scenes(run.header.settings.dynamics(), episode.start, episode.actions)
                solved = [program(scene) == episode.target for scene in visited]
                for pair in zip(episode.stop_probabilities, solved, strict=True):
                    bins[min(BINS - 1, int(pair[0] * BINS))].append(pair)
    points = [[sum(values) / len(pairs) for values in zip(*pairs, strict=True)] for pairs in bins if pairs]
    return Line(entry.agent, [x for x, _ in points], [y for _, y in points]) if points else None


def failures(data: ReportData) -> Iterator[Item]:
    """For each agent, the first recorded example of each kind of error."""
    for agent in data.agents:
        examples: dict[str, tuple[str, list[tuple[UInt8Array, str]]]] = {}
        places: dict[str, tuple[Recording, Episode]] = {}
        runs = [run for entry in data.of_agent(agent) for run in entry.runs]
        for run, episode in [(each, episode) for each in runs for episode in each.episodes]:
            kind = error_kind(episode)
            if kind is not None and kind not in examples:
                examples[kind] = film_strip(run, episode, kind)
                places[kind] = (run, episode)
        kinds = [kind for kind in (*ERROR_KINDS, NO_ACTION) if kind in examples]
        shown = [examples[kind] for kind in kinds]
        if shown:
            links = tuple(link for kind in kinds for link in links_of(kind, *places[kind]))
            title = f"An example of each kind of error: {agent}"
            yield Chart("Failures", title, film_strips(shown), raster=True, links=links)


def links_of(kind: str, run: Recording, episode: Episode) -> Iterator[tuple[str, str]]:
    """Text and address of the task on the pages Play and Watch of `lilgym-mp serve`, at its default port."""
    settings = run.header.settings
    task = {"configuration": settings.configuration, "split": run.header.split, "task": episode.task}
    yield f"Play: {kind}", f"{SERVED}/play?{urlencode(task)}"
    yield f"Watch: {kind}", f"{SERVED}/watch?{urlencode({'text': episode.task})}"


def film_strip(run: Recording, episode: Episode, kind: str) -> tuple[str, list[tuple[UInt8Array, str]]]:
    """The start scene and the scene after each action, with the command that opens the task."""
    settings = run.header.settings
    reason = f" ({episode.invalid_reason})" if episode.invalid_reason else ""
    outcome = outcome_words(f"{episode.outcome}{reason}")
    others = replace(settings, corpus=BUILTIN).options()
    where = ["--corpus", settings.corpus, *others, "--split", run.header.split, "--task", episode.task]
    head = [
        f"“{episode.statement}”  Make it {str(episode.target).lower()}.",
        f"{settings.configuration}, {run.header.split}, task {episode.task}: {outcome}, reward {episode.reward:+.1f}",
        f"Kind of error: {kind}. Open the task with: lilgym-mp play {shlex.join([settings.configuration, *where])}",
    ]
    visited = scenes(settings.dynamics(), episode.start, episode.actions)
    captions = ["start", *(f"{step}. {describe(action)}" for step, action in enumerate(episode.actions, start=1))]
    return "\n".join(head), [(draw(scene, "half"), text) for scene, text in zip(visited, captions, strict=True)]
