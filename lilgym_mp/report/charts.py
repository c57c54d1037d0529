"""Matplotlib charts in a common style: bars, lines, heat maps and film strips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

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


def series_colours(names: Sequence[str]) -> dict[str, str]:
    """Colours by name, assigned in order."""
    return {name: COLOURS[index % len(COLOURS)] for index, name in enumerate(names)}


def bar_chart(panels: Sequence[BarPanel], unit: str, *, columns: int = 2, top: float | None = None) -> Figure:
    """A grouped bar chart with error bars for each panel; each series has the same colour everywhere.

    Error bars are intervals, or the deviation over runs. Panels with the chart's unit share their y axis; `top`: its
    fixed upper limit.
    """
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    names = list(dict.fromkeys(name for panel in panels for name in panel.values))
    figure: Any = new_figure(WIDTH, PANEL_HEIGHT * rows + 40)
    grid: Any = figure.subplots(rows, columns, squeeze=False, sharey=not any(panel.unit for panel in panels))
    colours = series_colours(names)
    for index, axes in enumerate(grid.flat):
        if index >= len(panels):
            axes.set_visible(False)
            continue
        _draw_bars(axes, panels[index], colours, panels[index].unit or unit, top, WIDTH / columns)
    _legend(figure, grid.flat[0], names, colours)
    return figure


def _draw_bars(
    axes: Any, panel: BarPanel, colours: Mapping[str, str], unit: str, top: float | None, panel_width: float
) -> None:
    width = 0.8 / max(1, len(panel.values))
    labelled = 0.9 * panel_width * width / len(panel.categories) >= LABEL_WIDTH
    for series, (name, values) in enumerate(panel.values.items()):
        xs = [index + (series - (len(panel.values) - 1) / 2) * width for index in range(len(values))]
        heights = [_mean(value) for value in values]
        axes.bar(xs, heights, width * 0.92, color=colours[name])
        for x, value in zip(xs, values, strict=True):
            if isinstance(value, MeanStd):
                low, high = value.spread
                axes.errorbar(x, value.mean, [[value.mean - low], [high - value.mean]], color=INK, lw=1, capsize=2)
        for x, value in zip(xs, values, strict=True) if labelled else ():
            if value is not None:
                _label_bar(axes, x, value)
    style_axes(axes, panel.title, unit)
    axes.set_xticks(range(len(panel.categories)), labels=panel.categories, fontsize=8)
    axes.grid(visible=False, axis="x")
    axes.margins(y=0.12)
    if top is not None:
        axes.set_ylim(0, top)
    elif all(_mean(value) >= 0 for values in panel.values.values() for value in values):
        axes.set_ylim(bottom=0)


def _label_bar(axes: Any, x: float, value: MeanStd | float) -> None:
    """Prints the value at the end of the bar, clear of the error bar."""
    height = _mean(value)
    low, high = value.spread if isinstance(value, MeanStd) else (height, height)
    below = height < 0
    axes.annotate(
        _short_number(height),
        (x, low if below else high),
        (0, -2 if below else 2),
        textcoords="offset points",
        fontsize=7,
        color=INK,
        ha="center",
        va="top" if below else "bottom",
    )


def _mean(value: MeanStd | float | None) -> float:
    return value.mean if isinstance(value, MeanStd) else (value or 0.0)


def _short_number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 10 or value == 0 else f"{value:.1f}" if abs(value) >= 1 else f"{value:.2f}"


def style_axes(axes: Any, title: str, unit: str = "") -> None:
    axes.set_title(title, loc="left", fontsize=10, fontweight="bold", color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(FAINT)
    axes.tick_params(colors=INK, labelsize=8)
    axes.grid(axis="y", color="#e6eaee", linewidth=0.8)
    axes.set_axisbelow(True)
    if unit:
        axes.set_ylabel(unit, fontsize=8, color=FAINT)


def _legend(figure: Any, axes: Any, names: Sequence[str], colours: Mapping[str, str]) -> None:
    handles = [axes.bar([0], [0], color=colours[name]) for name in names]
    if len(names) > 1:
        figure.legend(handles, names, loc="outside upper left", ncols=_legend_columns(names), frameon=False, fontsize=8)


def _legend_columns(names: Sequence[str], width: int = WIDTH) -> int:
    """Number of legend columns, at most 4, that fit into the width in pixels."""
    return max(1, min(4, (width - 40) // (6 * max(map(len, names)) + 40)))


class Line(NamedTuple):
    """A series of a line chart."""

    name: str
    xs: Sequence[float]
    ys: Sequence[float]
    deviations: Sequence[float] | None = None  # drawn as a band around the line


def line_chart(panels: Sequence[tuple[str, str, str, Sequence[Line]]], *, diagonal: bool = False) -> Figure:
    """One panel per (title, x label, y label, lines); `diagonal` adds the line y = x and point markers."""
    columns = min(2 if len(panels) <= 4 else 3, len(panels))
    rows = -(-len(panels) // columns)
    width = WIDTH if columns > 1 else WIDTH // 2
    names = list(dict.fromkeys(line.name for _, _, _, lines in panels for line in lines))
    legend_rows = -(-len(names) // _legend_columns(names, width)) if len(names) > 1 else 0
    from matplotlib.ticker import EngFormatter

    figure: Any = new_figure(width, PANEL_HEIGHT * rows + LEGEND_ROW_HEIGHT * (legend_rows + 1))
    grid: Any = figure.subplots(rows, columns, squeeze=False, sharey=len({y_label for _, _, y_label, _ in panels}) == 1)
    colours = series_colours(names)
    for index, axes in enumerate(grid.flat):
        if index >= len(panels):
            axes.set_visible(False)
            continue
        title, x_label, y_label, lines = panels[index]
        style_axes(axes, title, y_label)
        axes.set_xlabel(x_label, fontsize=8, color=FAINT)
        for line in lines:
            axes.plot(line.xs, line.ys, color=colours[line.name], linewidth=1.6, marker="o" if diagonal else None)
            if line.deviations is not None:
                pairs = list(zip(line.ys, line.deviations, strict=True))
                low, high = [y - d for y, d in pairs], [y + d for y, d in pairs]
                axes.fill_between(line.xs, low, high, color=colours[line.name], alpha=0.15, linewidth=0)
        if diagonal:
            axes.plot([0, 1], [0, 1], color=FAINT, linewidth=0.8, linestyle="--")
        else:
            axes.xaxis.set_major_formatter(EngFormatter())
    if len(names) > 1:
        handles = [grid.flat[0].plot([], [], color=colours[name])[0] for name in names]
        legend_columns = _legend_columns(names, width)
        figure.legend(handles, names, loc="outside upper left", ncols=legend_columns, frameon=False, fontsize=8)
    return figure


def heat_maps(panels: Sequence[Sequence[tuple[str, Sequence[Sequence[float]]]]]) -> Figure:
    """Rows of titled heat maps, each with its own scale and colour bar."""
    figure: Any = new_figure(WIDTH, 125 * len(panels) + 20)
    grid: Any = figure.subplots(len(panels), max(map(len, panels)), squeeze=False)
    for row, row_panels in zip(grid, panels, strict=True):
        for axes, (title, values) in zip(row, row_panels, strict=True):
            top = max(map(max, values)) or 1.0  # matplotlib draws an empty range in the middle colour
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
