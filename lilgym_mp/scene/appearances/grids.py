"""Grids of Scatter: columns and rows of cells that tile the boxes and separators. Source: docs/spec.md, "Actions"."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any, SupportsIndex, cast

from lilgym_mp.scene import IMAGE_HEIGHT, IMAGE_WIDTH
from lilgym_mp.scene.appearances.base import Grid
from lilgym_mp.scene.arrays import BOOLEANS

NATIVE = "native"
RELEASED_GRID = (19, 5)
NATIVE_GRID = (IMAGE_WIDTH, IMAGE_HEIGHT)
WIDEST_CELL = 20  # the largest cell width that divides both a box and a separator


class GridError(ValueError):
    """A grid whose cells do not tile the boxes and separators."""


def checked_grid(grid: object) -> Grid:
    """(columns, rows) from a pair or "native". Raises GridError naming the choices."""
    if grid == NATIVE:
        return NATIVE_GRID
    counts = cast("Sequence[Any]", grid) if isinstance(grid, tuple | list) else ()
    numbers = [operator.index(n) for n in counts if isinstance(n, SupportsIndex) and not isinstance(n, BOOLEANS)]
    if len(counts) != 2 or len(numbers) != 2 or min(numbers) < 1:
        raise GridError(f"grid must be {NATIVE!r} or a pair (columns, rows) of positive whole numbers, not {grid!r}")
    columns, rows = numbers
    if IMAGE_WIDTH % columns or WIDEST_CELL % (IMAGE_WIDTH // columns):
        choices = [IMAGE_WIDTH // width for width in range(WIDEST_CELL, 0, -1) if WIDEST_CELL % width == 0]
        raise GridError(
            f"grid {columns} x {rows}: with {columns} columns cells would straddle a separator;"
            f" choose from {', '.join(map(str, choices))} columns"
        )
    if IMAGE_HEIGHT % rows:
        choices = [count for count in range(1, IMAGE_HEIGHT + 1) if IMAGE_HEIGHT % count == 0]
        raise GridError(
            f"grid {columns} x {rows}: {rows} rows do not divide {IMAGE_HEIGHT} pixels;"
            f" choose from {', '.join(map(str, choices))} rows"
        )
    return columns, rows


def cell_size(grid: Grid) -> tuple[int, int]:
    """Width and height of a cell in pixels."""
    columns, rows = grid
    return IMAGE_WIDTH // columns, IMAGE_HEIGHT // rows


def read_grid(text: str) -> Grid | str:
    """A grid written as 38x10, or "native". Raises ValueError naming the valid forms."""
    if text == NATIVE:
        return NATIVE
    columns, _, rows = text.lower().partition("x")
    if not (columns.isdecimal() and rows.isdecimal()):
        raise ValueError(f"{text!r} must be {NATIVE!r} or COLUMNSxROWS, such as 38x10")
    return checked_grid((int(columns), int(rows)))
