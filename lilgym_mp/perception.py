"""Reconstructs scenes from images: the inverse of `render.draw`. docs/perception.md says what an image determines.

An image pixel covers shrink x shrink native pixels. Its colour determines its *coverage*: how many of them each item
colour covers. Coverages of items that do not occlude each other add up, so items are found by matching templates, from
the topmost row and its leftmost pixel on. Items that occlude others or are cut off by the image border, as happens now
and then under the released rules, are not read.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache
from itertools import combinations, product
from threading import Lock
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances.placement import fits_box, is_free
from lilgym_mp.appearances.tower import BLOCK_X, LEVEL_Y, tower_tables
from lilgym_mp.arrays import UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.render import draw, image_shape
from lilgym_mp.render.drawing import BOX_RGB, COLOUR_RGB, SEPARATOR_RGB, SHRINKS, palette, stamp
from lilgym_mp.scene import (
    BOX_COUNT,
    BOX_PITCH,
    BOX_SIDE,
    FOOTPRINT_COUNT,
    FOOTPRINT_SIDES,
    IMAGE_HEIGHT,
    SEPARATOR_WIDTH,
    Box,
    Colour,
    Item,
    Scene,
    Shape,
    Size,
)

__all__ = ["MARGIN", "PerceptionError", "image_size_of", "read_scene", "read_scenes"]

MARGIN = SEPARATOR_WIDTH // 2  # native pixels by which an item may leave its box; further out its box is ambiguous
CACHE_BYTES = 32 << 20  # budget for cached box pixels per image size: about 3,300 boxes at half size
BATCH_SIZE = 64  # images read at once
MAX_TRIALS = 3000  # budget of a decomposition: placements tried for one component


class PerceptionError(ValueError):
    """The image is not a drawing of any scene without occluded items, or none was found within the search budget."""


def read_scene(image: UInt8Array, appearance: str) -> Scene:
    """The scene shown by `image`; drawing it gives exactly `image`.

    `image`: uint8 (50, 190, 3), half size, or (100, 380, 3), native; `appearance`: "tower" or "scatter".
    Tower blocks are ordered from bottom to top; Scatter items by x, then y.
    Raises PerceptionError naming the wrong size, pixel or box, also if items occlude one another.
    """
    return _reader_for(appearance)(_check_image(image))


def read_scenes(images: Iterable[UInt8Array], appearance: str) -> list[Scene]:
    """`read_scene` of each image; fastest for an array (n, 50, 190, 3). Errors name the index of the image."""
    read = _reader_for(appearance)
    if read is _read_scatter and isinstance(images, np.ndarray):
        array = cast("UInt8Array", images)
        if array.dtype == np.uint8 and array.shape[1:] in _shrink_by_shape():
            return _read_scatter_batch(array)
    scenes: list[Scene] = []
    for index, image in enumerate(cast("Iterable[UInt8Array]", images)):
        try:
            scenes.append(read(_check_image(image)))
        except PerceptionError as fault:
            raise PerceptionError(f"image {index}: {fault}") from None
    return scenes


def image_size_of(image: UInt8Array) -> str:
    """The image size, "half" or "native". Raises PerceptionError for any other array."""
    shrink = _shrink_by_shape()[_check_image(image).shape]
    return next(name for name, value in SHRINKS.items() if value == shrink)


def _reader_for(appearance: str) -> Callable[[UInt8Array], Scene]:
    return choose("appearance", appearance, {"tower": _read_tower, "scatter": _read_scatter})


@cache
def _shrink_by_shape() -> Mapping[tuple[int, ...], int]:
    return {image_shape(name): shrink for name, shrink in SHRINKS.items()}


def _check_image(image: object) -> UInt8Array:
    if isinstance(image, np.ndarray):
        array = cast("UInt8Array", image)
        if array.dtype == np.uint8 and array.shape in _shrink_by_shape():
            return array
        got = f"{array.dtype} {array.shape}"
    else:
        got = repr(type(image).__name__)
    shapes = " or ".join(map(str, sorted(_shrink_by_shape())))
    raise PerceptionError(f"an image must be a uint8 array of shape {shapes}, not {got}")


# Tower


@cache
def _tower_images(shrink: int) -> tuple[UInt8Array, UInt8Array]:
    """The image of each box of `tower_tables` (121, height, width, 3), and of the empty scene."""
    name = {value: key for key, value in SHRINKS.items()}[shrink]
    side = BOX_SIDE // shrink
    scenes = [Scene((box, Box(), Box())) for box in tower_tables().boxes]
    return np.stack([draw(scene, name)[:, :side] for scene in scenes]), draw(Scene.empty(), name)


@cache
def _tower_indices() -> dict[tuple[int, ...], int]:
    """Box index by the green channel at the centre of each level; colours and background differ in green."""
    greens = {-1: BOX_RGB[1], **{int(colour): rgb[1] for colour, rgb in COLOUR_RGB.items()}}
    rows = tower_tables().colours.tolist()
    return {tuple(greens[colour] for colour in row): index for index, row in enumerate(rows)}


@cache
def _tower_level_centres(shrink: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows (3, 4) and columns (3, 4) of the pixel at the centre of each level of each box."""
    rows = np.array([(y + 10) // shrink for y in LEVEL_Y])
    columns = np.array([(box * BOX_PITCH + BLOCK_X + 10) // shrink for box in range(BOX_COUNT)])
    return np.broadcast_to(rows, (BOX_COUNT, len(rows))), np.broadcast_to(columns[:, None], (BOX_COUNT, len(rows)))


def _read_tower(image: UInt8Array) -> Scene:
    shrink = _shrink_by_shape()[image.shape]
    rows, columns = _tower_level_centres(shrink)
    tower_indices = _tower_indices()
    images, empty = _tower_images(shrink)
    expected = empty.copy()
    boxes: list[Box] = []
    for index, greens in enumerate(image[rows, columns, 1].tolist()):
        tower = tower_indices.get(tuple(greens))
        if tower is None:
            raise PerceptionError(f"box {index}: no tower has the green values {greens} at its levels, bottom to top")
        left = index * BOX_PITCH // shrink
        expected[:, left : left + BOX_SIDE // shrink] = images[tower]
        boxes.append(tower_tables().boxes[tower])
    if not np.array_equal(image, expected):
        row, column = np.argwhere((image != expected).any(axis=2))[0].tolist()
        raise PerceptionError(
            f"pixel (row {row}, column {column}) is {image[row, column].tolist()};"
            f" with these towers it would be {expected[row, column].tolist()}"
        )
    left, middle, right = boxes
    return Scene((left, middle, right))


# Scatter: pixels as coverages


class _CoverageTables(NamedTuple):
    """Lookup tables by pixel hash: a perfect hash (mod 256) of the possible red, green and blue values."""

    factors: tuple[np.uint8, np.uint8]  # multipliers of green and blue in the hash
    pixels: UInt8Array  # (512, 3) the pixel with each hash inside a box, then on a separator
    bare: int  # hash of an uncovered separator pixel
    yellow_black: bytes  # (256,) yellow coverage + 16 * black coverage
    blue: bytes  # (256,) blue coverage


@cache
def _coverage_tables(shrink: int) -> _CoverageTables:
    area = shrink**2
    axes = np.indices((area + 1,) * len(Colour)).reshape(len(Colour), -1).T
    coverage = axes[axes.sum(axis=1) <= area]  # (n, 3) every possible coverage of a pixel
    bare = area - coverage.sum(axis=1, keepdims=True)
    painted = coverage @ np.array([COLOUR_RGB[colour] for colour in Colour])
    pixels: NDArray[np.int64] = np.concatenate(
        [(painted + bare * np.array(rgb)) // area for rgb in (BOX_RGB, SEPARATOR_RGB)]
    )
    distinct = len(np.unique(pixels, axis=0))
    green, blue = next(
        factors
        for factors in product(range(1, 256), repeat=2)
        if len(np.unique(pixels @ (1, *factors) % 256)) == distinct
    )
    hashes: NDArray[np.int64] = pixels @ (1, green, blue) % 256
    in_box, on_separator = hashes[: len(coverage)], hashes[len(coverage) :]
    table = np.zeros((512, 3), np.uint8)
    table[:, 0] = np.arange(512) + 1  # unused hashes: a pixel that does not have this hash
    table[in_box] = pixels[: len(coverage)]
    table[on_separator + 256] = pixels[len(coverage) :]
    by_hash = np.zeros((len(Colour), 256), np.uint8)
    by_hash[:, in_box] = by_hash[:, on_separator] = coverage.T
    return _CoverageTables(
        (np.uint8(green), np.uint8(blue)),
        table,
        bare=int(on_separator[0]),
        yellow_black=(by_hash[Colour.YELLOW] + 16 * by_hash[Colour.BLACK]).tobytes(),
        blue=by_hash[Colour.BLUE].tobytes(),
    )


class _Region(NamedTuple):
    """Image region of a box and the adjacent halves of the separators."""

    columns: slice  # columns of the image
    before: int  # columns to the left of the box
    after: int  # columns to the right of the box
    offsets: NDArray[np.uint16]  # (columns,) offset into `_CoverageTables.pixels`: 0 in the box, 256 on separators


@cache
def _regions(shrink: int) -> tuple[_Region, ...]:
    return tuple(_region(index, shrink) for index in range(BOX_COUNT))


def _region(index: int, shrink: int) -> _Region:
    first, side = index * BOX_PITCH // shrink, BOX_SIDE // shrink
    before = MARGIN // shrink if index else 0
    after = MARGIN // shrink if index < BOX_COUNT - 1 else 0
    offsets = np.full(before + side + after, 256, np.uint16)
    offsets[before : before + side] = 0
    return _Region(slice(first - before, first + side + after), before, after, offsets)


def _hashes(pixels: UInt8Array, index: int, shrink: int) -> UInt8Array:
    """(height, columns) hashes of a region's pixels. Raises PerceptionError for a pixel that no scene has there."""
    tables, region = _coverage_tables(shrink), _regions(shrink)[index]
    green, blue = tables.factors
    channels = pixels.reshape(-1, 3).T.copy()
    hashes = channels[1] * green
    hashes += channels[2] * blue
    hashes += channels[0]
    hashes = hashes.reshape(len(pixels), -1)
    entries = hashes.astype(np.uint16)
    entries += region.offsets
    wrong = np.not_equal(tables.pixels[entries], pixels)
    if wrong.any():
        row, column = np.argwhere(wrong.any(axis=2))[0].tolist()
        column_in_image = column + region.columns.start
        raise PerceptionError(
            f"pixel (row {row}, column {column_in_image}) is {pixels[row, column].tolist()}: no scene has it there"
        )
    return hashes


# Scatter: items that do not occlude each other

# The coverage of a box with MARGIN on each side is packed into one big int per colour: a byte per pixel, row by row.
# Items are matched at the lowest non-zero byte.


class _Template(NamedTuple):
    """A footprint drawn at even or odd coordinates, packed into ints (a byte per pixel) from its anchor pixel on.

    The anchor is the first non-empty pixel of the first row.
    """

    shape: Shape
    size: Size
    odd_x: int
    odd_y: int
    anchor_column: int
    width: int  # pixels
    coverage: int
    neighbourhood: int  # 255 in its pixels and their neighbours
    guard: int  # 128 in its pixels
    anchor_coverage: int
    native_bits: int  # a bit for each native pixel, in rows of REGION_SIDE, from the corner of the bounding square on


REGION_SIDE = BOX_SIDE + 2 * MARGIN  # native pixels


@cache
def _templates(shrink: int) -> tuple[_Template, ...]:
    """Templates of all footprints and parities, largest first."""
    odd = range(shrink)
    templates = [_template(footprint, x, y, shrink) for footprint in range(FOOTPRINT_COUNT) for x in odd for y in odd]
    return tuple(sorted(templates, key=lambda template: -template.native_bits.bit_count()))


def _template(footprint: int, odd_x: int, odd_y: int, shrink: int) -> _Template:
    coverage = _template_coverage(footprint, odd_x, odd_y, shrink)
    rows, columns = coverage.shape
    pitch = REGION_SIDE // shrink
    padded = np.zeros((rows + 2, pitch), np.uint8)
    padded[1:-1, 1 : columns + 1] = coverage
    neighbourhood = np.zeros_like(padded)
    for row, column in np.argwhere(padded):
        neighbourhood[row - 1 : row + 2, column - 1 : column + 2] = 255
    anchor_column = int(np.flatnonzero(coverage[0])[0])
    start = pitch + 1 + anchor_column
    return _Template(
        Shape(footprint // len(Size)),
        Size(footprint % len(Size)),
        odd_x,
        odd_y,
        anchor_column,
        columns,
        _as_int(padded, start),
        _as_int(neighbourhood, start),
        _as_int((padded > 0) * np.uint8(128), start),
        int(coverage[0, anchor_column]),
        _native_bits(footprint),
    )


@cache
def _template_coverage(footprint: int, odd_x: int, odd_y: int, shrink: int) -> UInt8Array:
    """(rows, columns) native pixels of an item in each image pixel it touches."""
    weight = palette(shrink).weights[Colour.YELLOW]
    return stamp(footprint, Colour.YELLOW, odd_x, odd_y, shrink).counts // np.uint8(weight)


def _as_int(entries: UInt8Array, start: int) -> int:
    return int.from_bytes(entries.tobytes()[start:], "little")


def _native_bits(footprint: int) -> int:
    drawn = np.zeros((FOOTPRINT_SIDES[footprint], REGION_SIDE), np.uint8)
    drawn[:, : FOOTPRINT_SIDES[footprint]] = _template_coverage(footprint, 0, 0, 1)
    return int.from_bytes(np.packbits(drawn, bitorder="little").tobytes(), "little")


@cache
def _templates_by_first_row(shrink: int) -> tuple[int, Mapping[int, Sequence[_Template]]]:
    """A mask for the bytes of a template's first row, and the templates by those bytes."""
    templates = _templates(shrink)
    pitch = REGION_SIDE // shrink
    mask = (1 << 8 * (max(template.width for template in templates) + 1)) - 1
    found: dict[int, list[_Template]] = {}
    for template in templates:
        first_row = template.coverage & ((1 << 8 * (pitch - template.anchor_column)) - 1) & mask
        found.setdefault(first_row, []).append(template)
    return mask, found


Placement = tuple[_Template, Colour, int]  # the int: index of the anchor's byte in the packed coverage


def _item(placement: Placement, shrink: int) -> Item:
    template, colour, position = placement
    row, column = divmod(position, REGION_SIDE // shrink)
    x = (column - template.anchor_column) * shrink + template.odd_x - MARGIN
    return Item(x, row * shrink + template.odd_y, template.shape, colour, template.size)


class _Component(NamedTuple):
    """A connected component of one colour that is not a single whole item."""

    colour: Colour
    coverage: int
    position: int  # index of the lowest byte of `coverage` in the box


def _match_isolated(coverage: int, colour: Colour, shrink: int) -> tuple[list[Item], list[_Component]]:
    """Matches the items of a colour that touch no others of it; returns them and the remaining connected components."""
    mask, templates_by_first_row = _templates_by_first_row(shrink)
    items: list[Item] = []
    components: list[_Component] = []
    position = 0
    while coverage:
        skipped = ((coverage & -coverage).bit_length() - 1) >> 3
        coverage >>= 8 * skipped
        position += skipped
        for template in templates_by_first_row.get(coverage & mask, ()):
            if coverage & template.neighbourhood == template.coverage:
                items.append(_item((template, colour, position), shrink))
                coverage ^= template.coverage
                break
        else:
            component = _connected_component(coverage, shrink)
            coverage ^= component
            components.append(_Component(colour, component, position))
    return items, components


@cache
def _ones(shrink: int) -> int:
    """A packed box with 1 in each byte."""
    return int.from_bytes(b"\1" * (REGION_SIDE * BOX_SIDE // shrink**2), "little")


def _connected_component(coverage: int, shrink: int) -> int:
    """The 8-connected component of `coverage` that contains its lowest byte, which must be non-zero."""
    ones = _ones(shrink)
    present = (((coverage + 127 * ones) >> 7) & ones) * 255
    row = 8 * (REGION_SIDE // shrink)
    component, grown = 0, 255
    while grown != component:
        component = grown
        wide = component | component << 8 | component >> 8
        grown = (wide | wide << row | wide >> row) & present
    return coverage & component


class _Decomposition:
    """Searches for the fewest items of one colour whose coverages add up to that of a connected component."""

    def __init__(self, colour: Colour, shrink: int, *, legal: bool, all_minimal: bool = False) -> None:
        """`legal`: items must lie in the box without overlapping; `all_minimal`: find all minimal decompositions."""
        self._colour, self._shrink, self._legal, self._all_minimal = colour, shrink, legal, all_minimal
        self._trials = 0
        self.found: list[list[Item]] = []

    def search(self, coverage: int, position: int, chosen: list[Item]) -> None:
        if not coverage:
            if self.found and len(chosen) < len(self.found[0]):
                self.found.clear()
            self.found.append(chosen.copy())
            return
        if self.found and len(chosen) + 1 + (not self._all_minimal) > len(self.found[0]):
            return
        skipped = ((coverage & -coverage).bit_length() - 1) >> 3
        coverage >>= 8 * skipped
        position += skipped
        value = coverage & 255
        for template in _templates(self._shrink):
            if (
                template.anchor_coverage > value
                or ((coverage | template.guard) - template.coverage) & template.guard != template.guard
            ):
                continue
            self._trials += 1
            if self._trials > MAX_TRIALS:
                return
            item = _item((template, self._colour, position), self._shrink)
            if -MARGIN <= item.x <= BOX_SIDE + MARGIN - item.side and (not self._legal or _fits_legally(item, chosen)):
                chosen.append(item)
                self.search(coverage - template.coverage, position, chosen)
                chosen.pop()


def _fits_legally(item: Item, others: Sequence[Item]) -> bool:
    """Whether an item lies in the box and overlaps none of the others."""
    return fits_box(item.footprint, item.x, item.y) and is_free(item.footprint, item.x, item.y, others)


def _decompose(component: _Component, shrink: int) -> list[Item] | None:
    """The fewest items that compose a component, preferring legal placements; None if there are none."""
    for legal in (True, False):
        decomposition = _Decomposition(component.colour, shrink, legal=legal)
        decomposition.search(component.coverage, component.position, [])
        if decomposition.found:
            return decomposition.found[0]
    return None


def _are_disjoint(items: Sequence[Item], shrink: int) -> bool:
    """Whether no two items cover the same native pixel."""
    masks = {(template.shape, template.size): template.native_bits for template in _templates(shrink)}
    drawn = 0
    for item in items:
        own = masks[item.shape, item.size] << ((item.y + MARGIN) * REGION_SIDE + item.x + MARGIN)
        if drawn & own:
            return False
        drawn |= own
    return True


class _BoxCache:
    """Cache of the boxes read in one region of the image, by the region's pixels; cleared when full."""

    def __init__(self, index: int, shrink: int) -> None:
        region, height = _regions(shrink)[index], IMAGE_HEIGHT // shrink
        self._index, self._shrink = index, shrink
        self._bytes = 3 * len(region.offsets) * height
        words = -(-self._bytes // 8)
        self._factors = np.random.default_rng(0).integers(1 << 63, size=words, dtype=np.uint64) * 2 + 1
        self._capacity = CACHE_BYTES // BOX_COUNT // (8 * words)
        self._pixels = np.zeros((0, words), np.uint64)  # (allocated, words) pixels of each cached box
        self._boxes: list[Box] = []
        self._rows: dict[int, int] = {}  # hash -> index in `_pixels` and `_boxes`
        self._lock = Lock()

    def read(self, images: UInt8Array) -> list[Box | PerceptionError]:
        """The box in each image, up to and including the first error."""
        pixels = np.zeros((len(images), 8 * self._pixels.shape[1]), np.uint8)
        columns = _regions(self._shrink)[self._index].columns
        count, height, width, _ = images.shape
        rows = images.reshape(count, height, 3 * width)[:, :, 3 * columns.start : 3 * columns.stop]
        pixels[:, : self._bytes].reshape(rows.shape)[...] = rows  # writes through a view
        words = pixels.view(np.uint64)
        hashes: list[int] = np.einsum("ij,j->i", words, self._factors).tolist()
        with self._lock:
            cached_rows = [self._rows.get(value, 0) for value in hashes]
            known = (self._pixels[cached_rows] == words).all(axis=1) if self._boxes else np.zeros(len(images), np.bool_)
            found: list[Box | PerceptionError] = []
            cached = self._boxes  # `_read_new` may replace the list
            for index, (row, is_known) in enumerate(zip(cached_rows, known.tolist(), strict=True)):
                found.append(cached[row] if is_known else self._read_new(pixels[index], words[index], hashes[index]))
                if isinstance(found[-1], PerceptionError):
                    break
        return found

    def _read_new(self, pixels: UInt8Array, words: NDArray[np.uint64], pixel_hash: int) -> Box | PerceptionError:
        row = self._rows.get(pixel_hash)
        if row is not None and np.array_equal(self._pixels[row], words):  # cached earlier in the same call
            return self._boxes[row]
        try:
            box = _read_box(pixels[: self._bytes].tobytes(), self._index, self._shrink)
        except PerceptionError as fault:
            return fault
        if len(self._boxes) >= self._capacity:
            self._boxes, self._rows = [], {}
        row = len(self._boxes)
        if row >= len(self._pixels):
            added = np.zeros((min(self._capacity, 64 + 2 * row) - row, self._pixels.shape[1]), np.uint64)
            self._pixels = np.concatenate([self._pixels, added])
        self._pixels[row] = words
        self._boxes.append(box)
        self._rows[pixel_hash] = row
        return box


@cache
def _box_caches(shrink: int) -> Sequence[_BoxCache]:
    return [_BoxCache(index, shrink) for index in range(BOX_COUNT)]


def _coverages(pixels: bytes, index: int, shrink: int) -> list[int]:
    """The packed coverage of a region by colour; margins beyond the image are padded."""
    height = IMAGE_HEIGHT // shrink
    tables, region = _coverage_tables(shrink), _regions(shrink)[index]
    hashes = _hashes(np.frombuffer(pixels, np.uint8).reshape(height, -1, 3), index, shrink)
    if not (region.before and region.after):
        padded = np.full((height, REGION_SIDE // shrink), tables.bare, np.uint8)
        start = MARGIN // shrink - region.before
        padded[:, start : start + hashes.shape[1]] = hashes
        hashes = padded
    by_pixel = hashes.tobytes()
    yellow_black = int.from_bytes(by_pixel.translate(tables.yellow_black), "little")
    low = _ones(shrink) * 15
    blue = int.from_bytes(by_pixel.translate(tables.blue), "little")
    return [yellow_black & low, (yellow_black >> 4) & low, blue]


def _read_box(pixels: bytes, index: int, shrink: int) -> Box:
    """The box shown by the pixels of a region."""
    coverages = _coverages(pixels, index, shrink)
    items: list[Item] = []
    components: list[_Component] = []
    for colour, coverage in zip(Colour, coverages, strict=True):
        if coverage:
            isolated, others = _match_isolated(coverage, colour, shrink)
            items += isolated
            components += others
    if components or (shrink > 1 and _has_mixed_pixels(coverages, shrink)):
        items = _separate(items, components, index, shrink)
    else:
        items.sort()
    return Box(tuple(items))


def _has_mixed_pixels(coverages: Sequence[int], shrink: int) -> bool:
    """Whether some pixel shows two colours."""
    present = [coverage for coverage in coverages if coverage]
    sevens = _ones(shrink) * 127
    flags = [coverage + sevens for coverage in present]  # bit 7 of each byte: whether the pixel shows the colour
    shared = 0
    for one, other in combinations(flags, 2):
        shared |= one & other
    return bool(shared & (sevens + _ones(shrink)))


def _separate(items: list[Item], components: Sequence[_Component], index: int, shrink: int) -> list[Item]:
    """All items of a box, in order, from its isolated items and the components of touching items."""
    for component in components:
        found = _decompose(component, shrink)
        if found is None:
            raise _occluded(index, [component.colour])
        items += found
    if not _are_disjoint(items, shrink):
        raise _occluded(index, {item.colour for item in items})
    return sorted(items)


def _occluded(index: int, colours: Collection[Colour]) -> PerceptionError:
    names = ", ".join(Colour(colour).name.lower() for colour in sorted(colours))
    return PerceptionError(
        f"box {index}: no items explain its {names} pixels; items that occlude one another, or that the image border"
        " cuts off, as the released rules allow, cannot be read"
    )


def _read_scatter(image: UInt8Array) -> Scene:
    found = [region.read(image[None])[0] for region in _box_caches(_shrink_by_shape()[image.shape])]
    return _scene(found)


def _read_scatter_batch(images: UInt8Array) -> list[Scene]:
    scenes: list[Scene] = []
    for first in range(0, len(images), BATCH_SIZE):
        some = images[first : first + BATCH_SIZE]
        columns = [region.read(some) for region in _box_caches(_shrink_by_shape()[images.shape[1:]])]
        for index, found in enumerate(zip(*columns, strict=False)):
            try:
                scenes.append(_scene(found))
            except PerceptionError as fault:
                raise PerceptionError(f"image {first + index}: {fault}") from None
    return scenes


def _scene(found: Sequence[Box | PerceptionError]) -> Scene:
    boxes: list[Box] = []
    for box in found:
        if isinstance(box, PerceptionError):
            raise box
        boxes.append(box)
    left, middle, right = boxes
    return Scene((left, middle, right))
