"""Measurements as Markdown tables, also inserted into a document, as JSON, and as a chart of scaling."""

from __future__ import annotations

import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from lilgym_mp.benchmark.measuring import EFFORTS, Bench, Measurement
from lilgym_mp.envs.workers import usable_cores
from lilgym_mp.evaluation.recording_metadata import cpu_model
from lilgym_mp.evaluation.report import fold_long_blocks, markdown_table, software
from lilgym_mp.plotting import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMAT, VERSION = "lilgym_mp-benchmark", 1
BEGIN, END = "<!-- written by lilgym-mp bench: begin -->", "<!-- written by lilgym-mp bench: end -->"
LEGEND = (
    "Steps per second: median, minimum and maximum over the rounds. A step is one action (AEC: one agent's turn);"
    " resets are timed but do not count as steps. of copying: speed relative to copying as many environments' images"
    " (median of the ratios in each round); only cases that copy no images can exceed 1."
)
Columns = Mapping[str, Callable[[Measurement], float | None]]  # values by heading


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


def report_text(bench: Bench) -> str:
    """Everything as Markdown: conditions, then the tables of each configuration."""
    rates: Columns = {
        "median": lambda measured: measured.median,
        "lowest": lambda measured: min(measured.rates),
        "highest": lambda measured: max(measured.rates),
        "of copying": bench.ratio_to_copying,
    }
    durations: Columns = {
        "median": lambda measured: 1e6 / measured.median,
        "lowest": lambda measured: 1e6 / max(measured.rates),
        "highest": lambda measured: 1e6 / min(measured.rates),
    }
    parts = [conditions(bench), *bench.notes, LEGEND]
    for name in bench.configurations:
        mine = [measurement for measurement in bench.results if measurement.configuration == name]
        cases = [measurement for measurement in mine if not measurement.case.is_part]
        parts.append(f"### {name}\n\n{_table('steps per second', cases, rates)}")
        if components := [measurement for measurement in mine if measurement.case.is_part]:
            parts.append(_table("microseconds for one environment", components, durations))
    return "\n\n".join(parts)


def conditions(bench: Bench) -> str:
    """Date, machine, load and command of the measurements."""
    begin, end = bench.load_averages
    command = "lilgym-mp bench" + " --quick" * (bench.effort == EFFORTS["quick"])
    texts = [
        f"Measured {datetime.now(UTC):%Y-%m-%d %H:%M} UTC on {cpu_model()}, {usable_cores()} cores,"
        f" Python {platform.python_version()}; load average {begin:.1f} at the beginning and {end:.1f} at the end;"
        f" `{command}`, {bench.effort.repeats} rounds.",
    ]
    if bench.is_interrupted:
        texts.append("**Interrupted: not everything was measured.**")
    return " ".join(texts)


def _table(unit: str, measured: Sequence[Measurement], columns: Columns) -> str:
    rows = [(one.case.name, str(one.case.num_envs), *(_figure(of(one)) for of in columns.values())) for one in measured]
    return markdown_table([(unit, "envs", *columns), *rows])


def _figure(value: float | None) -> str:
    """Rounded to three significant digits, with thousands separators; "-" for None."""
    if value is None:
        return "-"
    digits = 2 if value < 10 else 1 if value < 100 else 0
    return f"{float(f'{value:.3g}'):,.{digits}f}"


def report_json(bench: Bench) -> dict[str, Any]:
    """All rounds of all cases, and what is needed to reproduce them."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": sys.argv,
        "software": software(),
        "processor": cpu_model(),
        "cores": usable_cores(),
        "load_averages": list(bench.load_averages),
        "effort": bench.effort._asdict(),
        "is_interrupted": bench.is_interrupted,
        "notes": bench.notes,
        "results": [
            {
                "configuration": measurement.configuration,
                "group": measurement.case.group,
                "name": measurement.case.name,
                "num_envs": measurement.case.num_envs,
                "unit": "calls/s" if measurement.case.is_part else "steps/s",
                "median": measurement.median,
                "rates": measurement.rates,
                "of_copying": bench.ratio_to_copying(measurement),
            }
            for measurement in bench.results
        ],
    }


def insert_tables(document: str, text: str) -> str:
    """The document with the text between the marks replaced. Raises ValueError if it has no marks."""
    before, begin, rest = document.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"no marks for the tables: it needs two lines, {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{fold_long_blocks(text)}\n\n{END}{after}"


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
