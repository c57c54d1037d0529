"""Column and row numbers around a text picture."""

from __future__ import annotations

from lilgym_mp.appearances import Grid
from lilgym_mp.render.characters import TEXT_CELL
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, IMAGE_HEIGHT, IMAGE_WIDTH

BORDER = 1  # characters on each side of a box
GAP = 2  # characters between two boxes


def ruled(picture: str, grid: Grid | None) -> str:
    """The picture of `render.text` with column numbers above and row numbers on the right, unchanged without a grid.

    If cells are narrower than their numbers, only some are numbered.
    """
    if grid is None:
        return picture
    columns, rows = grid
    top, *inside, bottom = picture.split("\n")
    marks = _row_marks(rows, len(inside))
    numbered = [f"{line} {mark}".rstrip() for line, mark in zip(inside, marks, strict=True)]
    return "\n".join([_column_line(columns), top, *numbered, bottom])


def _column_line(columns: int) -> str:
    cell_width = IMAGE_WIDTH // columns
    box_width = BOX_SIDE // TEXT_CELL[0] + 2 * BORDER + GAP
    line = ""
    for box in range(BOX_COUNT):
        for x in range(0, BOX_SIDE, cell_width):
            start = box * box_width + BORDER + x // TEXT_CELL[0]
            if start > len(line) or not line:
                line = line.ljust(start) + str((box * BOX_PITCH + x) // cell_width)
    return line


def _row_marks(rows: int, lines: int) -> list[str]:
    cell_height = IMAGE_HEIGHT // rows
    marks = [""] * lines
    for row in reversed(range(rows)):
        marks[row * cell_height // TEXT_CELL[1]] = str(row)
    return marks
