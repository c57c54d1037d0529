"""Matplotlib charts in a common style: bars, lines, heat maps and film strips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lilgym_mp.arrays import UInt8Array
from lilgym_mp.plotting import new_figure
from lilgym_mp.report.aggregation import MeanStd

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#1f4e9c", "#d9822b", "#2a8f6d", "#8e4fa8", "#c0392b", "#5b6770", "#b8a200", "#17a2b8", "#7f5539", "#e377c2")
INK, FAINT = "#1d2733", "#5b6770"
WIDTH = 1000  # pixels
PANEL_HEIGHT = 250
LEGEND_ROW_HEIGHT = 18
LABEL_WIDTH = 19  # pixels; values are printed on bars at least this wide
FRAMES_PER_ROW = 5
FRAME_WIDTH, FRAME_HEIGHT = 196, 74  # pixels


class BarPanel(NamedTuple):
    """Data of a grouped bar chart: a value for each series and category."""

    title: str
    categories: Sequence[str]
    values: Mapping[str, Sequence[MeanStd | float | None]]  # by series
    unit: str = ""  # label of the y axis, if not that of the whole chart


def bar_chart(panels: Sequence[BarPanel], unit: str, *, top: float | None = None) -> Figure:
    """A grouped bar chart with error bars for each panel; each series has the same colour everywhere.

    Error bars are intervals, or the deviation over runs. Panels with the chart's unit share their y axis; `top`: its
    fixed upper limit.
    """
    columns = min(2, len(panels))
    names = list(dict.fromkeys(name for panel in panels for name in panel.values))
    shared = not any(panel.unit for panel in panels)
    figure, grid, colours = _empty_panels(len(panels), columns, names, shared=shared)
    for axes, panel in zip(grid, panels, strict=True):
        style_axes(axes, panel.title, panel.unit or unit)
        _draw_bars(axes, panel, colours, WIDTH / columns)
        if top is not None:
            axes.set_ylim(0, top)
        elif not any(_mean(value) < 0 for values in panel.values.values() for value in values):
            axes.set_ylim(bottom=0)
    return figure


def _empty_panels(
    count: int, columns: int, names: Sequence[str], *, shared: bool, width: int = WIDTH
) -> tuple[Figure, list[Any], dict[str, str]]:
    """A figure with a legend, the axes of its panels, and the colour of each name."""
    from matplotlib.patches import Patch

    legend_columns = max(1, min(4, (width - 40) // (6 * max(map(len, names)) + 40)))
    legend_rows = -(-len(names) // legend_columns) if len(names) > 1 else 0
    rows = -(-count // columns)
    figure = new_figure(width, PANEL_HEIGHT * rows + LEGEND_ROW_HEIGHT * (legend_rows + 1))
    grid: Any = figure.subplots(rows, columns, squeeze=False, sharey=shared)
    for axes in grid.flat[count:]:
        axes.set_visible(False)
    colours = {name: COLOURS[index % len(COLOURS)] for index, name in enumerate(names)}
    if len(names) > 1:
        handles = [Patch(color=colour) for colour in colours.values()]
        figure.legend(handles, names, loc="outside upper left", ncols=legend_columns, frameon=False, fontsize=8)
    return figure, list(grid.flat[:count]), colours


def _draw_bars(axes: Any, panel: BarPanel, colours: Mapping[str, str], panel_width: float) -> None:
    width = 0.8 / max(1, len(panel.values))
    places = 0 if any(abs(_mean(value)) >= 10 for values in panel.values.values() for value in values) else 2
    for series, (name, values) in enumerate(panel.values.items()):
        xs = [index + (series - (len(panel.values) - 1) / 2) * width for index in range(len(values))]
        heights = [_mean(value) for value in values]
        ends = np.array([value.spread if isinstance(value, MeanStd) else (_mean(value),) * 2 for value in values]).T
        errors = np.maximum([heights - ends[0], ends[1] - heights], 0)
        bars = axes.bar(
            *(xs, heights, width * 0.92),
            color=colours[name],
            yerr=errors if np.nansum(errors) > 0 else None,
            error_kw={"ecolor": INK, "elinewidth": 1, "capsize": 2},
        )
        if 0.9 * panel_width * width / len(panel.categories) >= LABEL_WIDTH:
            axes.bar_label(bars, fmt=f"{{:.{places}f}}", fontsize=7, color=INK, padding=2)
    count = len(panel.categories)
    axes.set_xticks(range(count), labels=panel.categories, fontsize=8 if count < 8 else 6.5)
    axes.set_xlim(-0.5, count - 0.5)
    axes.margins(y=0.12)


def _mean(value: MeanStd | float | None) -> float:
    return value.mean if isinstance(value, MeanStd) else float("nan") if value is None else value


def style_axes(axes: Any, title: str, unit: str = "") -> None:
    axes.set_title(title, loc="left", fontsize=10, fontweight="bold", color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(FAINT)
    axes.tick_params(colors=INK, labelsize=8)
    axes.grid(axis="y", color="#e6eaee", linewidth=0.8)
    axes.set_axisbelow(True)
    if unit:
        axes.set_ylabel(unit, fontsize=8, color=FAINT)


class Line(NamedTuple):
    """A series of a line chart."""

    name: str
    xs: Sequence[float]
    ys: Sequence[float]
    deviations: Sequence[float] | None = None  # drawn as a band around the line


def line_chart(panels: Sequence[tuple[str, str, str, Sequence[Line]]], *, diagonal: bool = False) -> Figure:
    """One panel per (title, x label, y label, lines); `diagonal` adds the line y = x and point markers.

    Without it, the x axis counts steps: its ticks are whole numbers. A line of a single point is drawn as a marker.
    """
    from matplotlib.ticker import EngFormatter, MaxNLocator

    columns = min(2 if len(panels) <= 4 else 3, len(panels))
    names = list(dict.fromkeys(line.name for *_, lines in panels for line in lines))
    shared, width = len({panel[2] for panel in panels}) == 1, WIDTH if columns > 1 else WIDTH // 2
    figure, grid, colours = _empty_panels(len(panels), columns, names, shared=shared, width=width)
    for axes, (title, x_label, y_label, lines) in zip(grid, panels, strict=True):
        style_axes(axes, title, y_label)
        axes.set_xlabel(x_label, fontsize=8, color=FAINT)
        for line in lines:
            marker = "o" if diagonal or len(line.xs) == 1 else None
            axes.plot(line.xs, line.ys, color=colours[line.name], linewidth=1.6, marker=marker)
            if line.deviations is not None:
                band = np.subtract(line.ys, line.deviations), np.add(line.ys, line.deviations)
                axes.fill_between(line.xs, *band, color=colours[line.name], alpha=0.15, linewidth=0)
        if diagonal:
            axes.plot([0, 1], [0, 1], color=FAINT, linewidth=0.8, linestyle="--")
        else:
            axes.xaxis.set_major_locator(MaxNLocator("auto", integer=True, min_n_ticks=1, steps=[1, 2, 2.5, 5, 10]))
            axes.xaxis.set_major_formatter(EngFormatter())
    return figure


def heat_maps(panels: Sequence[Sequence[tuple[str, np.ndarray]]]) -> Figure:
    """Rows of titled heat maps, each with its own scale and colour bar."""
    figure: Any = new_figure(WIDTH, 125 * len(panels) + 20)
    grid: Any = figure.subplots(len(panels), max(map(len, panels)), squeeze=False)
    for row, row_panels in zip(grid, panels, strict=True):
        for axes, (title, values) in zip(row, row_panels, strict=True):
            top = values.max() or 1.0  # matplotlib draws an empty range in the middle colour
            image = axes.imshow(values, cmap="Blues", vmin=0, vmax=top, aspect="equal")
            axes.set_title(title, loc="left", fontsize=8, color=INK)
            axes.set_xticks([])
            axes.set_yticks([])
            bar = figure.colorbar(image, ax=axes, fraction=0.015, pad=0.02)
            bar.ax.tick_params(labelsize=6)
            bar.outline.set_visible(False)
    return figure


class FilmStrip(NamedTuple):
    """An episode as a sequence of scene images, each captioned with the action that led to it."""

    head: Sequence[str]  # lines of text above the frames
    frames: Sequence[tuple[UInt8Array, str]]  # image, caption
    success: bool | None = None  # colours the last frame; None: not coloured


def film_strips(strips: Sequence[FilmStrip]) -> Figure:
    """Film strips one below the other, at most FRAMES_PER_ROW frames in a row."""
    rows = [max(1, -(-len(strip.frames) // FRAMES_PER_ROW)) for strip in strips]
    heights = [14 * len(s.head) + 20 + count * FRAME_HEIGHT for s, count in zip(strips, rows, strict=True)]
    figure: Any = new_figure(WIDTH, sum(heights))
    figure.set_layout_engine("none")
    top = sum(heights)
    total = top
    for strip, height in zip(strips, heights, strict=True):
        _draw_strip(figure, strip, top, total)
        top -= height
    return figure


def _draw_strip(figure: Any, strip: FilmStrip, top: float, total: float) -> None:
    for index, text in enumerate(strip.head):
        weight, colour = ("bold", INK) if index == 0 else ("normal", "#4b5866")
        y = (top - 14 - 14 * index) / total
        figure.text(10 / WIDTH, y, text, fontsize=8, fontweight=weight, color=colour, parse_math=False)
    head = 14 * len(strip.head) + 6
    last = len(strip.frames) - 1
    for index, (image, caption) in enumerate(strip.frames):
        row, column = divmod(index, FRAMES_PER_ROW)
        left = 10 + column * FRAME_WIDTH
        bottom = top - head - (row + 1) * FRAME_HEIGHT + 4
        axes = figure.add_axes((left / WIDTH, bottom / total, (FRAME_WIDTH - 6) / WIDTH, (FRAME_HEIGHT - 24) / total))
        axes.imshow(image, interpolation="nearest", aspect="auto")
        axes.set_xticks([])
        axes.set_yticks([])
        judged = index == last and strip.success is not None
        edge = FAINT if not judged else "#2a8f6d" if strip.success else "#c0392b"
        for spine in axes.spines.values():
            spine.set_color(edge)
            spine.set_linewidth(2 if judged else 0.6)
        axes.set_title(caption, loc="left", fontsize=6.5, color=INK if not judged else edge, pad=2, parse_math=False)
