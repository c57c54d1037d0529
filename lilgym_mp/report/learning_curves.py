"""Learning curves: accuracy on dev during training, for runs that evaluated it, and training progress."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from lilgym_mp.report.aggregation import Spread, spread
from lilgym_mp.report.charts import Line, lines
from lilgym_mp.report.items import Cell, Chart, Item, Lacking, table
from lilgym_mp.report.report_data import Curve, Gathered, differing, setting_shown

ITEM, TITLE, ON_DEV = "Figure 4", "Learning curves", "Accuracy on dev while training"
# By learner: the key of its progress to draw, and the label.
DRAWN: Mapping[str, tuple[str, str]] = {
    "ppo": ("accuracy", "success of training episodes"),
    "imitation": ("truth_accuracy", "accuracy of predicted truth values"),
    "parse-and-plan": ("loss", "loss of the parser"),
}
REWARD = "nlvr_reward"  # in a recipe: whether STOP was rewarded only in scenes of the corpus
NOT_EVALUATED = (
    "no training run in the directories was evaluated on dev during training; use `lilgym-mp train ppo CONFIGURATION"
    " --evaluate-every N`, with and without --nlvr-reward"
)
# Keys of evaluations on Scratch; those of FlipIt have only "accuracy".
PROGRAM_ACCURACY, IMAGE_ACCURACY = "accuracy_with_image", "image_accuracy"


def learning(found: Gathered) -> Iterator[Item]:
    """Figure 4, and the progress of training."""
    yield from dev_curves(found.curves)
    yield learning_curves(found)


def dev_curves(curves: Sequence[Curve]) -> Iterator[Item]:
    """One panel per configuration, one line per recipe: mean and deviation over seeds."""
    panels: list[tuple[str, str, str, list[Line]]] = []
    rows: list[list[Cell]] = []
    evaluated = [curve for curve in curves if curve.evaluations]
    for configuration in dict.fromkeys(curve.configuration for curve in evaluated):
        drawn: list[Line] = []
        for name, runs in _groups([curve for curve in evaluated if curve.configuration == configuration]).items():
            for what, key in _entries(runs):
                line = mean_line(f"{name}{what}", [run.evaluations for run in runs], key)
                drawn.append(line)
                last = spread([run.evaluations[-1][key] for run in runs])
                rows.append([line.name, configuration, len(runs), int(line.xs[-1]), last and _percent(last)])
        panels.append((configuration, "actions of training", "accuracy on dev, %", drawn))
    if not panels:
        yield Lacking(ITEM, ON_DEV, NOT_EVALUATED)
        return
    note = (
        "Sampled actions, illegal ones masked. With the program reward, STOP is right if the program says so; with the"
        " NLVR reward, only in a scene that the corpus has for the statement; 'by program' evaluates that agent by the"
        " program. As in the paper, Scratch tasks without such a scene are excluded. Lines are means over seeds, bands"
        " the sample standard deviation."
    )
    yield Chart(ITEM, ON_DEV, lines(panels), note)
    columns = ("agent", "configuration", "runs", "actions of training", "accuracy at the end (%)")
    yield table(ITEM, f"{ON_DEV}, at the end", columns, rows)


def _groups(curves: Sequence[Curve]) -> dict[str, list[Curve]]:
    """The runs by learner, reward and all other differences between their recipes except the seed."""
    keys = [key for key in differing([curve.recipe for curve in curves]) if key != REWARD]
    groups: dict[str, list[Curve]] = {}
    for curve in curves:
        reward = "NLVR reward" if curve.recipe.get(REWARD) else "program reward"
        settings = [f"{key} {setting_shown(curve.recipe.get(key))}" for key in keys]
        groups.setdefault(", ".join([curve.learner, *settings, reward]), []).append(curve)
    return groups


def _entries(runs: Sequence[Curve]) -> list[tuple[str, str]]:
    """The lines to draw for runs of one recipe: label suffix, and key of their evaluations."""
    if any(line.get(PROGRAM_ACCURACY) is None for run in runs for line in run.evaluations):
        return [("", "accuracy")]
    if runs[0].recipe.get(REWARD):
        return [("", IMAGE_ACCURACY), (", by program", PROGRAM_ACCURACY)]
    return [("", PROGRAM_ACCURACY)]


def mean_line(name: str, runs: Sequence[Sequence[Mapping[str, Any]]], key: str) -> Line:
    """Mean and deviation over runs, in per cent, at the step counts that all runs share."""
    by_steps = [{line["steps"]: line[key] for line in run} for run in runs]
    shared = sorted(set(by_steps[0]).intersection(*by_steps[1:]))
    points = [_percent(found) for x in shared if (found := spread([run[x] for run in by_steps])) is not None]
    return Line(name, shared, [point.mean for point in points], [point.deviation or 0.0 for point in points])


def _percent(share: Spread) -> Spread:
    return Spread(100 * share.mean, None if share.deviation is None else 100 * share.deviation, share.runs)


def learning_curves(found: Gathered) -> Item:
    """One panel per learner and configuration, one line per run."""
    panels: dict[tuple[str, str], list[Line]] = {}
    for curve in found.curves:
        if (line := _line(curve)) is not None:
            panels.setdefault((curve.learner, curve.configuration), []).append(line)
    if not panels:
        return Lacking(
            ITEM, TITLE, "the directories contain no training run with progress; name one in addition to the episodes"
        )
    drawn = [
        (f"{learner} {configuration}".strip(), "steps", DRAWN[learner][1], found_lines)
        for (learner, configuration), found_lines in panels.items()
    ]
    return Chart(ITEM, TITLE, lines(drawn), "Training progress, on training tasks.")


def _line(curve: Curve) -> Line | None:
    key = DRAWN.get(curve.learner, ("accuracy", ""))[0]
    entries = [line for line in curve.lines if line.get(key) is not None]
    points = [(line["step" if "step" in line else "steps"], line[key]) for line in entries]
    return Line(curve.run.name, [x for x, _ in points], [y for _, y in points]) if points else None
