"""Draws the training curves of runs as an SVG: python scripts/draw_training_curve.py OUT.svg RUN [RUN ...]

Each run is a directory that `lilgym-mp train` or `demo` wrote; its line is the share of training episodes that were a
success, averaged over a few updates.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

WIDTH, HEIGHT = 760, 380  # pixels
LEFT, RIGHT, TOP, BOTTOM = 60, 150, 40, 50  # margins
COLOURS = ("#1f4e9c", "#c04f15", "#2f7d32", "#7b3fa0", "#a07800")
SMOOTHED_OVER = 5  # updates
FONT = 'font-family="Helvetica, Arial, sans-serif" font-size="13"'


class Curve(NamedTuple):
    name: str
    points: list[tuple[int, float]]  # steps, accuracy


def read_curve(run: Path) -> Curve:
    """The smoothed curve of a run. Raises OSError, ValueError, KeyError where there is none."""
    lines = [json.loads(line) for line in (run / "progress.jsonl").read_text().splitlines()]
    updates = [(line["steps"], line["accuracy"]) for line in lines if line["accuracy"] is not None]
    recipe = json.loads((run / "run.json").read_text())["recipe"]
    return Curve(f"seed {recipe['seed']}", list(smoothed(updates, SMOOTHED_OVER)))


def smoothed(points: Sequence[tuple[int, float]], count: int) -> Sequence[tuple[int, float]]:
    """Each point with the mean of the last `count` values."""
    windows = [points[max(0, end - count) : end] for end in range(1, len(points) + 1)]
    return [(window[-1][0], sum(value for _, value in window) / len(window)) for window in windows]


def drawn(title: str, curves: Sequence[Curve]) -> str:
    """An SVG document."""
    last = max(steps for curve in curves for steps, _ in curve.points)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" {FONT}>',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        f'<text x="{LEFT}" y="24" font-weight="bold">{escape(title)}</text>',
    ]
    for tenth in range(0, 11, 2):
        y = _y(tenth / 10)
        parts.append(f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="#dddddd"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{10 * tenth} %</text>')
    for quarter in range(5):
        steps = last * quarter // 4
        x = _x(steps, last)
        parts.append(f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 20}" text-anchor="middle">{steps:,}</text>')
    parts.append(f'<text x="{_x(last // 2, last):.1f}" y="{HEIGHT - 10}" text-anchor="middle">actions</text>')
    for number, curve in enumerate(curves):
        colour = COLOURS[number % len(COLOURS)]
        path = " ".join(f"{_x(steps, last):.1f},{_y(value):.1f}" for steps, value in curve.points)
        parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        parts.append(
            f'<text x="{WIDTH - RIGHT + 12}" y="{TOP + 20 * number + 12}" fill="{colour}">{escape(curve.name)}</text>'
        )
    return "\n".join([*parts, "</svg>", ""])


def _x(steps: int, last: int) -> float:
    return LEFT + (WIDTH - LEFT - RIGHT) * steps / last


def _y(share: float) -> float:
    return TOP + (HEIGHT - TOP - BOTTOM) * (1 - share)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--title", default="Share of training episodes that were a success")
    args = parser.parse_args()
    args.out.write_text(drawn(args.title, [read_curve(run) for run in args.runs]))


if __name__ == "__main__":
    main()
