"""What a report is made of: tables and charts, each named as in the paper, and what could not be made."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lilgym_mp.evaluation.report import markdown_table
from lilgym_mp.report.aggregation import Spread

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cell = str | int | float | Spread | None
NOTHING = "–"


@dataclass(frozen=True)
class Table:
    """Rows of cells; None is a number that is not there."""

    item: str  # as the paper calls it
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    @property
    def name(self) -> str:
        """Of its files."""
        return slug(f"{self.item} {self.title}")

    def texts(self) -> list[tuple[str, ...]]:
        return [tuple(map(shown, row)) for row in self.rows]

    def markdown(self) -> str:
        head = f"**{self.item}. {self.title}**\n\n{markdown_table([self.columns, *self.texts()])}\n"
        return f"{head}\n{self.note}\n" if self.note else head

    def csv(self) -> str:
        """With a column each for mean, deviation and runs where cells hold them, numbers unrounded."""
        spreads = [any(isinstance(row[place], Spread) for row in self.rows) for place in range(len(self.columns))]
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(
            name
            for column, is_spread in zip(self.columns, spreads, strict=True)
            for name in ((f"{column} mean", f"{column} sd", f"{column} runs") if is_spread else (column,))
        )
        for row in self.rows:
            writer.writerow(
                value
                for cell, is_spread in zip(row, spreads, strict=True)
                for value in (_parts(cell) if is_spread else ("" if cell is None else cell,))
            )
        return text.getvalue()


@dataclass(frozen=True)
class Chart:
    """A figure of matplotlib."""

    item: str
    title: str
    figure: Figure
    note: str = ""
    raster: bool = False  # whether pictures of scenes are in it, which SVG would only wrap

    @property
    def name(self) -> str:
        """Of its files."""
        return slug(f"{self.item} {self.title}")


@dataclass(frozen=True)
class Lacking:
    """An item that these recordings do not allow."""

    item: str
    title: str
    note: str  # why, and what would

    @property
    def name(self) -> str:
        return slug(f"{self.item} {self.title}")


Item = Table | Chart | Lacking


def table(item: str, title: str, columns: Sequence[str], rows: Iterable[Sequence[Cell]], note: str = "") -> Table:
    return Table(item, title, tuple(columns), tuple(map(tuple, rows)), note)


def shown(cell: Cell) -> str:
    """A cell for people."""
    if cell is None:
        return NOTHING
    if isinstance(cell, float):
        return f"{cell:.2f}"
    if isinstance(cell, int):
        return f"{cell:,}"
    return str(cell)


def _parts(cell: Cell) -> Sequence[Any]:
    if isinstance(cell, Spread):
        return cell.mean, "" if cell.deviation is None else cell.deviation, cell.runs
    return "" if cell is None else cell, "", ""


def slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")
