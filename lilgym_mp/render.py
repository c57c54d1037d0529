"""Scenes as pixels and as text. A picture is a pure function of its scene.

Source: SPEC section 1. Shapes are rasterised by Pillow, whose pixels are the released ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from lilgym_mp.appearances.placement import fits_box
from lilgym_mp.arrays import BoolArray, UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.scene import (
    BOX_COUNT,
    BOX_PITCH,
    BOX_SIDE,
    IMAGE_HEIGHT,
    IMAGE_WIDTH,
    KIND_PIXELS,
    KINDS,
    SIZE_PIXELS,
    Box,
    Colour,
    Item,
    Scene,
    Shape,
    Size,
)

BOX_RGB = (211, 211, 211)
SEPARATOR_RGB = (128, 128, 128)
COLOUR_RGB = {Colour.YELLOW: (250, 255, 0), Colour.BLACK: (0, 0, 0), Colour.BLUE: (15, 131, 255)}
KEPT_BYTES = 48 << 20  # room for pictures of scenes; at half size those of all official Scatter scenes take 44 MB
RUN_PIXELS = 32
LARGEST_PATCH = 2 + max(KIND_PIXELS)  # native side of the smallest patch of whole 2 x 2 blocks for any item anywhere
SHRINKS = {"native": 1, "half": 2}  # by image size: side in pixels of the block that becomes one pixel


def shrink_of(image_size: str) -> int:
    """Side in native pixels of one pixel. Raises ValueError naming the choices."""
    return choose("image_size", image_size, SHRINKS)


def image_shape(image_size: str) -> tuple[int, int, int]:
    """(height, width, 3)."""
    shrink = shrink_of(image_size)
    return IMAGE_HEIGHT // shrink, IMAGE_WIDTH // shrink, 3


_SHAPES = {kind: shape for shape in Shape for kind in KINDS[shape]}


@cache
def _mask(kind: int) -> BoolArray:
    """(side, side) by row and column: the pixels of a kind's bounding square that are drawn."""
    side = KIND_PIXELS[kind]
    image = Image.new("1", (side, side))
    draw = ImageDraw.Draw(image)
    last = side - 1
    match _SHAPES[kind]:
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
    pixels = _background().copy()
    for index, box in enumerate(scene.boxes):
        for item in box.items:
            _paint(pixels, item, index * BOX_PITCH + item.x, item.y)
    return _shrunk(pixels, shrink_of(image_size))


def _paint(pixels: UInt8Array, item: Item, x: int, y: int) -> None:
    """Draws an item whose bounding square starts at (x, y) of the native image, as far as it lies there."""
    side = item.side
    left, top = max(0, x), max(0, y)
    right, bottom = min(IMAGE_WIDTH, x + side), min(IMAGE_HEIGHT, y + side)
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


class Stamp(NamedTuple):
    """A look at even or odd coordinates, on the smallest patch of whole blocks that holds it."""

    sprite: UInt8Array  # (height, width, 3) alone in its box
    counts: UInt8Array  # (height, width) pixels of its colour in each block, times its colour's weight


class Palette(NamedTuple):
    """What a block looks like by the weighted counts of its coloured pixels; counts of several items add up."""

    weights: Mapping[Colour, int]
    colours: UInt8Array  # (most weighted count + 1, 3)


@cache
def palette(shrink: int) -> Palette:
    base = shrink**2 + 1  # a block has 0 to shrink**2 pixels of each colour
    weights = {colour: base**colour for colour in Colour}
    codes = np.arange(shrink**2 * max(weights.values()) + 1, dtype=np.int64)[:, None]
    counts = np.concatenate([codes // weight % base for weight in weights.values()], axis=1)  # (codes, colours)
    bare = shrink**2 - counts.sum(axis=1, keepdims=True)  # negative for codes that do not occur
    painted = counts @ np.array([COLOUR_RGB[colour] for colour in weights], np.int64)
    total = painted + bare * np.array(BOX_RGB, np.int64)
    return Palette(weights, (total // shrink**2).clip(0, 255).astype(np.uint8))


@cache
def stamp(kind: int, colour: Colour, odd_x: int, odd_y: int, shrink: int) -> Stamp:
    side = KIND_PIXELS[kind]
    width, height = odd_x + side + (odd_x + side) % 2, odd_y + side + (odd_y + side) % 2
    drawn = np.zeros((height, width), np.uint8)
    drawn[odd_y : odd_y + side, odd_x : odd_x + side] = _mask(kind)
    blocks = drawn.reshape(height // shrink, shrink, width // shrink, shrink).sum((1, 3), dtype=np.uint8)
    weights, colours = palette(shrink)
    counts = blocks * np.uint8(weights[colour])
    return Stamp(colours[counts], counts)


@cache
def _empty(shrink: int) -> UInt8Array:
    """An image of three empty boxes; not to be written."""
    image = _shrunk(_background(), shrink)
    image.flags.writeable = False
    return image


@cache
def _blank(shrink: int) -> UInt8Array:
    """An empty box."""
    side = BOX_SIDE // shrink
    return np.full((side, side, 3), BOX_RGB, np.uint8)


# What play draws by is kept in plain tuples: they are taken apart in a third of a named tuple's time.

# Pixels to put somewhere in a box: first row, row after the last, columns likewise, (rows, columns, 3) pixels.
Blit = tuple[int, int, int, int, UInt8Array]

# How an item shows on its patch, the smallest one of whole blocks that holds it: the patch's width and height in native
# pixels, (rows, columns, 3) the patch with the item alone, the patch without it, `drawn` and `counts`. These two are
# numbers that stand for a picture, row by row, in `_pitch` entries each: a bit for each native pixel, set where it is
# the item's, and a byte for each block, as in the item's stamp.
_Look = tuple[int, int, UInt8Array, UInt8Array, int, int]
_Looks = Sequence[Sequence[Sequence[Sequence[Sequence[_Look]]]]]  # by shape, colour, size, oddness of x, of y


def _pitch(shrink: int) -> int:
    """Entries in a row of `drawn` (shrink 1) or `counts`: so many that all that is near a patch has its own."""
    return 3 * LARGEST_PATCH // shrink


def _look(kind: int, colour: Colour, odd_x: int, odd_y: int, shrink: int) -> _Look:
    sprite, counts = stamp(kind, colour, odd_x, odd_y, shrink)
    rows, columns = counts.shape
    bare = _blank(shrink)[:rows, :columns]
    mask = np.pad(_mask(kind), ((odd_y, 0), (odd_x, 0)))
    drawn = int.from_bytes(np.packbits(_in_rows(mask, _pitch(1)), bitorder="little").tobytes(), "little")
    number = int.from_bytes(_in_rows(counts, _pitch(shrink)).tobytes(), "little")
    return columns * shrink, rows * shrink, sprite, bare, drawn, number


def _in_rows(entries: NDArray[Any], pitch: int) -> NDArray[Any]:
    return np.pad(entries, ((0, 0), (0, pitch - entries.shape[1])))


@cache
def _looks(shrink: int) -> _Looks:
    """Of all items. Computing the rest by place takes no longer than looking up what is remembered of an item."""
    return [
        [
            [
                [[_look(KINDS[shape][size], colour, odd_x, odd_y, shrink) for odd_y in (0, 1)] for odd_x in (0, 1)]
                for size in Size
            ]
            for colour in Colour
        ]
        for shape in Shape
    ]


def _patch_blit(item: Item, others: Sequence[Item], looks: _Looks, shrink: int, *, shown: bool) -> Blit | None:
    """What a box looks like on the patch of `item` with its `others`, and with it if `shown`.

    None when some item there reaches out of the box or is drawn over by another: then order matters.
    """
    x, y, shape, colour, size = item
    width, height, alone, bare, _, _ = looks[shape][colour][size][x & 1][y & 1]
    left, top = x & -2, y & -2
    right, bottom = left + width, top + height
    if left < 0 or top < 0 or right > BOX_SIDE or bottom > BOX_SIDE:
        return None
    near: list[Item] = []
    for other in others:
        if other[0] < right and other[1] < bottom:
            side = SIZE_PIXELS[other[4]]
            if left < other[0] + side and top < other[1] + side:
                near.append(other)
    pixels = alone if shown else bare
    if near:
        pixels = _composed(left, top, bare.shape, [item, *near] if shown else near, shrink)
        if pixels is None:
            return None
    return top // shrink, bottom // shrink, left // shrink, right // shrink, pixels


def _composed(left: int, top: int, shape: tuple[int, ...], items: Sequence[Item], shrink: int) -> UInt8Array | None:
    """A patch of that shape (rows, columns, 3) with items near it; None as in `_patch_blit`.

    Numbers are shifted and added rather than arrays, whose operations take ten times as long on so few entries.
    """
    looks, pitch, block_pitch = _looks(shrink), _pitch(1), _pitch(shrink)
    drawn = counts = 0
    for item in items:
        if not fits_box(item.kind, item.x, item.y):
            return None
        x, y, item_shape, colour, size = item
        _, _, _, _, own_drawn, own_counts = looks[item_shape][colour][size][x & 1][y & 1]
        across, down = (x & -2) - left, (y & -2) - top
        shift = down * pitch + across
        own_drawn = own_drawn << shift if shift >= 0 else own_drawn >> -shift
        if drawn & own_drawn:
            return None
        drawn |= own_drawn
        shift = 8 * (down // shrink * block_pitch + across // shrink)
        counts += own_counts << shift if shift >= 0 else own_counts >> -shift
    # As long as the number can be: what is near may begin at the patch's last row.
    by_block = counts.to_bytes(2 * LARGEST_PATCH // shrink * block_pitch, "little")
    blocks = np.ndarray(shape[:2], np.uint8, by_block, strides=(block_pitch, 1))
    return palette(shrink).colours.take(blocks, axis=0)


_BLITS_KEYS = {shrink: f"blits {shrink}" for shrink in SHRINKS.values()}  # in a box's memo, by shrink


def box_blits(box: Box, shrink: int) -> tuple[Blit, ...] | None:
    """What to put on an empty box; None as in `_patch_blit`. Kept in the box's memo."""
    key, memo = _BLITS_KEYS[shrink], box.memo
    if key not in memo:
        items, looks = box.items, _looks(shrink)
        blits = [
            _patch_blit(item, items[:number] + items[number + 1 :], looks, shrink, shown=True)
            for number, item in enumerate(items)
        ]
        memo[key] = None if None in blits else tuple(blits)
    return memo[key]


class _Picture(NamedTuple):
    """A picture as what differs from empty boxes, in runs of RUN_PIXELS native pixels: put on in one assignment."""

    starts: NDArray[np.int64]  # (runs,) pixel that each run begins with, the image's pixels counted row by row
    runs: NDArray[np.void]  # (runs,) the pixels' bytes

    @classmethod
    def of(cls, pixels: UInt8Array, shrink: int) -> _Picture:
        every_run = _every_run(pixels, shrink)
        starts: list[int] = []
        end = 0
        for pixel in np.flatnonzero((pixels != _empty(shrink)).any(axis=2)).tolist():
            if pixel >= end:
                starts.append(min(pixel, len(every_run) - 1))
                end = pixel + RUN_PIXELS // shrink
        places = np.array(starts, np.int64)
        return cls(places, every_run[places])


def _every_run(pixels: UInt8Array, shrink: int) -> NDArray[np.void]:
    """The runs that begin with each pixel of an image, over its memory."""
    length = RUN_PIXELS // shrink
    run = np.dtype((np.void, 3 * length))
    return np.ndarray((pixels.size // 3 - length + 1,), run, pixels, strides=(3,))


@dataclass
class _Room:
    """How many bytes of pictures may still be kept, those of all scenes and image sizes together."""

    left: int


_ROOM = _Room(KEPT_BYTES)


class Canvas:
    """An image buffer kept equal to `draw` of the scene last shown, by redrawing only what changed."""

    def __init__(self, image_size: str = "half", pixels: UInt8Array | None = None) -> None:
        """`pixels`: the contiguous buffer to draw into, of `image_shape(image_size)`; a new one by default."""
        self._image_size = image_size
        self._shrink = shrink_of(image_size)
        shape = image_shape(image_size)
        if pixels is not None and (pixels.shape != shape or pixels.dtype != np.uint8):
            raise ValueError(f"pixels must be a uint8 array of shape {shape}, not {pixels.dtype} {pixels.shape}")
        if pixels is not None and not pixels.flags.c_contiguous:
            raise ValueError("pixels must be a contiguous array, not a part of one with gaps")
        self.pixels = np.empty(shape, np.uint8) if pixels is None else pixels
        lefts = [index * BOX_PITCH // self._shrink for index in range(BOX_COUNT)]
        self._boxes = [self.pixels[:, left : left + BOX_SIDE // self._shrink] for left in lefts]
        self._every_run = _every_run(self.pixels, self._shrink)
        self._looks = _looks(self._shrink)
        self._memo_key = f"picture {image_size}"
        self._shown: tuple[Box, Box, Box] | None = None  # None when the buffer must be drawn as a whole

    def __reduce__(self) -> tuple[type[Canvas], tuple[str]]:
        """A copy has a buffer of its own, to be drawn anew."""
        return Canvas, (self._image_size,)

    def show(self, scene: Scene) -> UInt8Array:
        """The buffer, showing `scene`; valid until the next call."""
        before, after = self._shown, scene.boxes
        self._shown = None  # until all is drawn: an interrupt leaves the buffer to be drawn as a whole
        if before is not None and (
            (after[0] is before[0] or self._update(0, before[0].items, after[0].items))
            and (after[1] is before[1] or self._update(1, before[1].items, after[1].items))
            and (after[2] is before[2] or self._update(2, before[2].items, after[2].items))
        ):
            self._shown = after
        else:
            self._begin(scene)
        return self.pixels

    def _update(self, index: int, before: tuple[Item, ...], after: tuple[Item, ...]) -> bool:
        """Makes a box show `after`; False, and nothing done, unless one item was added at the end or taken away."""
        difference = len(after) - len(before)
        if difference == 1 and after[:-1] == before:
            blit = _patch_blit(after[-1], before, self._looks, self._shrink, shown=True)
        elif difference == -1 and (taken := _taken(before, after)) is not None:
            blit = _patch_blit(taken, after, self._looks, self._shrink, shown=False)
        else:
            return False
        if blit is None:
            return False
        top, bottom, left, right, pixels = blit
        self._boxes[index][top:bottom, left:right] = pixels
        return True

    def _begin(self, scene: Scene) -> None:
        """Shows a scene that has little to do with the last one; from the second time on its picture is kept."""
        key, memo = self._memo_key, scene.memo
        picture: _Picture | None = memo.get(key)
        if picture is not None:
            self.pixels[:] = _empty(self._shrink)
            self._every_run[picture.starts] = picture.runs
            self._shown = scene.boxes
        elif not self._draw_items(scene):
            self.pixels[:] = draw(scene, self._image_size)
            inside = all(fits_box(item.kind, item.x, item.y) for item in scene.items())
            self._shown = scene.boxes if inside else None
        elif key not in memo:
            memo[key] = None
        elif _ROOM.left > 0:
            picture = memo[key] = _Picture.of(self.pixels, self._shrink)
            _ROOM.left -= picture.starts.nbytes + picture.runs.nbytes
            for box in scene.boxes:
                box.memo.pop(_BLITS_KEYS[self._shrink], None)  # the picture takes their place

    def _draw_items(self, scene: Scene) -> bool:
        """Shows the scene item by item; False, and nothing done, where that cannot be done."""
        by_box = [box_blits(box, self._shrink) for box in scene.boxes]
        if None in by_box:
            return False
        self.pixels[:] = _empty(self._shrink)
        for pixels, blits in zip(self._boxes, by_box, strict=True):
            for top, bottom, left, right, patch in blits or ():
                pixels[top:bottom, left:right] = patch
        self._shown = scene.boxes
        return True


def _taken(before: Sequence[Item], after: Sequence[Item]) -> Item | None:
    """The one item of `before` that `after` lacks, if that is all the difference."""
    first = 0
    for item in after:
        if item is not before[first]:
            break
        first += 1
    return before[first] if before[first + 1 :] == after[first:] else None


TEXT_CELL = (5, 10)  # width and height in native pixels of one character
_TEXT_COLOURS = {Colour.YELLOW: 33, Colour.BLACK: 30, Colour.BLUE: 34}
_TEXT_SHAPES = {Shape.CIRCLE: "o", Shape.SQUARE: "#", Shape.TRIANGLE: "^"}


def text(
    scene: Scene, lines: Sequence[str], *, coloured: bool = True, mark: Callable[[Item], str] | None = None
) -> str:
    """The scene as lines of characters for a terminal (o circle, # square, ^ triangle), then `lines`.

    Without colours, yellow is y, black k and blue b, and the shapes are not told apart. `mark`: an item's own
    character instead.
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
    return 0 <= column < item.side and 0 <= row < item.side and bool(_mask(item.kind)[row, column])


def _text_mark(item: Item, *, coloured: bool) -> str:
    if not coloured:
        return {Colour.YELLOW: "y", Colour.BLACK: "k", Colour.BLUE: "b"}[item.colour]
    return f"\x1b[1;{_TEXT_COLOURS[item.colour]}m{_TEXT_SHAPES[item.shape]}\x1b[0m"
