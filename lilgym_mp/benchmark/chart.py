"""Chart of scaling: steps per second by number of environments, on logarithmic axes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from lilgym_mp.benchmark.measuring import Bench
from lilgym_mp.plotting import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Point = tuple[float, float]

PANEL_WIDTH, PANEL_HEIGHT = 490, 360  # pixels of a configuration's panel
COLUMNS = 2
LEGEND_HEIGHT = 80
COLOURS: Mapping[str, str] = {
    "memory copy": "#9a9a9a",
    "batched, no copy": "#0b3c8c",
    "batched": "#3f7fd9",
    "workers, 2 processes, no copy": "#0a6b4a",
    "workers, 2 processes": "#3cb58a",
    "SB3, batched": "#b3560a",
    "SB3, workers": "#e3953a",
    "SB3, dummy": "#8c3a86",
    "SB3, subproc": "#c0272d",
}
SINGLE = "single"  # the first point of the line "batched"


def scaling_chart(bench: Bench) -> Figure | None:
    """A panel per configuration, a line per case; None if no case was measured with several numbers of environments.

    Raises ImportError without matplotlib.
    """
    panels = {name: lines for name in bench.configurations if (lines := _lines(bench, name))}
    if not panels:
        return None
    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = new_figure(PANEL_WIDTH * COLUMNS, PANEL_HEIGHT * rows + LEGEND_HEIGHT)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat
    labels: dict[str, Any] = {}
    for (name, lines), axes in zip(panels.items(), grid, strict=False):
        axes.set_title(f"{name}: steps per second", loc="left")
        axes.set_xscale("log", base=2)
        axes.set_yscale("log")
        axes.xaxis.set_major_formatter("{x:.0f}")
        axes.yaxis.set_major_formatter("{x:,.0f}")
        axes.tick_params(labelleft=True, labelbottom=True)
        axes.set_xlabel("environments")
        axes.grid(color="#d5d5d5")
        for label, points in lines.items():
            style = {"color": COLOURS[label], "linewidth": 2, "markersize": 4}
            (labels[label],) = axes.plot(*zip(*points, strict=True), "o-", **style)
    for axes in grid:  # unused panels of the last row
        figure.delaxes(axes)
    figure.legend(labels.values(), labels.keys(), loc="outside lower left", ncols=4, frameon=False)
    return figure


def _lines(bench: Bench, configuration: str) -> dict[str, list[Point]]:
    """Points by case; empty if none was measured with several numbers of environments."""
    found: dict[str, list[Point]] = {}
    for label in COLOURS:
        points = sorted(
            (float(measurement.case.num_envs), measurement.median)
            for measurement in bench.results
            if measurement.configuration == configuration and measurement.case.name == label
        )
        if label == "batched" and points and (single := bench.find(configuration, SINGLE, 1)):
            points.insert(0, (1.0, single.median))
        if points:
            found[label] = points
    return found if any(len(points) > 1 for points in found.values()) else {}
