"""How each way of running the environments scales: steps per second against environments, both in powers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from math import ceil, floor, log2, log10
from typing import NamedTuple

from PIL import Image, ImageDraw, ImageFont

from lilgym_mp.benchmark.measuring import Bench

Point = tuple[float, float]

PANEL_WIDTH, PANEL_HEIGHT = 760, 560  # pixels, each configuration's
LEFT, RIGHT, TOP, BOTTOM = 90, 30, 60, 60
LEGEND_HEIGHT = 90
PAPER, INK, RULE = "#ffffff", "#222222", "#d5d5d5"
DOT = 6
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
SINGLE = "single"  # drawn as the first point of the batch's line


class Axes(NamedTuple):
    """Where a number of environments and a rate lie in a panel."""

    left: float  # of the panel
    most_envs: int
    low: int  # powers of ten
    high: int

    def x(self, envs: float) -> float:
        return self.left + LEFT + (PANEL_WIDTH - LEFT - RIGHT) * log2(envs) / max(1.0, log2(self.most_envs))

    def y(self, rate: float) -> float:
        share = (log10(rate) - self.low) / (self.high - self.low)
        return PANEL_HEIGHT - BOTTOM - (PANEL_HEIGHT - TOP - BOTTOM) * share


def scaling_chart(bench: Bench) -> Image.Image | None:
    """A panel for each configuration, a line for each way; None where nothing was measured that scales."""
    panels = {name: lines for name in bench.configurations if (lines := _lines(bench, name))}
    if not panels:
        return None
    image = Image.new("RGB", (PANEL_WIDTH * len(panels), PANEL_HEIGHT + LEGEND_HEIGHT), PAPER)
    pen = ImageDraw.Draw(image)
    rates = [rate for lines in panels.values() for points in lines.values() for _, rate in points]
    most = max(int(envs) for lines in panels.values() for points in lines.values() for envs, _ in points)
    low, high = floor(log10(min(rates))), ceil(log10(max(rates)))
    for number, (name, lines) in enumerate(panels.items()):
        axes = Axes(number * PANEL_WIDTH, most, low, max(high, low + 1))
        _draw_frame(pen, axes, name)
        for label, points in lines.items():
            _draw_line(pen, axes, points, COLOURS[label])
    _draw_legend(pen, [label for label in COLOURS if any(label in lines for lines in panels.values())], image.width)
    return image


def _lines(bench: Bench, configuration: str) -> dict[str, list[Point]]:
    """The points of each way that was measured with several numbers of environments."""
    found: dict[str, list[Point]] = {}
    for label in COLOURS:
        points = sorted(
            (float(one.subject.num_envs), one.median)
            for one in bench.results
            if one.configuration == configuration and one.subject.name == label
        )
        if label == "batched" and points and (single := bench.find(configuration, SINGLE, 1)):
            points.insert(0, (1.0, single.median))
        if points:
            found[label] = points
    return found if any(len(points) > 1 for points in found.values()) else {}


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def _draw_frame(pen: ImageDraw.ImageDraw, axes: Axes, title: str) -> None:
    small = _font(16)
    pen.text((axes.left + LEFT, 18), f"{title}: steps per second", fill=INK, font=_font(22))
    for power in range(axes.low, axes.high + 1):
        for part in (1, 2, 5) if power < axes.high else (1,):
            y = axes.y(part * 10**power)
            pen.line([(axes.x(1), y), (axes.x(axes.most_envs), y)], fill=RULE, width=2 if part == 1 else 1)
            if part == 1:
                pen.text((axes.left + LEFT - 10, y), f"{10**power:,}", fill=INK, font=small, anchor="rm")
    for envs in _powers(axes.most_envs):
        x = axes.x(envs)
        pen.line([(x, axes.y(10**axes.low)), (x, axes.y(10**axes.high))], fill=RULE)
        pen.text((x, PANEL_HEIGHT - BOTTOM + 8), str(envs), fill=INK, font=small, anchor="mt")
    middle = (axes.x(1) + axes.x(axes.most_envs)) / 2
    pen.text((middle, PANEL_HEIGHT - 8), "environments", fill=INK, font=small, anchor="mb")


def _powers(most: int) -> Iterator[int]:
    count = 1
    while count <= most:
        yield count
        count *= 2


def _draw_line(pen: ImageDraw.ImageDraw, axes: Axes, points: Sequence[Point], colour: str) -> None:
    places = [(axes.x(envs), axes.y(rate)) for envs, rate in points]
    for pair in pairwise(places):
        pen.line(list(pair), fill=colour, width=4)
    for x, y in places:
        pen.ellipse((x - DOT, y - DOT, x + DOT, y + DOT), fill=colour)


def _draw_legend(pen: ImageDraw.ImageDraw, labels: Sequence[str], image_width: int) -> None:
    font = _font(17)
    x, y = float(LEFT), float(PANEL_HEIGHT + 12)
    for label in labels:
        width = 34 + pen.textlength(label, font=font) + 26
        if x + width > image_width and x > LEFT:
            x, y = float(LEFT), y + 26
        pen.line([(x, y + 10), (x + 26, y + 10)], fill=COLOURS[label], width=5)
        pen.text((x + 34, y), label, fill=INK, font=font)
        x += width
