"""How training went, from the progress that runs keep."""

from __future__ import annotations

from collections.abc import Mapping

from lilgym_mp.report.drawing import Line, lines
from lilgym_mp.report.gathering import Curve, Gathered
from lilgym_mp.report.items import Chart, Item, Lacking

ITEM, TITLE = "Figure 4", "Learning curves"
# By learner, what its progress holds: what to draw, and what that is.
DRAWN: Mapping[str, tuple[str, str]] = {
    "ppo": ("accuracy", "success of training episodes"),
    "imitation": ("truth_accuracy", "truth of scenes told"),
    "parse-and-plan": ("loss", "loss of the parser"),
}


def learning_curves(found: Gathered) -> Item:
    """A panel a learner and configuration, a line a run."""
    panels: dict[tuple[str, str], list[Line]] = {}
    for curve in found.curves:
        if (line := _line(curve)) is not None:
            panels.setdefault((curve.learner, curve.configuration), []).append(line)
    if not panels:
        return Lacking(
            ITEM, TITLE, "no training run with progress is among the directories; name one beside the episodes"
        )
    drawn = [
        (f"{learner} {configuration}".strip(), "steps", DRAWN[learner][1], found_lines)
        for (learner, configuration), found_lines in panels.items()
    ]
    note = (
        "From the progress of training itself, on training tasks: the paper draws accuracy on dev, with the program"
        " reward and with the NLVR reward."
    )
    return Chart(ITEM, TITLE, lines(drawn), note)


def _line(curve: Curve) -> Line | None:
    key = DRAWN.get(curve.learner, ("accuracy", ""))[0]
    told = [line for line in curve.lines if line.get(key) is not None]
    points = [(line["step" if "step" in line else "steps"], line[key]) for line in told]
    return Line(curve.run.name, [x for x, _ in points], [y for _, y in points]) if points else None
