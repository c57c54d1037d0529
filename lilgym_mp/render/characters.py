"""Scenes as characters, for terminals and language models."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from lilgym_mp.render.drawing import item_mask
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, Colour, Item, Scene, Shape

TEXT_CELL = (5, 10)  # width and height in native pixels of one character
_TEXT_COLOURS = {Colour.YELLOW: 33, Colour.BLACK: 30, Colour.BLUE: 34}
_TEXT_SHAPES = {Shape.CIRCLE: "o", Shape.SQUARE: "#", Shape.TRIANGLE: "^"}


def text(
    scene: Scene, lines: Sequence[str], *, coloured: bool = True, mark: Callable[[Item], str] | None = None
) -> str:
    """The scene drawn with characters (o circle, # square, ^ triangle), then `lines`.

    Without colours, items are drawn as y (yellow), k (black) or b (blue), whatever their shape. `mark` gives another
    character for an item.
    """
    width, height = TEXT_CELL
    box_columns, rows = BOX_SIDE // width, BOX_SIDE // height
    boxes: list[list[list[str]]] = []
    for box in scene.boxes:
        cells = [[" "] * box_columns for _ in range(rows)]
        for item in box.items:
            character = _text_mark(item, coloured=coloured) if mark is None else mark(item)
            for row in range(max(0, item.y // height), min(rows, -(-(item.y + item.side) // height))):
                for column in range(max(0, item.x // width), min(box_columns, -(-(item.x + item.side) // width))):
                    if _covers(item, column * width + width // 2, row * height + height // 2):
                        cells[row][column] = character
        boxes.append(cells)
    edge = "+" + "-" * box_columns + "+"
    picture = [f"|{'|  |'.join(''.join(box[row]) for box in boxes)}|" for row in range(rows)]
    border = "  ".join([edge] * BOX_COUNT)
    return "\n".join([border, *picture, border, *lines])


def _covers(item: Item, x: int, y: int) -> bool:
    column, row = x - item.x, y - item.y
    return 0 <= column < item.side and 0 <= row < item.side and bool(item_mask(item.footprint)[row, column])


def _text_mark(item: Item, *, coloured: bool) -> str:
    if not coloured:
        return {Colour.YELLOW: "y", Colour.BLACK: "k", Colour.BLUE: "b"}[item.colour]
    return f"\x1b[1;{_TEXT_COLOURS[item.colour]}m{_TEXT_SHAPES[item.shape]}\x1b[0m"
