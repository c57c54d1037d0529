"""Reconstructs scenes from images: the inverse of `render.draw`. docs/perception.md says what an image determines.

An image pixel covers shrink x shrink native pixels. Its colour determines its *coverage*: how many of them each item
colour covers. Coverages of items that do not occlude each other add up, so items are found by matching templates, from
the topmost row and its leftmost pixel on. Items that occlude others or are cut off by the image border, as happens now
and then under the released rules, are not read.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from lilgym_mp.scene import (
    BOX_COUNT,
    BOX_SIDE,
    FOOTPRINT_COUNT,
    IMAGE_HEIGHT,
    SEPARATOR_WIDTH,
    Box,
    Colour,
    Item,
    Scene,
    Shape,
    Size,
)
from lilgym_mp.scene.appearances import APPEARANCES, part_of
from lilgym_mp.scene.appearances.base import fits_box
from lilgym_mp.scene.appearances.scatter.geometry import is_free
from lilgym_mp.scene.appearances.tower.geometry import tower_tables
from lilgym_mp.scene.arrays import Int64Array, UInt8Array
from lilgym_mp.scene.choices import choose
from lilgym_mp.scene.render import draw, image_shape
from lilgym_mp.scene.render.drawing import BOX_RGB, COLOUR_RGB, SEPARATOR_RGB, SHRINKS, palette, stamp

MARGIN = SEPARATOR_WIDTH // 2  # native pixels by which an item may leave its box; further out its box is ambiguous
PITCH = BOX_SIDE + 2 * MARGIN  # native pixels of a row of a box and the adjacent halves of separators
CACHED_BOXES = 2048  # about 10 kB each at half size, 40 kB at native size
MAX_TRIALS = 3000  # budget of a decomposition: placements tried for one component


class PerceptionError(ValueError):
    """The image is not a drawing of any scene without occluded items, or none was found within the search budget."""


def read_scene(image: UInt8Array, appearance: str) -> Scene:
    """The scene shown by an image; drawing it gives exactly `image`.

    Args:
        image: uint8 (50, 190, 3), half size, or (100, 380, 3), native.
        appearance: The appearance's name.

    Returns:
        The scene; Tower blocks are ordered from bottom to top, Scatter items by x, then y.

    Raises:
        PerceptionError: Naming the wrong size, pixel or box, also if items occlude one another.
    """
    choose("appearance", appearance, APPEARANCES)
    read_box = part_of(appearance, "reading from pixels", {"tower": _read_tower, "scatter": _read_box})
    shrink = _shrink_of(image)
    return Scene.of_boxes(read_box(pixels, index, shrink) for index, pixels in enumerate(_regions(image, shrink)))


def _shrink_of(image: object) -> int:
    """The native pixels along a pixel of the image. Raises PerceptionError if it has neither size."""
    array = np.asarray(image)
    shrinks = {image_shape(name): shrink for name, shrink in SHRINKS.items()}
    if array.dtype != np.uint8 or array.shape not in shrinks:
        shapes = " or ".join(map(str, sorted(shrinks)))
        raise PerceptionError(f"an image must be a uint8 array of shape {shapes}, not {array.dtype} {array.shape}")
    return shrinks[array.shape]


@cache
def _towers() -> Mapping[frozenset[Item], Box]:
    return {frozenset(box.items): box for box in tower_tables().boxes}


def _read_tower(pixels: bytes, index: int, shrink: int) -> Box:
    tower = _towers().get(frozenset(_read_box(pixels, index, shrink).items))
    if tower is None:
        raise PerceptionError(f"box {index}: its items are not a tower")
    return tower


@lru_cache(maxsize=CACHED_BOXES)
def _read_box(pixels: bytes, index: int, shrink: int) -> Box:
    """The box shown by the pixels of a region."""
    items: list[Item] = []
    for component in _components(pixels, index, shrink):
        found = _fewest(component, shrink, legal=True) or _fewest(component, shrink, legal=False)
        if found is None:
            raise _occluded(index, [component.colour])
        items += found
    box = Box(tuple(sorted(items)))
    size = next(name for name, value in SHRINKS.items() if value == shrink)
    if _regions(draw(Scene.empty().with_box(index, box), size), shrink)[index] != pixels:
        raise _occluded(index, {item.colour for item in items})
    return box


def _occluded(index: int, colours: Collection[Colour]) -> PerceptionError:
    names = ", ".join(Colour(colour).name.lower() for colour in sorted(colours))
    return PerceptionError(
        f"box {index}: no items explain its {names} pixels; items that occlude one another, or that the image border"
        " cuts off, as the released rules allow, cannot be read"
    )


# Pixels as coverages


def _regions(image: UInt8Array, shrink: int) -> list[bytes]:
    """The pixels of each box with MARGIN on each side, as if the image ended in halves of separators."""
    margin = MARGIN // shrink
    width = PITCH // shrink
    padded = np.full((len(image), BOX_COUNT * width, 3), SEPARATOR_RGB[0], np.uint8)  # grey
    padded[:, margin:-margin] = image
    return [padded[:, width * index : width * (index + 1)].tobytes() for index in range(BOX_COUNT)]


@cache
def _coverages_by_code(shrink: int) -> tuple[Int64Array, UInt8Array]:
    """The sorted codes of all pixels that occur, and their coverages (codes, colours)."""
    area = shrink**2
    axes = np.indices((area + 1,) * len(Colour)).reshape(len(Colour), -1).T
    coverage = axes[axes.sum(axis=1) <= area]
    bare = area - coverage.sum(axis=1, keepdims=True)
    painted = coverage @ np.array([COLOUR_RGB[colour] for colour in Colour])
    codes = [
        _codes((painted + bare * np.array(rgb)) // area, on_separator=np.array(on_separator))
        for on_separator, rgb in enumerate((BOX_RGB, SEPARATOR_RGB))
    ]
    distinct, firsts = np.unique(np.concatenate(codes), return_index=True)
    return distinct, coverage[firsts % len(coverage)].astype(np.uint8)


def _codes(pixels: Int64Array, *, on_separator: Int64Array) -> Int64Array:
    """(...) one number for each pixel (..., 3), which also says whether it is on a separator."""
    return pixels @ np.array([1 << 16, 1 << 8, 1]) + (on_separator << 24)


def _coverage(pixels: bytes, index: int, shrink: int) -> UInt8Array:
    """(colours, height, PITCH / shrink) in the region of a box. Raises PerceptionError for a pixel of no scene."""
    codes, coverages = _coverages_by_code(shrink)
    shown = np.frombuffer(pixels, np.uint8).reshape(IMAGE_HEIGHT // shrink, -1, 3)
    outside = np.ones(shown.shape[1], bool)
    outside[MARGIN // shrink : -MARGIN // shrink] = False
    found = _codes(shown.astype(np.int64), on_separator=outside.astype(np.int64))
    places = np.searchsorted(codes, found).clip(max=len(codes) - 1)
    wrong = codes[places] != found
    if wrong.any():
        row, column = np.argwhere(wrong)[0].tolist()
        image_column = column + (index * PITCH - MARGIN) // shrink
        raise PerceptionError(
            f"pixel (row {row}, column {image_column}) is {shown[row, column].tolist()}: no scene has it there"
        )
    return coverages[places].transpose(2, 0, 1)


# The coverage by one colour is packed into a big int, a byte per pixel, row by row. Items are matched at its lowest
# non-zero byte. With arrays of NumPy instead, a component of a Scatter image is found in 1,400 us, with ints in 12 us:
# shifts and adds of ints of some thousand bytes cost a fraction of what NumPy takes to begin an operation.


class _Component(NamedTuple):
    """Connected pixels that show one colour."""

    colour: Colour
    coverage: int
    position: int  # index of the lowest byte of `coverage` in the box


def _components(pixels: bytes, index: int, shrink: int) -> Iterator[_Component]:
    """The connected components in the region of a box."""
    for colour, packed in zip(Colour, _coverage(pixels, index, shrink), strict=True):
        coverage = int.from_bytes(packed.tobytes(), "little")
        position = 0
        while coverage:
            skipped = _first_byte(coverage)
            coverage >>= 8 * skipped
            position += skipped
            component = _connected(coverage, shrink)
            yield _Component(colour, component, position)
            coverage ^= component


def _first_byte(coverage: int) -> int:
    return ((coverage & -coverage).bit_length() - 1) >> 3


def _connected(coverage: int, shrink: int) -> int:
    """The 8-connected component of `coverage` that contains its lowest byte, which must be non-zero."""
    ones = _ones(shrink)
    present = (((coverage + 127 * ones) >> 7) & ones) * 255
    row = 8 * (PITCH // shrink)
    component = 0
    grown = 255
    while grown != component:
        component = grown
        wide = component | component << 8 | component >> 8
        grown = (wide | wide << row | wide >> row) & present
    return coverage & component


@cache
def _ones(shrink: int) -> int:
    """A packed box with 1 in each byte."""
    return int.from_bytes(b"\1" * (PITCH * BOX_SIDE // shrink**2), "little")


# Components as items


class _Template(NamedTuple):
    """A footprint drawn at even or odd coordinates, packed from its anchor on: the first non-empty pixel of the first
    row."""

    shape: Shape
    size: Size
    odd_x: int
    odd_y: int
    anchor_column: int
    coverage: int
    guard: int  # 128 in its pixels
    anchor_coverage: int


@cache
def _templates(shrink: int) -> Sequence[_Template]:
    """Templates of all footprints and parities, largest first."""
    odd = range(shrink)
    templates = [_template(footprint, x, y, shrink) for footprint in range(FOOTPRINT_COUNT) for x in odd for y in odd]
    return sorted(templates, key=lambda template: -sum(template.coverage.to_bytes(BOX_SIDE * PITCH, "little")))


def _template(footprint: int, odd_x: int, odd_y: int, shrink: int) -> _Template:
    weight = palette(shrink).weights[Colour.YELLOW]
    drawn = stamp(footprint, Colour.YELLOW, odd_x, odd_y, shrink).counts // np.uint8(weight)
    coverage = np.zeros((len(drawn), PITCH // shrink), np.uint8)
    coverage[:, : drawn.shape[1]] = drawn
    anchor = int(np.flatnonzero(drawn[0])[0])

    def packed(pixels: UInt8Array) -> int:
        return int.from_bytes(pixels.tobytes()[anchor:], "little")

    shape = Shape(footprint // len(Size))
    size = Size(footprint % len(Size))
    guard = (coverage > 0) * np.uint8(128)
    return _Template(shape, size, odd_x, odd_y, anchor, packed(coverage), packed(guard), int(drawn[0, anchor]))


def _fewest(component: _Component, shrink: int, *, legal: bool) -> list[Item] | None:
    """The fewest items whose coverages add up to that of a component, within a budget of MAX_TRIALS placements.

    `legal`: items must lie in the box without overlapping.
    """
    found: list[Item] | None = None
    trials = 0

    def search(coverage: int, position: int, chosen: list[Item]) -> None:
        nonlocal found, trials
        if not coverage:
            found = chosen
            return
        if found is not None and len(chosen) + 1 >= len(found):
            return
        skipped = _first_byte(coverage)
        coverage >>= 8 * skipped
        position += skipped
        for template in _templates(shrink):
            if (
                template.anchor_coverage > coverage & 255
                or ((coverage | template.guard) - template.coverage) & template.guard != template.guard
            ):
                continue
            trials += 1
            if trials > MAX_TRIALS:
                return
            row, column = divmod(position, PITCH // shrink)
            x = (column - template.anchor_column) * shrink + template.odd_x - MARGIN
            item = Item(x, row * shrink + template.odd_y, template.shape, component.colour, template.size)
            place = item.footprint, item.x, item.y
            fits = fits_box(*place) and is_free(*place, chosen) if legal else True
            if fits and -MARGIN <= item.x <= BOX_SIDE + MARGIN - item.side:
                search(coverage - template.coverage, position, [*chosen, item])

    search(component.coverage, component.position, [])
    return found
