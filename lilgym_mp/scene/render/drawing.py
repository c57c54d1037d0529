"""The reference implementation of images: an image is a pure function of its scene.

Source: docs/spec.md, "Drawing". Shapes are rasterised by Pillow, as in the release.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from lilgym_mp.scene import (
    BOX_COUNT,
    BOX_PITCH,
    BOX_SIDE,
    FOOTPRINT_SIDES,
    FOOTPRINTS,
    IMAGE_HEIGHT,
    IMAGE_WIDTH,
    Colour,
    Item,
    Scene,
    Shape,
)
from lilgym_mp.scene.arrays import BoolArray, UInt8Array
from lilgym_mp.scene.choices import choose

BOX_RGB = (211, 211, 211)
SEPARATOR_RGB = (128, 128, 128)
COLOUR_RGB = {Colour.YELLOW: (250, 255, 0), Colour.BLACK: (0, 0, 0), Colour.BLUE: (15, 131, 255)}
SHRINKS = {"native": 1, "half": 2}  # by image size: side in native pixels of the block that becomes one pixel
LARGEST_PATCH = 2 + max(FOOTPRINT_SIDES)  # native side of the largest `Stamp`


def shrink_of(image_size: str) -> int:
    """The entry of SHRINKS. Raises ValueError naming the choices."""
    return choose("image_size", image_size, SHRINKS)


def image_shape(image_size: str) -> tuple[int, int, int]:
    """(height, width, 3)."""
    shrink = shrink_of(image_size)
    return IMAGE_HEIGHT // shrink, IMAGE_WIDTH // shrink, 3


_SHAPES = {footprint: shape for shape in Shape for footprint in FOOTPRINTS[shape]}


@cache
def item_mask(footprint: int) -> BoolArray:
    """(side, side) by row and column: the pixels of a footprint's bounding square that are drawn."""
    side = FOOTPRINT_SIDES[footprint]
    image = Image.new("1", (side, side))
    draw = ImageDraw.Draw(image)
    last = side - 1
    match _SHAPES[footprint]:
        case Shape.CIRCLE:
            draw.ellipse((0, 0, last, last), fill=1)
        case Shape.SQUARE:
            draw.rectangle((0, 0, last, last), fill=1)
        case Shape.TRIANGLE:
            draw.polygon([(last - last // 2, 0), (last, last), (0, last)], fill=1)
    return np.asarray(image, bool)


@cache
def empty_picture(shrink: int) -> UInt8Array:
    """An image of three empty boxes; read-only."""
    native = np.full((IMAGE_HEIGHT, IMAGE_WIDTH, 3), SEPARATOR_RGB, np.uint8)
    for index in range(BOX_COUNT):
        native[:, index * BOX_PITCH : index * BOX_PITCH + BOX_SIDE] = BOX_RGB
    image = _shrunk(native, shrink)
    image.flags.writeable = False
    return image


def draw(scene: Scene, image_size: str = "native") -> UInt8Array:
    """A new image of the scene.

    Args:
        scene: The scene.
        image_size: "native" or "half".

    Returns:
        uint8 (100, 380, 3), or (50, 190, 3) at half size.

    Raises:
        ValueError: For another `image_size`; the message names the choices.
    """
    pixels = empty_picture(1).copy()
    for index, box in enumerate(scene.boxes):
        for item in box.items:
            _paint(pixels, item, index * BOX_PITCH + item.x, item.y)
    return _shrunk(pixels, shrink_of(image_size))


def _paint(pixels: UInt8Array, item: Item, x: int, y: int) -> None:
    """Draws an item with its bounding square at (x, y) of the native image, clipped to the image."""
    side = item.side
    left = max(0, x)
    top = max(0, y)
    right = min(IMAGE_WIDTH, x + side)
    bottom = min(IMAGE_HEIGHT, y + side)
    if left < right and top < bottom:
        drawn = item_mask(item.footprint)[top - y : bottom - y, left - x : right - x]
        pixels[top:bottom, left:right][drawn] = COLOUR_RGB[item.colour]


def _shrunk(pixels: UInt8Array, shrink: int) -> UInt8Array:
    """The truncated mean of each block of shrink x shrink pixels."""
    if shrink == 1:
        return pixels
    total = pixels[::shrink, ::shrink].astype(np.uint16)
    for down in range(shrink):
        for across in range(shrink):
            if down or across:
                total += pixels[down::shrink, across::shrink]
    return (total // shrink**2).astype(np.uint8)


class Stamp(NamedTuple):
    """An item at even or odd coordinates, on the smallest patch of whole blocks that contains it."""

    sprite: UInt8Array  # (height, width, 3) pixels with the item alone
    counts: UInt8Array  # (height, width) number of the item's pixels in each block, times its colour's weight


class Palette(NamedTuple):
    """Lookup table from a block's weighted counts, summed over all items, to its colour."""

    weights: Mapping[Colour, int]
    colours: UInt8Array  # (highest weighted count + 1, 3)


@cache
def palette(shrink: int) -> Palette:
    """Weights that make counts of painted pixels a code, and the colour of a shrunken pixel per code."""
    base = shrink**2 + 1  # a block has 0 to shrink**2 pixels of each colour
    weights = {colour: base**colour for colour in Colour}
    codes = np.arange(shrink**2 * max(weights.values()) + 1, dtype=np.int64)[:, None]
    counts = np.concatenate([codes // weight % base for weight in weights.values()], axis=1)  # (codes, colours)
    bare = shrink**2 - counts.sum(axis=1, keepdims=True)  # negative for codes that do not occur
    painted = counts @ np.array([COLOUR_RGB[colour] for colour in weights], np.int64)
    total = painted + bare * np.array(BOX_RGB, np.int64)
    return Palette(weights, (total // shrink**2).clip(0, 255).astype(np.uint8))


@cache
def stamp(footprint: int, colour: Colour, odd_x: int, odd_y: int, shrink: int) -> Stamp:
    """The shrunken drawing of an item; `odd_x` and `odd_y` are the offsets of its corner from even pixels."""
    side = FOOTPRINT_SIDES[footprint]
    width = odd_x + side + (odd_x + side) % 2
    height = odd_y + side + (odd_y + side) % 2
    drawn = np.zeros((height, width), np.uint8)
    drawn[odd_y : odd_y + side, odd_x : odd_x + side] = item_mask(footprint)
    blocks = drawn.reshape(height // shrink, shrink, width // shrink, shrink).sum((1, 3), dtype=np.uint8)
    weights, colours = palette(shrink)
    counts = blocks * np.uint8(weights[colour])
    return Stamp(colours[counts], counts)
