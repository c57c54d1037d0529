"""Items of a report: tables, charts, and placeholders for missing items, each named as in the paper."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lilgym_mp.evaluation.report import markdown_table
from lilgym_mp.report.aggregation import MeanStd

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cell = str | int | float | MeanStd | None
MISSING = "–"


@dataclass(frozen=True)
class Table:
    """Rows of cells; None is a missing value."""

    item: str  # name in the paper, such as "Table 2", or our own
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    @property
    def name(self) -> str:
        """File name without suffix."""
        return slug(f"{self.item} {self.title}")

    def markdown(self) -> str:
        rows = [tuple(map(format_cell, row)) for row in self.rows]
        head = f"**{self.item}. {self.title}**\n\n{markdown_table([self.columns, *rows])}\n"
        return f"{head}\n{self.note}\n" if self.note else head

    def csv(self) -> str:
        """Unrounded numbers; columns of `MeanStd` are split into mean, standard deviation and number of runs."""
        is_split = [any(isinstance(row[index], MeanStd) for row in self.rows) for index in range(len(self.columns))]
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(
            name
            for column, split in zip(self.columns, is_split, strict=True)
            for name in ((f"{column} mean", f"{column} sd", f"{column} runs") if split else (column,))
        )
        for row in self.rows:
            writer.writerow(
                value
                for cell, split in zip(row, is_split, strict=True)
                for value in (_split_cell(cell) if split else ("" if cell is None else cell,))
            )
        return text.getvalue()


@dataclass(frozen=True)
class Chart:
    """A matplotlib figure."""

    item: str
    title: str
    figure: Figure
    note: str = ""
    raster: bool = False  # contains scene images, so the page embeds the PNG instead of the SVG

    @property
    def name(self) -> str:
        """File name without suffix."""
        return slug(f"{self.item} {self.title}")


@dataclass(frozen=True)
class MissingItem:
    """An item that cannot be made from these recordings."""

    item: str
    title: str
    note: str  # the reason, and what is needed

    @property
    def name(self) -> str:
        return slug(f"{self.item} {self.title}")


Item = Table | Chart | MissingItem


def table(item: str, title: str, columns: Sequence[str], rows: Iterable[Sequence[Cell]], note: str = "") -> Table:
    return Table(item, title, tuple(columns), tuple(map(tuple, rows)), note)


def format_cell(cell: Cell) -> str:
    if cell is None:
        return MISSING
    if isinstance(cell, float):
        return f"{cell:.2f}"
    if isinstance(cell, int):
        return f"{cell:,}"
    return str(cell)


def _split_cell(cell: Cell) -> Sequence[Any]:
    if isinstance(cell, MeanStd):
        return cell.mean, "" if cell.deviation is None else cell.deviation, cell.runs
    return "" if cell is None else cell, "", ""


def slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")
