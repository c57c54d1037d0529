"""Pictures of scenes for people: enlarged and antialiased, with outlines and, optionally, names of cells and boxes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, IMAGE_HEIGHT, IMAGE_WIDTH, Item, Scene, Shape
from lilgym_mp.scene.appearances import Appearance, Grid
from lilgym_mp.scene.appearances.places import Boxes, Cells, places_of
from lilgym_mp.scene.arrays import UInt8Array
from lilgym_mp.scene.render.drawing import COLOUR_RGB

Font = ImageFont.FreeTypeFont | ImageFont.ImageFont

SCALE = 2  # width of a native pixel
MARGIN = 12  # pixels around the scene, for row and column numbers
SUPERSAMPLING = 3  # factor by which the scene is drawn larger before it is reduced
SCENE_SHAPE = (IMAGE_HEIGHT * SCALE + 2 * MARGIN, IMAGE_WIDTH * SCALE + 2 * MARGIN, 3)  # (224, 784, 3)
CAPTION_HEIGHT = 80
FRAME_SHAPE = (SCENE_SHAPE[0] + CAPTION_HEIGHT, SCENE_SHAPE[1], 3)  # (304, 784, 3)
FONT_PIXELS = 17
MARK_FONT_PIXELS = 10
MARK_SPACING = 8  # minimum native pixels between two numbers; on finer grids only some cells are numbered
LINE_PIXELS = FONT_PIXELS + 8
PAPER_RGB = (255, 255, 255)
INK_RGB = (30, 30, 30)
MARK_RGB = (90, 90, 90)
OUTLINE_RGB = (80, 80, 80)
BOX_RGB = (240, 240, 236)  # lighter than in observations; nothing is drawn between boxes
CELL_RGB = (180, 180, 180)


def scene_picture(scene: Scene, marked: Appearance | None = None) -> UInt8Array:
    """The scene at twice its native size.

    Args:
        scene: The scene.
        marked: With the names that actions of this appearance use: column and row numbers of cells, or names of boxes.

    Returns:
        uint8 (224, 784, 3).
    """
    image = Image.new("RGB", (SCENE_SHAPE[1], SCENE_SHAPE[0]), PAPER_RGB)
    grid = None if marked is None else marked.grid
    image.paste(Image.fromarray(smooth_picture(scene, SCALE, grid)), (MARGIN, MARGIN))
    pen = ImageDraw.Draw(image)
    _outline_boxes(pen, SCALE, MARGIN)
    if marked is not None:
        _mark(pen, places_of(grid))
    return np.asarray(image)


def frame(scene: Scene, lines: Sequence[str], marked: Appearance | None = None) -> UInt8Array:
    """`scene_picture` above lines of text.

    Args:
        scene: The scene.
        lines: The lines, which are truncated to the width.
        marked: As for `scene_picture`.

    Returns:
        uint8 (304, 784, 3).
    """
    height, width, _ = FRAME_SHAPE
    image = Image.new("RGB", (width, height), PAPER_RGB)
    image.paste(Image.fromarray(scene_picture(scene, marked)))
    pen = ImageDraw.Draw(image)
    font = caption_font()
    for index, line in enumerate(lines):
        text = _fitted(line, width - 2 * MARGIN, pen, font)
        pen.text((MARGIN, SCENE_SHAPE[0] + index * LINE_PIXELS), text, fill=INK_RGB, font=font)
    return np.asarray(image)


@cache
def caption_font() -> Font:
    """The font of captions, loaded once."""
    return ImageFont.load_default(FONT_PIXELS)


def smooth_picture(scene: Scene, scale: int, grid: Grid | None = None) -> UInt8Array:
    """(100 scale, 380 scale, 3) the antialiased scene, with outlines around the boxes and, with `grid`, cell lines."""
    image = _drawn(scene, scale * SUPERSAMPLING, places_of(grid))
    image = image.reduce(SUPERSAMPLING)
    _outline_boxes(ImageDraw.Draw(image), scale, 0)
    return np.asarray(image)


def _outline_boxes(pen: ImageDraw.ImageDraw, scale: int, margin: int) -> None:
    """A line around each box; the first box is at (margin, margin); lines outside the image are clipped."""
    for box in range(BOX_COUNT):
        left = margin + scale * BOX_PITCH * box
        pen.rectangle((left - 1, margin - 1, left + scale * BOX_SIDE, margin + scale * BOX_SIDE), outline=OUTLINE_RGB)


def _drawn(scene: Scene, scale: int, places: Boxes | Cells) -> Image.Image:
    image = Image.new("RGB", (IMAGE_WIDTH * scale, IMAGE_HEIGHT * scale), PAPER_RGB)
    pen = ImageDraw.Draw(image)
    for index, box in enumerate(scene.boxes):
        left = index * BOX_PITCH
        pen.rectangle(_square(left, 0, BOX_SIDE, scale), fill=BOX_RGB)
        for line in _cell_lines(index, places):
            pen.line([coordinate * scale for coordinate in line], fill=CELL_RGB, width=SUPERSAMPLING)
        for item in box.items:
            _draw_item(pen, item, left + item.x, scale)
    return image


def _draw_item(pen: ImageDraw.ImageDraw, item: Item, x: int, scale: int) -> None:
    """Draws the item at native pixel (x, item.y), with an edge that separates it from adjacent items of its colour."""
    corners = _square(x, item.y, item.side, scale)
    fill = COLOUR_RGB[item.colour]
    width = SUPERSAMPLING
    edge = (fill[0] * 2 // 3, fill[1] * 2 // 3, fill[2] * 2 // 3) if any(fill) else (110, 110, 110)  # black: grey
    match item.shape:
        case Shape.CIRCLE:
            pen.ellipse(corners, fill, edge, width)
        case Shape.SQUARE:
            pen.rectangle(corners, fill, edge, width)
        case Shape.TRIANGLE:
            left, top, right, bottom = corners
            pen.polygon([((left + right) // 2, top), (right, bottom), (left, bottom)], fill, edge, width)


def _square(x: int, y: int, side: int, scale: int) -> tuple[int, int, int, int]:
    """Pillow's inclusive corners of a square of native pixels."""
    return x * scale, y * scale, (x + side) * scale - 1, (y + side) * scale - 1


def _cell_lines(box: int, places: Boxes | Cells) -> Iterator[tuple[int, int, int, int]]:
    """Lines between the numbered cells of a box: (x, y, x, y)."""
    left = BOX_PITCH * box
    for x, _ in places.columns(box, MARK_SPACING):
        yield x, 0, x, BOX_SIDE
    for y, _ in places.rows(MARK_SPACING):
        yield left, y, left + BOX_SIDE, y


def _mark(pen: ImageDraw.ImageDraw, places: Boxes | Cells) -> None:
    """Draws the names of boxes, or column numbers above the boxes and row numbers on their left."""
    font = ImageFont.load_default(MARK_FONT_PIXELS)
    width, height = places.size
    names = [(BOX_PITCH * box, name) for box, name in enumerate(places.box_names)]
    numbers = [mark for box in range(BOX_COUNT) for mark in places.columns(box, MARK_SPACING)]
    for x, name in names + numbers:
        position = MARGIN + SCALE * x + SCALE * width // 2, MARGIN // 2
        pen.text(position, name, fill=MARK_RGB, font=font, anchor="mm")
    for box in range(BOX_COUNT):
        for y, name in places.rows(MARK_SPACING):
            position = MARGIN + SCALE * BOX_PITCH * box - 3, MARGIN + SCALE * y + SCALE * height // 2
            pen.text(position, name, fill=MARK_RGB, font=font, anchor="rm")


def _fitted(line: str, width: int, pen: ImageDraw.ImageDraw, font: Font) -> str:
    """The line, truncated with an ellipsis if it is wider."""
    if pen.textlength(line, font=font) <= width:
        return line
    while line and pen.textlength(line + "...", font=font) > width:
        line = line[:-1]
    return line + "..."
