"""Learning curves: accuracy on dev during training, of runs that were evaluated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lilgym_mp.contrib.report.aggregation import mean_std
from lilgym_mp.contrib.report.charts import Line, line_chart
from lilgym_mp.contrib.report.items import Cell, Chart, Item, table
from lilgym_mp.contrib.report.report_data import ReportData, TrainingCurve, differing_keys, shown_setting
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.scene.arrays import AnyMapping
from lilgym_mp.scene.grouping import grouped

ITEM = "Figure 4"
TITLE = "Accuracy on dev while training"
REWARD_KEY = "nlvr_reward"  # recipe key: whether only STOP in a scene of the corpus was rewarded
NOT_EVALUATED = (
    "no training run in the directories was evaluated on dev during training; use `lilgym-mp train ppo CONFIGURATION"
    " --evaluate-every N`, with and without --nlvr-reward"
)
CAPTION = (
    "Sampled actions, without stop forcing. A line is the mean over the runs of a recipe; if there are several, the"
    " band is the sample standard deviation."
)
NLVR_CAPTION = (
    " With the program reward, STOP is right if the program says so; with the NLVR reward, only in a scene that the"
    " corpus has for the statement; 'by program' evaluates that agent by the program."
)
IMAGE_CAPTION = " As in the paper, Scratch tasks without a scene in the corpus are excluded."
# Keys of an evaluation on Scratch, restricted to tasks with an image; FlipIt evaluations have only `accuracy`.
PROGRAM_ACCURACY = "accuracy_with_image"
IMAGE_ACCURACY = "image_accuracy"


def dev_curves(data: ReportData) -> Iterator[Item]:
    """Figure 4: one panel per configuration, one line per recipe, with the mean and deviation over seeds."""
    panels: list[tuple[str, str, str, list[Line]]] = []
    rows: list[list[Cell]] = []
    evaluated = [curve for curve in data.curves if curve.evaluations]
    shown = {name: [curve for curve in evaluated if curve.configuration == name] for name in CONFIGURATIONS}
    recipes = [[curve.recipe for curve in of_panel] for of_panel in shown.values()]
    differing = dict.fromkeys(key for each in recipes for key in differing_keys(each))  # so that a recipe has one name
    keys = [key for key in differing if key not in ("stop_forcing", REWARD_KEY)]  # which have names of their own
    has_nlvr = any(curve.recipe.get(REWARD_KEY) for curve in evaluated)
    for configuration, of_panel in shown.items():
        drawn: list[Line] = []
        by_name = grouped((_name(curve, keys, names_reward=has_nlvr), curve) for curve in of_panel)
        for name, runs in by_name.items():
            for suffix, key in _metrics(runs):
                line = mean_line(f"{name}{suffix}", [run.evaluations for run in runs], key)
                drawn.append(line._replace(agent=data.agent_of(runs[0].run)))
                last = mean_std([100 * run.evaluations[-1][key] for run in runs])
                rows.append([line.name, configuration, len(runs), int(line.xs[-1]), last])
        if drawn:
            panels.append((configuration, "actions of training", "accuracy on dev, %", drawn))
    if not panels:
        yield Item(ITEM, TITLE, note=NOT_EVALUATED)
        return
    has_image = any(record.get(PROGRAM_ACCURACY) is not None for curve in evaluated for record in curve.evaluations)
    caption = CAPTION
    if has_nlvr:
        caption += NLVR_CAPTION
    if has_image:
        caption += IMAGE_CAPTION
    yield Chart(ITEM, TITLE, line_chart(panels, data.looks), note=caption)
    columns = ("agent", "configuration", "runs", "actions of training", "accuracy at the end (%)")
    yield table(ITEM, f"{TITLE}, at the end", columns, rows)


def _name(curve: TrainingCurve, keys: Sequence[str], *, names_reward: bool) -> str:
    """The learner of a run, as in the paper, these settings and the reward."""
    recipe = curve.recipe
    learner = {"ppo": "PPO+SF" if recipe.get("stop_forcing") else "PPO"}.get(curve.learner, curve.learner)
    parts = [learner, *(f"{key} {shown_setting(recipe.get(key))}" for key in keys)]
    if names_reward:
        parts.append("NLVR reward" if recipe.get(REWARD_KEY) else "program reward")
    return ", ".join(parts)


def _metrics(runs: Sequence[TrainingCurve]) -> list[tuple[str, str]]:
    """The lines of runs of one recipe: suffix of the line's name, key of the evaluations."""
    if any(line.get(PROGRAM_ACCURACY) is None for run in runs for line in run.evaluations):
        return [("", "accuracy")]
    if runs[0].recipe.get(REWARD_KEY):
        return [("", IMAGE_ACCURACY), (", by program", PROGRAM_ACCURACY)]
    return [("", PROGRAM_ACCURACY)]


def mean_line(name: str, runs: Sequence[Sequence[AnyMapping]], key: str) -> Line:
    """Mean and deviation over runs, in per cent, up to where the first of them ends, at its steps."""
    series = [([record["steps"] for record in run], [100 * record[key] for record in run]) for run in runs]
    xs = min((steps for steps, _ in series), key=max)
    ys = np.array([np.interp(xs, *points) for points in series])
    return Line(name, xs, ys.mean(0).tolist(), ys.std(0, ddof=1).tolist() if len(ys) > 1 else None)
