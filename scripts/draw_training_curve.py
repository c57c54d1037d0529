"""Draws the training curves of runs as an SVG: python scripts/draw_training_curve.py OUT.svg RUN [RUN ...]

Each run is a directory that `lilgym-mp train` or `demo` wrote; its line is the share of training episodes that were a
success, averaged over a few updates.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from lilgym_mp.plotting import new_figure, save

WIDTH, HEIGHT = 760, 380  # pixels
SMOOTHED_OVER = 5  # updates


class Curve(NamedTuple):
    name: str
    points: list[tuple[int, float]]  # steps, accuracy


def read_curve(run: Path) -> Curve:
    """The smoothed curve of a run. Raises OSError, ValueError, KeyError where there is none."""
    lines = [json.loads(line) for line in (run / "progress.jsonl").read_text().splitlines()]
    updates = [(line["steps"], line["accuracy"]) for line in lines if line["accuracy"] is not None]
    recipe = json.loads((run / "run.json").read_text())["identity"]["recipe"]
    return Curve(f"seed {recipe['seed']}", list(smoothed(updates, SMOOTHED_OVER)))


def smoothed(points: Sequence[tuple[int, float]], count: int) -> Sequence[tuple[int, float]]:
    """Each point with the mean of the last `count` values."""
    windows = [points[max(0, end - count) : end] for end in range(1, len(points) + 1)]
    return [(window[-1][0], sum(value for _, value in window) / len(window)) for window in windows]


def drawn(title: str, curves: Sequence[Curve]) -> Figure:
    """A line for each curve: shares against actions."""
    figure = new_figure(WIDTH, HEIGHT)
    axes = figure.subplots()
    axes.set_title(title, loc="left", fontweight="bold")
    for curve in curves:
        axes.plot(*zip(*curve.points, strict=True), label=curve.name)
    axes.set_ylim(0, 1)
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.xaxis.set_major_formatter("{x:,.0f}")
    axes.set_xlabel("actions")
    axes.grid(axis="y", color="#dddddd")
    figure.legend(loc="outside right upper", frameon=False)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--title", default="Share of training episodes that were a success")
    args = parser.parse_args()
    save(drawn(args.title, [read_curve(run) for run in args.runs]), args.out, "svg")


if __name__ == "__main__":
    main()
