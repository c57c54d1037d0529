"""Scenes as pixels and as text. A picture is a pure function of its scene.

Source: SPEC section 1. Shapes are rasterised by Pillow, whose pixels are the released ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from lilgym_mp.appearances.placement import fits_box
from lilgym_mp.choices import choose
from lilgym_mp.scene import (
    BOX_COUNT,
    BOX_PITCH,
    BOX_SIDE,
    IMAGE_HEIGHT,
    IMAGE_WIDTH,
    KIND_PIXELS,
    Box,
    Colour,
    Item,
    Scene,
    Shape,
    Size,
)

UInt8Array = NDArray[np.uint8]
BoolArray = NDArray[np.bool_]
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont

BOX_RGB = (211, 211, 211)
SEPARATOR_RGB = (128, 128, 128)
COLOUR_RGB = {Colour.YELLOW: (250, 255, 0), Colour.BLACK: (0, 0, 0), Colour.BLUE: (15, 131, 255)}
SHRINKS = {"native": 1, "half": 2}  # by image size: side in pixels of the block that becomes one pixel


class Patch(NamedTuple):
    """A rectangle of the native image, its corners on even pixels."""

    left: int
    top: int
    right: int
    bottom: int


def shrink_of(image_size: str) -> int:
    """Side in native pixels of one pixel. Raises ValueError naming the choices."""
    return choose("image_size", image_size, SHRINKS)


def image_shape(image_size: str) -> tuple[int, int, int]:
    """(height, width, 3)."""
    shrink = shrink_of(image_size)
    return IMAGE_HEIGHT // shrink, IMAGE_WIDTH // shrink, 3


_WHOLE = Patch(0, 0, IMAGE_WIDTH, IMAGE_HEIGHT)
_BOX_PIXEL = np.array(BOX_RGB, np.uint8)


@cache
def _mask(kind: int) -> BoolArray:
    """(side, side) by row and column: the pixels of a kind's bounding square that are drawn."""
    side = KIND_PIXELS[kind]
    image = Image.new("1", (side, side))
    draw = ImageDraw.Draw(image)
    last = side - 1
    match Shape(kind // len(Size)):
        case Shape.CIRCLE:
            draw.ellipse((0, 0, last, last), fill=1)
        case Shape.SQUARE:
            draw.rectangle((0, 0, last, last), fill=1)
        case Shape.TRIANGLE:
            draw.polygon([(last - last // 2, 0), (last, last), (0, last)], fill=1)
    return np.asarray(image, np.bool_)


@cache
def _background() -> UInt8Array:
    """(100, 380, 3) three empty boxes; not to be written."""
    image = np.full((IMAGE_HEIGHT, IMAGE_WIDTH, 3), SEPARATOR_RGB, np.uint8)
    for index in range(BOX_COUNT):
        image[:, index * BOX_PITCH : index * BOX_PITCH + BOX_SIDE] = BOX_RGB
    image.flags.writeable = False
    return image


def draw(scene: Scene, image_size: str = "native") -> UInt8Array:
    """A new image of the scene: (100, 380, 3), or (50, 190, 3) when `image_size` is "half"."""
    items = ((index, item) for index, box in enumerate(scene.boxes) for item in box.items)
    return _shrunk(_drawn_patch(_WHOLE, items), shrink_of(image_size))


def _drawn_patch(patch: Patch, items: Iterable[tuple[int, Item]]) -> UInt8Array:
    """The patch of the native image with `items`, each with its box's index, as a new array."""
    left, top, right, bottom = patch
    pixels = _background()[top:bottom, left:right].copy()
    for index, item in items:
        _paint(pixels, item, index * BOX_PITCH + item.x - left, item.y - top)
    return pixels


def _paint(pixels: UInt8Array, item: Item, x: int, y: int) -> None:
    """Draws an item whose bounding square starts at (x, y) of `pixels`, as far as it lies there."""
    height, width, _ = pixels.shape
    side = item.side
    left, top = max(0, x), max(0, y)
    right, bottom = min(width, x + side), min(height, y + side)
    if left < right and top < bottom:
        drawn = _mask(item.kind)[top - y : bottom - y, left - x : right - x]
        pixels[top:bottom, left:right][drawn] = COLOUR_RGB[item.colour]


def _shrunk(pixels: UInt8Array, shrink: int) -> UInt8Array:
    """Each block of shrink x shrink pixels as its mean, truncated."""
    if shrink == 1:
        return pixels
    total = pixels[::shrink, ::shrink].astype(np.uint16)
    for down in range(shrink):
        for across in range(shrink):
            if down or across:
                total += pixels[down::shrink, across::shrink]
    return (total // shrink**2).astype(np.uint8)


@cache
def _sprite(kind: int, colour: Colour, odd_x: int, odd_y: int, shrink: int) -> UInt8Array:
    """An item alone in its box, on the smallest even patch that holds it."""
    side = KIND_PIXELS[kind]
    item = Item(0, 0, Shape(kind // len(Size)), colour, Size(kind % len(Size)))
    pixels = np.full((odd_y + side + (odd_y + side) % 2, odd_x + side + (odd_x + side) % 2, 3), BOX_RGB, np.uint8)
    _paint(pixels, item, odd_x, odd_y)
    return _shrunk(pixels, shrink)


def _patch_of(box_index: int, item: Item) -> Patch:
    """The smallest even patch that holds the item, cut at the image's border."""
    left, top = box_index * BOX_PITCH + item.x, item.y
    right, bottom = left + item.side, top + item.side
    return Patch(
        left=max(0, left - left % 2),
        top=max(0, top - top % 2),
        right=min(IMAGE_WIDTH, right + right % 2),
        bottom=min(IMAGE_HEIGHT, bottom + bottom % 2),
    )


def _is_alone(item: Item, others: Sequence[Item]) -> bool:
    """Whether the item lies in its box and no other reaches into its patch, so that its sprite is its picture."""
    x, y, side = item.x, item.y, item.side
    if x < 0 or y < 0 or x + side > BOX_SIDE or y + side > BOX_SIDE:
        return False
    left, top = x - x % 2, y - y % 2
    right, bottom = x + side + (x + side) % 2, y + side + (y + side) % 2
    return not any(
        other.x < right and left < other.x + other.side and other.y < bottom and top < other.y + other.side
        for other in others
        if other is not item
    )


class Canvas:
    """An image buffer kept equal to `draw` of the scene last shown, by redrawing only what changed."""

    def __init__(self, image_size: str = "half", pixels: UInt8Array | None = None) -> None:
        """`pixels`: the buffer to draw into, of `image_shape(image_size)`; a new one by default."""
        self._image_size = image_size
        self._shrink = shrink_of(image_size)
        shape = image_shape(image_size)
        if pixels is not None and (pixels.shape != shape or pixels.dtype != np.uint8):
            raise ValueError(f"pixels must be a uint8 array of shape {shape}, not {pixels.dtype} {pixels.shape}")
        self.pixels = np.empty(shape, np.uint8) if pixels is None else pixels
        self._scene: Scene | None = None

    def show(self, scene: Scene) -> UInt8Array:
        """The buffer, showing `scene`; valid until the next call."""
        shown = self._scene
        if shown is None:
            self.pixels[:] = draw(scene, self._image_size)
        else:
            for index in range(BOX_COUNT):
                if scene.boxes[index] is not shown.boxes[index]:
                    self._update(index, shown.boxes[index], scene)
        self._scene = scene
        return self.pixels

    def _update(self, index: int, before: Box, scene: Scene) -> None:
        old, new = before.items, scene.boxes[index].items
        if len(new) == len(old) + 1 and new[:-1] == old:
            self._redraw(index, new[-1], new)
        elif (removed := _removed(old, new)) is not None:
            self._redraw_patch(_patch_of(index, removed), index, new)
        else:
            self._put(Patch(index * BOX_PITCH, 0, index * BOX_PITCH + BOX_SIDE, IMAGE_HEIGHT), _BOX_PIXEL)
            for item in old:
                if not fits_box(item.kind, item.x, item.y):
                    self._redraw_patch(_patch_of(index, item), index, new)
            for item in new:
                self._redraw(index, item, new)

    def _redraw(self, index: int, item: Item, items: Sequence[Item]) -> None:
        if _is_alone(item, items):
            self._put(_patch_of(index, item), _sprite(item.kind, item.colour, item.x % 2, item.y % 2, self._shrink))
        else:
            self._redraw_patch(_patch_of(index, item), index, items)

    def _redraw_patch(self, patch: Patch, index: int, items: Sequence[Item]) -> None:
        self._put(patch, _shrunk(_drawn_patch(patch, ((index, item) for item in items)), self._shrink))

    def _put(self, patch: Patch, pixels: UInt8Array) -> None:
        left, top, right, bottom = patch
        shrink = self._shrink
        self.pixels[top // shrink : bottom // shrink, left // shrink : right // shrink] = pixels


def _removed(old: Sequence[Item], new: Sequence[Item]) -> Item | None:
    """The one item of `old` that is missing in `new`, if that is all the difference."""
    if len(new) != len(old) - 1:
        return None
    first = next((i for i, (item, other) in enumerate(zip(old, new, strict=False)) if item is not other), len(new))
    return old[first] if old[first + 1 :] == new[first:] else None


FRAME_SCALE = 2  # native pixels are this wide in a frame
CAPTION_HEIGHT = 88
CAPTION_FONT_PIXELS = 17
CAPTION_MARGIN = 10
PAPER_RGB = (255, 255, 255)
INK_RGB = (30, 30, 30)


def frame(scene: Scene, lines: Sequence[str]) -> UInt8Array:
    """(288, 760, 3) a picture for people: the scene, enlarged, above lines of text, cut to the width."""
    width, height = IMAGE_WIDTH * FRAME_SCALE, IMAGE_HEIGHT * FRAME_SCALE
    image = Image.new("RGB", (width, height + CAPTION_HEIGHT), PAPER_RGB)
    image.paste(Image.fromarray(draw(scene)).resize((width, height), Image.Resampling.NEAREST))
    pen = ImageDraw.Draw(image)
    font = ImageFont.load_default(CAPTION_FONT_PIXELS)
    for number, line in enumerate(lines):
        text = _fitted(line, width - 2 * CAPTION_MARGIN, pen, font)
        pen.text((CAPTION_MARGIN, height + 8 + number * (CAPTION_FONT_PIXELS + 8)), text, fill=INK_RGB, font=font)
    return np.asarray(image)


def _fitted(line: str, width: int, pen: ImageDraw.ImageDraw, font: Font) -> str:
    """The line, or as much of its beginning as fits with an ellipsis."""
    if pen.textlength(line, font=font) <= width:
        return line
    while line and pen.textlength(line + "...", font=font) > width:
        line = line[:-1]
    return line + "..."


TEXT_CELL = (5, 10)  # width and height in native pixels of one character
_TEXT_COLOURS = {Colour.YELLOW: 33, Colour.BLACK: 30, Colour.BLUE: 34}
_TEXT_SHAPES = {Shape.CIRCLE: "o", Shape.SQUARE: "#", Shape.TRIANGLE: "^"}


def text(scene: Scene, lines: Sequence[str], *, coloured: bool = True) -> str:
    """The scene as lines of characters for a terminal (o circle, # square, ^ triangle), then `lines`.

    Without colours, yellow is y, black k and blue b, and the shapes are not told apart.
    """
    width, height = TEXT_CELL
    box_columns, rows = BOX_SIDE // width, BOX_SIDE // height
    boxes: list[list[list[str]]] = []
    for box in scene.boxes:
        cells = [[" "] * box_columns for _ in range(rows)]
        for item in box.items:
            mark = _text_mark(item, coloured=coloured)
            for row in range(max(0, item.y // height), min(rows, -(-(item.y + item.side) // height))):
                for column in range(max(0, item.x // width), min(box_columns, -(-(item.x + item.side) // width))):
                    if _covers(item, column * width + width // 2, row * height + height // 2):
                        cells[row][column] = mark
        boxes.append(cells)
    edge = "+" + "-" * box_columns + "+"
    picture = [f"|{'|  |'.join(''.join(box[row]) for box in boxes)}|" for row in range(rows)]
    border = "  ".join([edge] * BOX_COUNT)
    return "\n".join([border, *picture, border, *lines])


def _covers(item: Item, x: int, y: int) -> bool:
    column, row = x - item.x, y - item.y
    return 0 <= column < item.side and 0 <= row < item.side and bool(_mask(item.kind)[row, column])


def _text_mark(item: Item, *, coloured: bool) -> str:
    if not coloured:
        return {Colour.YELLOW: "y", Colour.BLACK: "k", Colour.BLUE: "b"}[item.colour]
    return f"\x1b[1;{_TEXT_COLOURS[item.colour]}m{_TEXT_SHAPES[item.shape]}\x1b[0m"
