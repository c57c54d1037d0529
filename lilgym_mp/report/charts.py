"""Charts in one style, by matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from lilgym_mp.arrays import UInt8Array
from lilgym_mp.plotting import new_figure
from lilgym_mp.report.aggregation import Spread

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#1f4e9c", "#d9822b", "#2a8f6d", "#8e4fa8", "#c0392b", "#5b6770", "#b8a200", "#17a2b8", "#7f5539", "#e377c2")
INK, FAINT = "#1d2733", "#8793a1"
WIDTH = 1000  # pixels
PANEL_HEIGHT = 250
LEGEND_ROW_HEIGHT = 18
MOST_LABELLED = 24  # bars in a panel that still have their value beside them
FRAMES_A_ROW = 5
FRAME_WIDTH, FRAME_HEIGHT = 196, 74  # pixels


class Panel(NamedTuple):
    """Bars of one chart: a value for each category and series."""

    title: str
    categories: Sequence[str]
    values: Mapping[str, Sequence[Spread | float | None]]  # by series


def colour_of(names: Sequence[str]) -> dict[str, str]:
    """A colour for each name, in their order."""
    return {name: COLOURS[index % len(COLOURS)] for index, name in enumerate(names)}


def bars(panels: Sequence[Panel], unit: str, *, columns: int = 2, top: float | None = None) -> Figure:
    """Upright bars with their deviations, a panel each; one colour a series throughout."""
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    names = list(dict.fromkeys(name for panel in panels for name in panel.values))
    figure: Any = new_figure(WIDTH, PANEL_HEIGHT * rows + 40)
    grid: Any = figure.subplots(rows, columns, squeeze=False)
    colours = colour_of(names)
    for index, axes in enumerate(grid.flat):
        if index >= len(panels):
            axes.set_visible(False)
            continue
        _draw_bars(axes, panels[index], colours, unit, top)
    _legend(figure, grid.flat[0], names, colours)
    return figure


def _draw_bars(axes: Any, panel: Panel, colours: Mapping[str, str], unit: str, top: float | None) -> None:
    width = 0.8 / max(1, len(panel.values))
    labelled = len(panel.values) * len(panel.categories) <= MOST_LABELLED
    for place, (name, values) in enumerate(panel.values.items()):
        xs = [index + (place - (len(panel.values) - 1) / 2) * width for index in range(len(values))]
        heights = [_mean(value) for value in values]
        axes.bar(xs, heights, width * 0.92, color=colours[name])
        for x, value in zip(xs, values, strict=True):
            if isinstance(value, Spread) and value.deviation:
                axes.errorbar(x, value.mean, value.deviation, color=INK, linewidth=1, capsize=2)
        for x, value in zip(xs, values, strict=True) if labelled else ():
            if value is not None:
                _label(axes, x, value)
    style(axes, panel.title, unit)
    axes.set_xticks(range(len(panel.categories)), labels=panel.categories, fontsize=8)
    axes.grid(visible=False, axis="x")
    axes.margins(y=0.12)
    if top is not None:
        axes.set_ylim(0, top)
    elif all(_mean(value) >= 0 for values in panel.values.values() for value in values):
        axes.set_ylim(bottom=0)


def _label(axes: Any, x: float, value: Spread | float) -> None:
    """A bar's value at its end, clear of the deviation."""
    height, deviation = _mean(value), (value.deviation or 0.0) if isinstance(value, Spread) else 0.0
    below = height < 0
    axes.annotate(
        _short(height),
        (x, height - deviation if below else height + deviation),
        (0, -2 if below else 2),
        textcoords="offset points",
        fontsize=7,
        color=INK,
        ha="center",
        va="top" if below else "bottom",
    )


def _mean(value: Spread | float | None) -> float:
    return value.mean if isinstance(value, Spread) else (value or 0.0)


def _short(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 10 or value == 0 else f"{value:.1f}" if abs(value) >= 1 else f"{value:.2f}"


def style(axes: Any, title: str, unit: str = "") -> None:
    """The look that all charts share."""
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
        figure.legend(handles, names, loc="outside upper left", ncols=_columns(names), frameon=False, fontsize=8)


def _columns(names: Sequence[str], width: int = WIDTH) -> int:
    """Columns of a legend: as many of its longest name as the width in pixels holds."""
    return max(1, min(4, (width - 40) // (6 * max(map(len, names)) + 40)))


class Line(NamedTuple):
    """Points joined by a line."""

    name: str
    xs: Sequence[float]
    ys: Sequence[float]
    deviations: Sequence[float] | None = None  # drawn as a band around the line


def lines(panels: Sequence[tuple[str, str, str, Sequence[Line]]], *, diagonal: bool = False) -> Figure:
    """A panel for each title, name of x, name of y and lines; `diagonal`: from 0 to 1 on both axes, with y = x."""
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    width = WIDTH if columns > 1 else WIDTH // 2
    names = list(dict.fromkeys(line.name for _, _, _, found in panels for line in found))
    legend_rows = -(-len(names) // _columns(names, width)) if len(names) > 1 else 0
    figure: Any = new_figure(width, PANEL_HEIGHT * rows + LEGEND_ROW_HEIGHT * (legend_rows + 1))
    grid: Any = figure.subplots(rows, columns, squeeze=False)
    colours = colour_of(names)
    for index, axes in enumerate(grid.flat):
        if index >= len(panels):
            axes.set_visible(False)
            continue
        title, of_x, of_y, found = panels[index]
        style(axes, title, of_y)
        axes.set_xlabel(of_x, fontsize=8, color=FAINT)
        for line in found:
            axes.plot(line.xs, line.ys, color=colours[line.name], linewidth=1.6, marker="o" if diagonal else None)
            if line.deviations is not None:
                pairs = list(zip(line.ys, line.deviations, strict=True))
                low, high = [y - d for y, d in pairs], [y + d for y, d in pairs]
                axes.fill_between(line.xs, low, high, color=colours[line.name], alpha=0.15, linewidth=0)
        if diagonal:
            axes.plot([0, 1], [0, 1], color=FAINT, linewidth=0.8, linestyle="--")
    if len(names) > 1:
        handles = [grid.flat[0].plot([], [], color=colours[name])[0] for name in names]
        columns_shown = _columns(names, width)
        figure.legend(handles, names, loc="outside upper left", ncols=columns_shown, frameon=False, fontsize=8)
    return figure


def maps(panels: Sequence[Sequence[tuple[str, Sequence[Sequence[float]]]]]) -> Figure:
    """Maps of cells in rows of panels, each with its title; each on a scale of its own, which a bar shows."""
    figure: Any = new_figure(WIDTH, 125 * len(panels) + 20)
    grid: Any = figure.subplots(len(panels), max(map(len, panels)), squeeze=False)
    for row, found in zip(grid, panels, strict=True):
        for axes, (title, values) in zip(row, found, strict=True):
            most = max(map(max, values)) or 1.0  # a scale without any width would be drawn in its middle colour
            shown = axes.imshow(values, cmap="Blues", vmin=0, vmax=most, aspect="equal")
            axes.set_title(title, loc="left", fontsize=8, color=INK)
            axes.set_xticks([])
            axes.set_yticks([])
            bar = figure.colorbar(shown, ax=axes, fraction=0.015, pad=0.02)
            bar.ax.tick_params(labelsize=6)
            bar.outline.set_visible(False)
    return figure


class Strip(NamedTuple):
    """A film strip: a head of some lines, and frames with what was done before each."""

    head: Sequence[str]
    frames: Sequence[tuple[UInt8Array, str]]
    success: bool | None = None  # of the episode; None: it is not judged


def strips(found: Sequence[Strip]) -> Figure:
    """Film strips one below the other, at most FRAMES_A_ROW frames in a row."""
    rows = [max(1, -(-len(strip.frames) // FRAMES_A_ROW)) for strip in found]
    heights = [14 * len(s.head) + 20 + count * FRAME_HEIGHT for s, count in zip(found, rows, strict=True)]
    figure: Any = new_figure(WIDTH, sum(heights))
    figure.set_layout_engine("none")
    top = sum(heights)
    total = top
    for strip, height in zip(found, heights, strict=True):
        _draw_strip(figure, strip, top, total)
        top -= height
    return figure


def _draw_strip(figure: Any, strip: Strip, top: float, total: float) -> None:
    for number, text in enumerate(strip.head):
        weight, colour = ("bold", INK) if number == 0 else ("normal", "#4b5866")
        y = (top - 14 - 14 * number) / total
        figure.text(10 / WIDTH, y, text, fontsize=8, fontweight=weight, color=colour, parse_math=False)
    head = 14 * len(strip.head) + 6
    last = len(strip.frames) - 1
    for index, (picture, caption) in enumerate(strip.frames):
        row, column = divmod(index, FRAMES_A_ROW)
        left = 10 + column * FRAME_WIDTH
        bottom = top - head - (row + 1) * FRAME_HEIGHT + 4
        axes = figure.add_axes((left / WIDTH, bottom / total, (FRAME_WIDTH - 6) / WIDTH, (FRAME_HEIGHT - 24) / total))
        axes.imshow(picture, interpolation="nearest", aspect="auto")
        axes.set_xticks([])
        axes.set_yticks([])
        judged = index == last and strip.success is not None
        edge = FAINT if not judged else "#2a8f6d" if strip.success else "#c0392b"
        for spine in axes.spines.values():
            spine.set_color(edge)
            spine.set_linewidth(2 if judged else 0.6)
        axes.set_title(caption, loc="left", fontsize=6.5, color=INK if not judged else edge, pad=2, parse_math=False)
