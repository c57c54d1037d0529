"""Items not in the paper: accuracy by difficulty, timing and calibration of STOP, and regret."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from lilgym_mp.evaluation.episodes import RecordedEpisode
from lilgym_mp.evaluation.recording import scenes
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.programs import compile_program
from lilgym_mp.report.aggregation import (
    RESAMPLES,
    accuracy,
    accuracy_interval,
    average,
    over_runs,
    paired_difference,
    share,
)
from lilgym_mp.report.behaviour import stops
from lilgym_mp.report.charts import Line, Panel, bars, lines
from lilgym_mp.report.items import Cell, Chart, Item, Lacking, table
from lilgym_mp.report.report_data import Entry, Gathered

MAX_EDITS = 6  # more are grouped together
BINS = 10  # of the probability of STOP
NEEDS_EXPERT = "this needs the expert: record with `lilgym-mp evaluate ... --record DIR --optimal`"


def difficulty(found: Gathered) -> Iterator[Item]:
    yield by_edits(found)
    yield by_actions_left(found)
    yield calibration(found)
    yield regret(found)


def edits_name(episode: RecordedEpisode) -> str | None:
    """How many edits the start scene needs, None if unknown."""
    if episode.edits is None:
        return None
    return str(episode.edits) if episode.edits < MAX_EDITS else f"{MAX_EDITS} or more"


def by_edits(found: Gathered) -> Item:
    """Accuracy by the number of edits that the expert needs."""
    title = f"Accuracy by number of edits needed on {found.main_split}"
    names = [*map(str, range(MAX_EDITS)), f"{MAX_EDITS} or more"]
    panels = _panels(found, names, edits_name, only=lambda entry: entry.header.expert)
    if not panels:
        return Lacking("Edits needed", title, NEEDS_EXPERT)
    return Chart(
        "Edits needed",
        title,
        bars(panels, "accuracy, %", top=109),
        "Edits in the expert's shortest solution.",
    )


def by_actions_left(found: Gathered) -> Item:
    """Accuracy of STOP, by the number of actions left."""
    title = f"Accuracy of STOP by actions left on {found.main_split}"
    horizon = found.header.settings.dynamics().horizon
    names = list(map(str, range(horizon)))

    def left(episode: RecordedEpisode) -> str | None:
        return str(horizon - len(episode.actions)) if stops(episode) else None

    note = f"Episodes that end with STOP, by the number of actions left of the horizon of {horizon}."
    panels = _panels(found, names, left)
    if not panels:
        return Lacking("Horizon left at STOP", title, "no episode here ends with STOP")
    return Chart("Horizon left at STOP", title, bars(panels, "right STOPs, %", columns=1, top=109), note)


def _panels(
    found: Gathered,
    names: Sequence[str],
    key: Callable[[RecordedEpisode], str | None],
    only: Callable[[Entry], bool] = lambda entry: True,
) -> list[Panel]:
    """Accuracy of each agent by key of its episodes, one panel per configuration."""
    panels: list[Panel] = []
    for configuration in found.configurations:
        entries = [entry for entry in found.of(configuration) if only(entry)]
        values = {
            entry.agent: [
                over_runs(entry.runs, lambda kept, name=name: accuracy([e for e in kept if key(e) == name]))
                for name in names
            ]
            for entry in entries
        }
        used = [place for place in range(len(names)) if any(row[place] is not None for row in values.values())]
        if used:
            kept = {agent: [row[place] for place in used] for agent, row in values.items()}
            panels.append(Panel(configuration, [names[place] for place in used], kept))
    return panels


def calibration(found: Gathered) -> Item:
    """How often STOP would have been right, by the agent's probability of STOP."""
    title = f"Calibration of STOP on {found.main_split}"
    panels: list[tuple[str, str, str, list[Line]]] = []
    for configuration in found.configurations:
        drawn = [line for entry in found.of(configuration) if (line := calibration_line(entry)) is not None]
        if drawn:
            panels.append((configuration, "probability of STOP", "share of scenes that are solved", drawn))
    if not panels:
        return Lacking("Calibration of STOP", title, "no agent here reports its probability of STOP")
    note = f"All scenes in which an agent chose an action, in {BINS} equal bins of its probability of STOP."
    return Chart("Calibration of STOP", title, lines(panels, diagonal=True), note)


def calibration_line(entry: Entry) -> Line | None:
    """Mean probability of STOP and share of solved scenes for each non-empty bin; None without probabilities."""
    bins: list[list[tuple[float, bool]]] = [[] for _ in range(BINS)]
    for run in entry.runs:
        for episode in run.episodes:
            solved = solved_before(run.header.settings, episode)
            for pair in zip(episode.stop_probabilities or (), solved, strict=True):
                bins[min(BINS - 1, int(pair[0] * BINS))].append(pair)
    points = [[sum(values) / len(found) for values in zip(*found, strict=True)] for found in bins if found]
    return Line(entry.agent, [x for x, _ in points], [y for _, y in points]) if points else None


def solved_before(settings: Settings, episode: RecordedEpisode) -> list[bool]:
    """Whether STOP would have been right before each action."""
    if episode.stop_probabilities is None:
        return []
    program = compile_program(episode.program)
    visited = scenes(settings.dynamics(), episode.start, episode.actions)[:-1]
    return [program(scene) == episode.target for scene in visited]


def regret(found: Gathered) -> Item:
    """Actions beyond the expert's in successes, and the share of optimal successes and episodes."""
    title = f"Actions beyond the expert's on {found.main_split}"
    rows: list[list[Cell]] = []
    for configuration in found.configurations:
        for entry in found.of(configuration):
            if entry.header.expert:
                rows.append([entry.agent, configuration, *_regret(entry)])
    if not rows:
        return Lacking("Regret", title, NEEDS_EXPERT)
    columns = ("agent", "configuration", "extra actions of a success", "successes optimal (%)", "episodes optimal (%)")
    return table(
        "Regret",
        title,
        columns,
        rows,
        "Compared with the expert's shortest solutions; in Scatter it may miss shorter ones.",
    )


def _regret(entry: Entry) -> Sequence[Cell]:
    def solved(kept: Sequence[RecordedEpisode]) -> list[RecordedEpisode]:
        return [episode for episode in kept if episode.is_success and episode.optimal_actions is not None]

    def optimal(episode: RecordedEpisode) -> bool:
        return bool(solved([episode])) and extra_actions(episode) <= 0

    return (
        over_runs(entry.runs, lambda kept: average(solved(kept), extra_actions)),
        over_runs(entry.runs, lambda kept: share(solved(kept), optimal)),
        over_runs(entry.runs, lambda kept: share(kept, optimal)),
    )


def extra_actions(episode: RecordedEpisode) -> int:
    """Actions beyond the shortest solution, for a success where it is known."""
    assert episode.optimal_actions is not None
    return len(episode.actions) - episode.optimal_actions


def comparisons(found: Gathered) -> Iterator[Item]:
    """Confidence intervals of accuracies, and paired tests between agents."""
    rows: list[list[Cell]] = []
    pairs: list[list[Cell]] = []
    for configuration in found.configurations:
        for split in found.splits:
            entries = [e for agent in found.agents if (e := found.find(agent, configuration, split)) is not None]
            for place, entry in enumerate(entries):
                low, high = accuracy_interval(entry.runs)
                rows.append([entry.agent, configuration, split, over_runs(entry.runs, accuracy), low, high])
                for other in entries[place + 1 :]:
                    difference = paired_difference(entry.runs, other.runs)
                    if difference is not None:
                        pairs.append(
                            [
                                entry.agent,
                                other.agent,
                                configuration,
                                split,
                                *difference[:3],
                                f"{difference.p_value:.4f}",
                            ]
                        )
    note = f"95 % bootstrap intervals: statements are resampled {RESAMPLES:,} times, with their start scenes and runs."
    columns = ("agent", "configuration", "split", "accuracy (%)", "from (%)", "to (%)")
    yield table("Confidence intervals", "Accuracy with intervals over statements", columns, rows, note)
    if pairs:
        columns = ("agent", "other agent", "configuration", "split", "difference (points)", "from", "to", "p")
        note = "The same resampled statements for both agents; p is two-sided, not corrected for multiple tests."
        yield table("Paired tests", "Differences in accuracy between agents", columns, pairs, note)
