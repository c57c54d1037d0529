"""Charts in a common style: bars, lines and film strips. Imports matplotlib when it draws the first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lilgym_mp.contrib.report.aggregation import MeanStd
from lilgym_mp.scene.arrays import Float64Array, UInt8Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE = "#0072b2"
ORANGE = "#e69f00"
GREEN = "#009e73"
VERMILION = "#d55e00"
# The first six also differ when the page inverts them for a dark screen.
OKABE_ITO = (BLUE, ORANGE, GREEN, "#cc79a7", "#000000", "#f0e442", VERMILION, "#56b4e9")
HATCHES = ("", "//", "\\\\", "xx", "--", "++", "||")  # for prints in grey
DASHES = ("-", "--", "-.", ":")
INK = "#1d2733"
FAINT = "#5b6770"
WIDTH = 1000  # pixels
PANEL_HEIGHT = 250
MAP_HEIGHT = 240
LEGEND_ROW_HEIGHT = 18
LABEL_WIDTH = 19  # pixels; values are printed on bars at least this wide
LABELLED_LINES = 5  # at most so many lines of a panel are named at their ends
LABEL_CHARACTERS = 19
# Pixels
LABEL_LINE = 13
AXES_HEIGHT = 185
FRAMES_PER_ROW = 5
# Pixels
HEAD_HEIGHT = 52
FRAME_HEIGHT = 74
DPI = 100
SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none",  # text as text
    "svg.hashsalt": "lilgym_mp",  # reproducible ids
    "pdf.fonttype": 42,  # TrueType, as publishers require
    "hatch.linewidth": 0.6,
}
UNDATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def new_figure(width: float, height: float) -> Figure:
    """An empty figure; width and height in pixels."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width / DPI, height / DPI), dpi=DPI, layout="constrained")


def save(figure: Figure, path: Path, file_format: str) -> None:
    """Writes the figure as "svg", "png" or "pdf", reproducibly: without a date."""
    from matplotlib import rc_context

    with rc_context(SETTINGS):
        figure.savefig(path, format=file_format, metadata=UNDATED.get(file_format))


class Looks(dict[str, tuple[str, str]]):
    """Colour and hatch of each series by name, chosen when it is first used: one map for all charts of a report."""

    def __missing__(self, name: str) -> tuple[str, str]:
        index = len(self)
        self[name] = OKABE_ITO[index % len(OKABE_ITO)], HATCHES[index % len(HATCHES)]
        return self[name]


class BarPanel(NamedTuple):
    """Data of a grouped bar chart: a value for each series and category."""

    title: str
    categories: Sequence[str]
    values: Mapping[str, Sequence[MeanStd | None]]  # by series
    unit: str = ""  # label of the y axis, if not that of the whole chart


def bar_chart(panels: Sequence[BarPanel], unit: str, looks: Looks, *, top: float | None = None) -> Figure:
    """A grouped bar chart with error bars for each panel; series without a value in a category take no room there.

    Error bars are intervals. Panels with the chart's unit share their y axis; `top`: its
    fixed upper limit.
    """
    from matplotlib.patches import Patch

    columns = min(2, len(panels))
    shown = {name: looks[name] for panel in panels for name in panel.values}
    legend = {
        name: Patch(facecolor=colour, hatch=hatch, edgecolor="white", linewidth=0)
        for name, (colour, hatch) in looks.items()
        if name in shown
    }
    figure, grid = _empty_panels(len(panels), columns, legend, shared=not any(panel.unit for panel in panels))
    for axes, panel in zip(grid, panels, strict=True):
        style_axes(axes, panel.title, panel.unit or unit)
        _draw_bars(axes, panel, looks, WIDTH / columns)
    for axes, panel in zip(grid, panels, strict=True):  # after all are drawn, as they may share their limits
        if top is not None or all(value.mean >= 0 for value in _values(panel)):
            axes.set_ylim(0, top)
    return figure


def _empty_panels(
    count: int,
    columns: int,
    legend: Mapping[str, Any],
    *,
    shared: bool,
    width: int = WIDTH,
    height: int = PANEL_HEIGHT,
) -> tuple[Figure, list[Any]]:
    """A figure with a legend of these artists, and the axes of its panels."""
    legend_columns = max(1, min(4, (width - 40) // (6 * max(map(len, legend), default=0) + 40)))
    legend_rows = -(-len(legend) // legend_columns)
    rows = -(-count // columns)
    figure = new_figure(width, height * rows + LEGEND_ROW_HEIGHT * (legend_rows + 1))
    grid: Any = figure.subplots(rows, columns, squeeze=False, sharey=shared)
    for axes in grid.flat[count:]:
        axes.set_visible(False)
    if legend:
        figure.legend(
            legend.values(), legend, loc="outside upper left", ncols=legend_columns, frameon=False, fontsize=8
        )
    return figure, list(grid.flat[:count])


def _draw_bars(axes: Any, panel: BarPanel, looks: Looks, panel_width: float) -> None:
    places = 0 if any(abs(value.mean) >= 10 for value in _values(panel)) else 2
    count = len(panel.categories)
    shown = [  # names by category
        [name for name, values in panel.values.items() if values[index] is not None] for index in range(count)
    ]
    width = 0.8 / max(1, *map(len, shown))
    for name, series in panel.values.items():
        values = {index: value for index, value in enumerate(series) if value is not None}
        if not values:
            continue
        xs = [index + (shown[index].index(name) - (len(shown[index]) - 1) / 2) * width for index in values]
        heights, lows, highs = np.array([(each.mean, each.low, each.high) for each in values.values()], float).T
        errors = np.maximum([heights - lows, highs - heights], 0)
        bars = axes.bar(
            *(xs, heights, width * 0.92),
            color=looks[name][0],
            hatch=looks[name][1],
            edgecolor="white",
            linewidth=0,
            yerr=errors if errors.any() else None,
            error_kw={"ecolor": INK, "elinewidth": 1, "capsize": 2},
        )
        if 0.9 * panel_width * width / count >= LABEL_WIDTH:
            axes.bar_label(
                bars, fmt=lambda value: f"{value:.{places}f}".replace("-", "−"), fontsize=7, color=INK, padding=2
            )
    axes.set_xticks(range(count), labels=panel.categories, fontsize=8 if count < 8 else 6.5)
    axes.set_xlim(-0.5, count - 0.5)
    axes.margins(y=0.12)


def _values(panel: BarPanel) -> list[MeanStd]:
    return [value for values in panel.values.values() for value in values if value is not None]


def style_axes(axes: Any, title: str, unit: str = "") -> None:
    """Gives axes the report's look: title at the left, two spines, grey horizontal grid lines."""
    axes.set_title(title, loc="left", fontsize=10, fontweight="bold", color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(FAINT)
    axes.tick_params(colors=INK, labelsize=8)
    axes.grid(axis="y", color="#e6eaee", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.set_ylabel(unit, fontsize=8, color=FAINT)


def heat_maps(maps: Mapping[str, Float64Array], unit: str) -> Figure:
    """A panel for each array (rows, columns) of shares by its title, two in a line; one scale, of square roots."""
    from matplotlib.colors import PowerNorm
    from matplotlib.ticker import MaxNLocator

    figure, grid = _empty_panels(len(maps), min(2, len(maps)), {}, shared=False, height=MAP_HEIGHT)
    scale = PowerNorm(0.5, 0, max(map(np.max, maps.values())))
    for axes, (title, shares) in zip(grid, maps.items(), strict=True):
        style_axes(axes, title, "row")
        axes.set_xlabel("column", fontsize=8, color=FAINT)
        axes.grid(visible=False)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        image = axes.imshow(shares, cmap="Greys", norm=scale, interpolation="none")
    bar = figure.colorbar(image, ax=grid, location="bottom", shrink=0.4)
    bar.set_label(unit, fontsize=8, color=FAINT)
    bar.ax.tick_params(labelsize=8)
    return figure


class Line(NamedTuple):
    """A series of a line chart."""

    name: str
    xs: Sequence[float]
    ys: Sequence[float]
    deviations: Sequence[float] | None = None  # drawn as a band around the line
    agent: str | None = None  # whose colour it has; None: its own


def line_chart(
    panels: Sequence[tuple[str, str, str, Sequence[Line]]], looks: Looks, *, diagonal: bool = False
) -> Figure:
    """One panel per (title, x label, y label, lines); `diagonal` adds the line y = x and point markers.

    Without it, the x axis counts steps: its ticks are whole numbers. A line of a single point is drawn as a marker.
    Several lines of an agent differ in their dashes. Where few share a panel, they are named
    at their ends, otherwise in a legend.
    """
    from matplotlib.lines import Line2D
    from matplotlib.ticker import EngFormatter, MaxNLocator

    columns = min(2 if len(panels) <= 4 else 3, len(panels))
    legend: dict[str, Line2D] = {}
    for line in (line for *_, lines in panels for line in lines if line.name not in legend):
        colour, _ = looks[line.agent or line.name]
        dash = DASHES[[drawn.get_color() for drawn in legend.values()].count(colour) % len(DASHES)]
        legend[line.name] = Line2D([], [], color=colour, linestyle=dash, linewidth=1.6)
    shared = len({panel[2] for panel in panels}) == 1
    width = WIDTH if columns > 1 else WIDTH // 2
    named = not diagonal and all(len(lines) <= LABELLED_LINES for *_, lines in panels)
    figure, grid = _empty_panels(len(panels), columns, {} if named else legend, shared=shared, width=width)
    for axes, (title, x_label, y_label, lines) in zip(grid, panels, strict=True):
        style_axes(axes, title, y_label)
        axes.set_xlabel(x_label, fontsize=8, color=FAINT)
        for line in lines:
            marker = "o" if diagonal or len(line.xs) == 1 else None
            drawn = legend[line.name]
            colour = drawn.get_color()
            axes.plot(line.xs, line.ys, color=colour, linestyle=drawn.get_linestyle(), linewidth=1.6, marker=marker)
            if line.deviations is not None:
                band = np.subtract(line.ys, line.deviations), np.add(line.ys, line.deviations)
                axes.fill_between(line.xs, *band, color=colour, alpha=0.15, linewidth=0)
        if diagonal:
            axes.plot([0, 1], [0, 1], color=FAINT, linewidth=0.8, linestyle="--")
            axes.text(0.3, 0.22, "calibrated", color=FAINT, fontsize=7)
        else:
            axes.xaxis.set_major_locator(MaxNLocator("auto", integer=True, min_n_ticks=1, steps=[1, 2, 2.5, 5, 10]))
            axes.xaxis.set_major_formatter(EngFormatter())
    if named:
        for axes, (*_, lines) in zip(grid, panels, strict=True):  # after all are drawn, as they may share their limits
            _name_at_the_end(axes, lines, legend)
    return figure


def _name_at_the_end(axes: Any, lines: Sequence[Line], drawn: Mapping[str, Any]) -> None:
    """Names of lines right of the axes, each as high as its line ends, or just above the name below."""
    end, high = axes.get_ylim()
    text_line = LABEL_LINE * (high - end) / AXES_HEIGHT
    for line in sorted(lines, key=lambda line: line.ys[-1]):
        words = wrap(line.name, LABEL_CHARACTERS)
        half = len(words) * text_line / 2
        middle = max(line.ys[-1], end + half)
        end = middle + half
        place = {"xy": (1, middle), "xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
        shown = drawn[line.name]
        sample = {"arrowstyle": "-", "linewidth": 1.6, "color": shown.get_color(), "linestyle": shown.get_linestyle()}
        axes.annotate("", xytext=(18, 0), arrowprops=sample, **place)
        axes.annotate("\n".join(words), xytext=(20, 0), va="center", fontsize=7, color=INK, **place)


def film_strips(strips: Sequence[tuple[str, Sequence[tuple[UInt8Array, str]]]]) -> Figure:
    """Episodes one below the other: text, then images with captions, FRAMES_PER_ROW in a row, the last one marked."""
    rows = [-(-len(frames) // FRAMES_PER_ROW) for _, frames in strips]
    heights = [HEAD_HEIGHT + FRAME_HEIGHT * count for count in rows]
    figure: Any = new_figure(WIDTH, sum(heights))
    parts = figure.subfigures(len(strips), 1, squeeze=False, height_ratios=heights)[:, 0]
    for part, (head, frames), count in zip(parts, strips, rows, strict=True):
        part.suptitle(head, x=0.01, ha="left", fontsize=8, color=INK, parse_math=False)
        grid = list(part.subplots(count, FRAMES_PER_ROW, squeeze=False).flat)
        for axes, (image, caption) in zip(grid, frames, strict=False):
            axes.imshow(image, interpolation="nearest")
            axes.set(xticks=[], yticks=[])
            axes.set_title(caption, loc="left", fontsize=6.5, color=INK, pad=2, parse_math=False)
            axes.spines[:].set_color(FAINT)
        grid[len(frames) - 1].spines[:].set(color=VERMILION, linewidth=2)
        for axes in grid[len(frames) :]:
            axes.set_visible(False)
    return figure
