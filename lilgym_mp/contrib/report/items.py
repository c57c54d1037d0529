"""Items of a report: tables, charts, and placeholders for missing items, each named as in the paper."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lilgym_mp.contrib.report.aggregation import MeanStd
from lilgym_mp.evaluation.report import markdown_table
from lilgym_mp.evaluation.results import rounded
from lilgym_mp.evaluation.terminal import NUMBER

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cell = str | int | float | MeanStd | None
MISSING = "–"
PUBLISHED = "†"  # ends the first cell of a row from the paper
PARTS = ("mean", "sd", "runs", "low", "high")  # columns of a MeanStd in CSV files
LATEX = str.maketrans(
    {
        **{sign: f"\\{sign}" for sign in "&%$#_{}"},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": "$<$",
        ">": "$>$",
        "±": r"$\pm$",
        "†": r"$^\dagger$",
        "–": "--",
        "−": "$-$",
    }
)
LONGEST_NAME = 200  # characters; a path may be in a title
FEW_EPISODES = 100  # below, decimals of a percentage mean nothing


@dataclass(frozen=True)
class Item:
    """An item of the paper, or our own; one that is neither a table nor a chart cannot be made, as its note says."""

    item: str  # such as "Table 2"
    title: str
    note: str = field(default="", kw_only=True)
    links: tuple[tuple[str, str], ...] = field(default=(), kw_only=True)  # text and address, under a running `serve`

    @property
    def name(self) -> str:
        """File name without suffix."""
        return re.sub(r"[^a-z0-9]+", "-", f"{self.item} {self.title}".lower()).strip("-")[:LONGEST_NAME]


@dataclass(frozen=True)
class Table(Item):
    """Rows of cells; None is a missing value."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def texts(self) -> list[list[str]]:
        """The cells as shown: percentages with one decimal, without if a cell of the column is of few episodes, other
        fractions with two."""
        places = list(map(self._places, self.columns, zip(*self.rows, strict=True))) if self.rows else []
        return [[format_cell(cell, count) for cell, count in zip(row, places, strict=True)] for row in self.rows]

    def _places(self, column: str, cells: Sequence[Cell]) -> int:
        if not re.search("%|per cent|points", f"{self.title} {column}"):
            return 2
        counts = [cell.episodes for cell in cells if isinstance(cell, MeanStd)]
        return 0 if any(count is not None and count < FEW_EPISODES for count in counts) else 1

    def markdown(self) -> str:
        """The table with its number, title and note, as Markdown."""
        head = f"**{self.item}. {self.title}**\n\n{markdown_table([self.columns, *self.texts()])}\n"
        return f"{head}\n{self.note}\n" if self.note else head

    def latex(self) -> str:
        """A `tabular` with the rules of the LaTeX package booktabs."""
        texts = self.texts()
        columns = "".join("r" if all(map(NUMBER.fullmatch, cells)) else "l" for cells in zip(*texts, strict=True))
        head, *rows = (" & ".join(cell.translate(LATEX) for cell in row) + r" \\" for row in (self.columns, *texts))
        lines = [
            f"% {self.item}. {self.title}. Needs \\usepackage{{booktabs}}.",
            f"\\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            head,
            r"\midrule",
            *rows,
            r"\bottomrule",
            r"\end{tabular}",
        ]
        return "\n".join(lines) + "\n"

    def csv(self) -> str:
        """Unrounded numbers; columns of `MeanStd` are split into its parts."""
        columns: list[Sequence[Any]] = []
        for name, *cells in zip(self.columns, *self.rows, strict=True):
            if any(isinstance(cell, MeanStd) for cell in cells):
                parts = [cell[: len(PARTS)] if isinstance(cell, MeanStd) else (cell, *[None] * 4) for cell in cells]
                columns += zip((f"{name} {part}" for part in PARTS), *parts, strict=True)
            else:
                columns.append((name, *cells))
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(zip(*columns, strict=True))
        return text.getvalue()


@dataclass(frozen=True)
class Chart(Item):
    """A matplotlib figure."""

    figure: Figure
    raster: bool = False  # contains scene images, so the page embeds the PNG instead of the SVG


def table(item: str, title: str, columns: Sequence[str], rows: Iterable[Sequence[Cell]], note: str = "") -> Table:
    """A table without the columns that are empty but for the paper's rows."""
    rows = [tuple(row) for row in rows]
    own = [row for row in rows if not str(row[0]).endswith(PUBLISHED)]
    kept = [index for index in range(len(columns)) if not own or any(row[index] is not None for row in own)]
    kept_rows = tuple(tuple(row[index] for index in kept) for row in rows)
    return Table(item, title, tuple(columns[index] for index in kept), kept_rows, note=note)


def format_cell(cell: Cell, places: int = 2) -> str:
    """A cell as shown, negative numbers with a minus sign."""
    if cell is None:
        return MISSING
    if isinstance(cell, str):
        return cell
    text = (
        f"{cell:,}"
        if isinstance(cell, int)
        else cell.text(places)
        if isinstance(cell, MeanStd)
        else rounded(cell, places)
    )
    return text.replace("-", "−")
