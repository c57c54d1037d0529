"""Draws the charts of docs/results.md from the tables in docs/results.

    python scripts/draw_results.py
    python scripts/draw_results.py --row 13 RUN ...
    python scripts/draw_results.py --calibration RECORDING ...
    python scripts/draw_results.py --cells NAME RECORDING ...

`--row` first adds the evaluations of training runs to curves.csv: the accuracy on dev in percent, without start scenes
of Scratch that have no image in the corpus. The rows that begin with `paper` are C3+BERT with the paper's recipe,
`program-reward` and `nlvr-reward` those of Figure 4.
`--calibration` first writes calibration.csv from recordings made with --record-decisions: for each bin of the predicted
success, the mean prediction, the episodes and the successes.
`--cells` first adds the edits of an agent of Scatter to cells.csv: how many name each cell of the grid.
Accuracy by edits is that of outcomes.csv and needs the official data.
"""

from __future__ import annotations

import argparse
import json
from bisect import bisect_left
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from write_result_tables import RESULTS, read, runs_by_row, tasks, write

from lilgym_mp.contrib.report.aggregation import MeanStd
from lilgym_mp.contrib.report.behaviour import figure_10
from lilgym_mp.contrib.report.charts import BarPanel, Line, Looks, bar_chart, line_chart, save
from lilgym_mp.contrib.report.items import Chart
from lilgym_mp.contrib.report.learning_curves import IMAGE_ACCURACY, PROGRAM_ACCURACY, mean_line
from lilgym_mp.contrib.report.report_data import AgentResults, ReportData
from lilgym_mp.contrib.report.results import by_edits
from lilgym_mp.envs.registration import CONFIGURATIONS
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.episode_files import read_episodes
from lilgym_mp.learning.common.run_directory import EVALUATIONS_FILE, RUN_FILE
from lilgym_mp.scene import Colour, Shape, Size
from lilgym_mp.scene.actions import AddItem, RemoveItem
from lilgym_mp.scene.grouping import grouped
from lilgym_mp.solver import Solver

PICTURES = RESULTS.parent / "pictures"
AGENTS = {  # rows of the charts of agents, by number
    "1": "parse-and-plan",
    "2": "parse-and-plan-builtin",
    "3": "imitation",
    "4": "ppo+sf (greedy)",
    "5": "ppo+sf (sampled)",
    "8": "random legal",
    "10": "expert",
}
CURVES = {  # rows of the chart of curves
    "4": "PPO+SF",
    "11": "PPO+SF, this configuration alone",
    "13": "PPO",
    "15": "PPO+SF, no exchanged colours",
    "separators": "PPO+SF, acts on separators",
}
CALIBRATION_EDGES = (0.5, 0.8, 0.95, 1.0)  # upper edges of bins of the predicted success
PAPER_CURVES = {  # rows of the chart of C3+BERT with the paper's recipe
    "paper-sf": "PPO+SF",
    "paper": "PPO",
    "paper-no-bonus": "PPO, no entropy bonus",
}
NLVR, BY_PROGRAM = "nlvr-reward", "nlvr-reward-by-program"
REWARD_CURVES = {  # rows of Figure 4
    "program-reward": "program reward",
    NLVR: "NLVR reward",
    BY_PROGRAM: "NLVR reward, by program",
}


def add_curves(row: str, runs: list[Path]) -> None:
    """Adds evaluations to curves.csv, in place of earlier ones of the same runs."""
    head, *known = read("curves")
    names = {run.name for run in runs}
    rows = [each for each in known if each[1] not in names]
    for run in runs:
        configuration = json.loads((run / RUN_FILE).read_text())["identity"]["environment"]["configuration"]
        for line in map(json.loads, (run / EVALUATIONS_FILE).read_text().splitlines()):
            accuracy = line["accuracy"] if line[PROGRAM_ACCURACY] is None else line[PROGRAM_ACCURACY]
            values = {NLVR: line[IMAGE_ACCURACY], BY_PROGRAM: accuracy} if row == NLVR else {row: accuracy}
            for name, value in values.items():
                rows.append([name, run.name, configuration, str(line["steps"]), f"{100 * value:.1f}"])
    write("curves", [head, *sorted(rows, key=lambda each: (*each[:3], int(each[3])))])


def curves(rows: dict[str, str] = CURVES) -> Any:
    """The accuracy on dev while training, a panel per configuration that has runs of these rows; None if none has."""
    found: dict[tuple[str, str], dict[str, list[Any]]] = {}
    for row, run, configuration, steps, accuracy in read("curves")[1:]:
        point = {"steps": int(steps), "accuracy": float(accuracy) / 100}
        found.setdefault((configuration, row), {}).setdefault(run, []).append(point)
    panels: list[tuple[str, str, str, list[Any]]] = []
    for name in CONFIGURATIONS:
        runs = {text: found[name, row] for row, text in rows.items() if (name, row) in found}
        lines = [mean_line(text, [*of_row.values()], "accuracy") for text, of_row in runs.items()]
        if lines:
            panels.append((name, "actions of training", "accuracy on dev, %", lines))
    return line_chart(panels, Looks()) if panels else None


def verifier_curve() -> Any:
    """What a verifier learns in an audit of TowerScratch, by split."""
    rows = read("verifier_curve")[1:]
    found = grouped(((rate, split), (games, 100 * float(value))) for games, split, rate, value in rows)
    lines = [_line(f"{rate}, {split}", points)._replace(agent=rate) for (rate, split), points in found.items()]
    return line_chart([("", "games judged", "%", lines)], Looks())


def _line(name: str, points: Sequence[Sequence[Any]]) -> Line:
    """A line through (x, y) or (x, y, deviation)."""
    xs, ys, *deviations = ([float(value) for value in column] for column in zip(*points, strict=True))
    return Line(name, xs, ys, deviations[0] if deviations else None)


def reward_model_curves() -> Any:
    """The accuracy of V while it learns: a panel for each measure of effort."""
    panels = grouped((axis, (appearance, point)) for axis, appearance, *point in read("reward_model_curves")[1:])
    named = {axis: [_line(*line) for line in grouped(points).items()] for axis, points in panels.items()}
    return line_chart([("", axis, "V on held-out pairs, %", lines) for axis, lines in named.items()], Looks())


def language_model() -> Any:
    """The success of a fine-tuned language model, with 95 % intervals where there are."""
    found = grouped((name, point) for name, *point in read("language_model")[1:])
    lines = [_line(name, [point[:2] for point in points]) for name, points in found.items()]
    figure = line_chart([("", "steps", "success on 100 tasks, %", lines)], Looks())
    (axes,) = figure.axes
    for drawn, points in zip(axes.lines, found.values(), strict=True):
        for steps, success, low, high in points:
            if low:
                errors = [[float(success) - float(low)], [float(high) - float(success)]]
                axes.errorbar(float(steps), float(success), errors, color=drawn.get_color(), marker="o", capsize=3)
    return figure


def add_calibration(recordings: Sequence[Path]) -> None:
    """Writes calibration.csv."""
    bins: list[list[tuple[float, bool]]] = [[] for _ in CALIBRATION_EDGES]
    for recording in recordings:
        for episode in read_episodes(recording).episodes:
            assert episode.decisions is not None
            predicted = episode.decisions[0].success_probability
            assert predicted is not None
            bins[bisect_left(CALIBRATION_EDGES, predicted)].append((predicted, episode.is_success))
    rows = [["predicted", "episodes", "successes"]]
    for each in filter(None, bins):
        predicted, right = np.mean(each, axis=0)
        rows.append([f"{predicted:.4f}", str(len(each)), f"{right * len(each):.0f}"])
    write("calibration", rows)


def calibration() -> Any:
    """Success by the success that the included agent predicts, with the number of episodes of each bin."""
    rows = [(float(predicted), int(count), int(right)) for predicted, count, right in read("calibration")[1:]]
    line = Line("parse-and-plan", [x for x, *_ in rows], [right / count for _, count, right in rows])
    figure = line_chart([("", "predicted success", "success", [line])], Looks(), diagonal=True)
    (axes,) = figure.axes
    for x, count, right in rows:
        axes.annotate(f"{count:,}", (x, right / count), (0, -12), textcoords="offset points", ha="center", fontsize=7)
    return figure


def add_cells(agent: str, recordings: Sequence[Path]) -> None:
    """Adds an agent's edits to cells.csv, in place of its earlier ones."""
    episodes = (episode for recording in recordings for episode in read_episodes(recording).episodes)
    edits = (action for episode in episodes for action in episode.actions if isinstance(action, AddItem | RemoveItem))
    counts = Counter(("ADD" if isinstance(edit, AddItem) else "REMOVE", edit.row, edit.column) for edit in edits)
    head, *known = read("cells")
    new = [[agent, *map(str, cell), str(count)] for cell, count in sorted(counts.items())]
    write("cells", [head, *(row for row in known if row[0] != agent), *new])


def cells() -> Any:
    """Figure 10: the share of an agent's edits that name each cell of Scatter's grid, as a report draws it."""
    name = "ScatterFlipIt"
    header = SimpleNamespace(settings=Settings(name), run=None)
    edits = {
        "ADD": partial(AddItem, shape=Shape.SQUARE, colour=Colour.BLACK, size=Size.SMALL),  # which is not drawn
        "REMOVE": RemoveItem,
    }
    found: dict[str, list[Any]] = {}
    for agent, edit, row, column, count in read("cells")[1:]:
        found.setdefault(agent, []).extend([edits[edit](column=int(column), row=int(row))] * int(count))
    entries: list[AgentResults] = []
    for agent, actions in found.items():
        recording: Any = SimpleNamespace(header=header, episodes=[SimpleNamespace(actions=actions)])
        entries.append(AgentResults(agent, name, "dev", (recording,)))
    return next(item.figure for item in figure_10(ReportData(tuple(entries), ())) if isinstance(item, Chart))


def rewards() -> Any:
    """Figure 3: the mean reward, with the standard deviation over runs."""
    found = {(agent, name): reward for agent, name, reward, *_ in read("returns")[1:]}

    def value(agent: str, configuration: str) -> MeanStd:
        mean, deviation = (*map(float, found[agent, configuration].split(" ± ")), 0.0)[:2]
        return MeanStd(mean, deviation, 1, mean - deviation, mean + deviation)

    values = {agent: [value(agent, name) for name in CONFIGURATIONS] for agent in AGENTS.values()}
    return bar_chart([BarPanel("", [*CONFIGURATIONS], values)], "mean reward", Looks())


def edits() -> Any:
    """The accuracy by number of edits that the expert needs."""
    needed = {name: _edits(name) for name in CONFIGURATIONS}
    entries: list[AgentResults] = []
    for (row, name), recordings in runs_by_row().items():
        if row in AGENTS:
            for recording in recordings:
                passes = len(recording.episodes) // len(needed[name])
                recording.header = SimpleNamespace(passes=passes, run=None)
                for index, episode in enumerate(recording.episodes):
                    episode.edits = needed[name][index // passes]
            entries.append(AgentResults(AGENTS[row], name, "dev", tuple(recordings)))
    return next(item.figure for item in by_edits(ReportData(tuple(entries), ())) if isinstance(item, Chart))


def _edits(configuration: str) -> list[int]:
    solver = Solver(Settings(configuration, corpus="lilgym").dynamics())
    return [solver.solve(task).steps - 1 for task in tasks(configuration)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--row",
        choices=[*CURVES, *PAPER_CURVES, "program-reward", NLVR],
        help="row of the table of accuracies that the runs belong to",
    )
    parser.add_argument("runs", nargs="*", type=Path)
    parser.add_argument("--calibration", nargs="+", type=Path, metavar="RECORDING", help="write calibration.csv first")
    parser.add_argument(
        "--cells", nargs="+", metavar=("NAME", "RECORDING"), help="add an agent's edits to cells.csv first"
    )
    parser.add_argument("--curves", action="store_true", help="draw the charts of curves alone")
    args = parser.parse_args()
    if args.runs and not args.row:
        parser.error("runs need --row")
    if args.cells is not None and len(args.cells) < 2:
        parser.error("--cells needs a name and recordings")
    if args.runs:
        add_curves(args.row, args.runs)
    if args.calibration:
        add_calibration(args.calibration)
    if args.cells:
        add_cells(args.cells[0], [Path(path) for path in args.cells[1:]])
    charts = {
        "ppo-curves": curves(),
        "table-2-curves": curves(PAPER_CURVES),
        "figure-4": curves(REWARD_CURVES),
    }
    if not args.curves:
        charts |= {"mean-reward": rewards(), "edits-needed": edits(), "edit-cells": cells()}
    for name, figure in charts.items():
        if figure is not None:
            save(figure, PICTURES / f"results-{name}.png", "png")
