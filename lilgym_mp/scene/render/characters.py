"""Scenes as characters, for terminals and language models, with column and row numbers around them if wanted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, Colour, Item, Scene, Shape
from lilgym_mp.scene.appearances import Grid
from lilgym_mp.scene.appearances.places import Boxes, Cells, places_of
from lilgym_mp.scene.render.drawing import item_mask

TEXT_CELL = (5, 10)  # width and height in native pixels of one character
BORDER = 1  # characters on each side of a box
GAP = 2  # characters between two boxes
_TEXT_COLOURS = {Colour.YELLOW: 33, Colour.BLACK: 30, Colour.BLUE: 34}
_TEXT_LETTERS = {Colour.YELLOW: "y", Colour.BLACK: "k", Colour.BLUE: "b"}
_TEXT_SHAPES = {Shape.CIRCLE: "o", Shape.SQUARE: "#", Shape.TRIANGLE: "^"}


def text(scene: Scene, lines: Sequence[str], *, coloured: bool = True) -> str:
    """The scene drawn with characters (o circle, # square, ^ triangle), then `lines`.

    The characters of a shape alternate with y (yellow), k (black) or b (blue). With colours, the lowest row of each
    item is underlined, so that the blocks of a tower can be told apart.
    """
    width, height = TEXT_CELL
    box_columns = BOX_SIDE // width
    rows = BOX_SIDE // height
    boxes: list[list[list[str]]] = []
    for box in scene.boxes:
        cells = [[" "] * box_columns for _ in range(rows)]
        for item in box.items:
            lowest = min(rows, -(-(item.y + item.side) // height)) - 1
            for row in range(max(0, item.y // height), lowest + 1):
                characters = _text_marks(item, coloured=coloured, underlined=row == lowest)
                for column in range(max(0, item.x // width), min(box_columns, -(-(item.x + item.side) // width))):
                    if _covers(item, column * width + width // 2, row * height + height // 2):
                        cells[row][column] = characters[column % len(characters)]
        boxes.append(cells)
    edge = "+" + "-" * box_columns + "+"
    picture = [f"|{'|  |'.join(''.join(box[row]) for box in boxes)}|" for row in range(rows)]
    border = "  ".join([edge] * BOX_COUNT)
    return "\n".join([border, *picture, border, *lines])


def _covers(item: Item, x: int, y: int) -> bool:
    column = x - item.x
    row = y - item.y
    return 0 <= column < item.side and 0 <= row < item.side and bool(item_mask(item.footprint)[row, column])


def _text_marks(item: Item, *, coloured: bool, underlined: bool) -> Sequence[str]:
    """The characters of even and odd columns."""
    marks = _TEXT_LETTERS[item.colour] + _TEXT_SHAPES[item.shape]
    style = f"{'4;' * underlined}1;{_TEXT_COLOURS[item.colour]}"
    return [f"\x1b[{style}m{mark}\x1b[0m" for mark in marks] if coloured else marks


def ruled(picture: str, grid: Grid | None) -> str:
    """The picture of `text` with the numbers of the cells that edits name: columns above, rows on the right.

    If cells are narrower than their numbers, only some are numbered.
    """
    places = places_of(grid)
    top, *inside, bottom = picture.split("\n")
    marks = [""] * len(inside)
    for y, number in reversed(list(places.rows(1))):
        marks[y // TEXT_CELL[1]] = number
    numbered = [f"{line} {mark}".rstrip() for line, mark in zip(inside, marks, strict=True)]
    return "\n".join([*_column_lines(places), top, *numbered, bottom])


def _column_lines(places: Boxes | Cells) -> Iterator[str]:
    """A line of column numbers, if columns have numbers."""
    box_width = BOX_SIDE // TEXT_CELL[0] + 2 * BORDER + GAP
    line = ""
    for box in range(BOX_COUNT):
        for x, number in places.columns(box, 1):
            start = box * box_width + BORDER + (x - BOX_PITCH * box) // TEXT_CELL[0]
            if start > len(line) or not line:
                line = line.ljust(start) + number
    if line:
        yield line
