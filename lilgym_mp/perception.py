"""Scenes read back from their pictures: the inverse of `render.draw`. docs/perception.md says what a picture tells.

A block (one pixel of the picture; 2 x 2 native pixels at half size) shows how many native pixels of each colour it
holds, so a picture is an array of counts for each colour, and items that do not hide each other add up in it. Items
are read one after another, from the topmost row and the leftmost block in it. Only where pixels are hidden, by other
items or by the picture's border, as happens under the released rules, the items are searched for from the front.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, lru_cache
from itertools import combinations, product
from threading import Lock
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances.placement import fits_box, is_free
from lilgym_mp.appearances.tower import BLOCK_X, LEVEL_Y, tower_tables
from lilgym_mp.arrays import BoolArray, UInt8Array
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

__all__ = ["MARGIN", "PerceptionError", "image_size_of", "read_scene", "read_scenes", "recoloured"]

MARGIN = SEPARATOR_WIDTH // 2  # pixels by which an item may leave its box; further out it might be the next box's
KEPT_BYTES = 32 << 20  # of pixels of boxes that are remembered, for each image size: some 3,300 boxes at half size
TOGETHER = 64  # pictures that are read at once
MOST_TRIALS = 3000  # placements tried for one colour of a box before it is given up
MOST_SEARCH_STEPS = 300  # and items placed in a search for hidden ones
MOST_HIDDEN_ITEMS = 6  # such a search looks for
CHOICES_A_STEP = 10  # placements followed at each step of it
PROBES = 12  # blocks of an item by which most places for it are ruled out

IntArray = NDArray[np.int16]


class PerceptionError(ValueError):
    """A picture that `render.draw` draws of no scene, or of none that could be found."""


def read_scene(image: UInt8Array, appearance: str) -> Scene:
    """The scene that `image` is a picture of: `draw` of it is `image`, pixel by pixel.

    `image`: uint8 (50, 190, 3), half size, or (100, 380, 3), native; `appearance`: "tower" or "scatter". A tower's
    blocks come from below; Scatter's items by x, then y, except that one drawn over another comes after it.
    Raises PerceptionError naming the size, the pixel or the box that is at fault.
    """
    return _reader(appearance)(_checked(image))


def read_scenes(images: Iterable[UInt8Array], appearance: str) -> list[Scene]:
    """`read_scene` of each of `images`; quickest for an array (n, 50, 190, 3). The fault of one names its index."""
    read = _reader(appearance)
    if read is _scatter and isinstance(images, np.ndarray):
        array = cast("UInt8Array", images)
        if array.dtype == np.uint8 and array.shape[1:] in _sizes():
            return _scatters(array)
    scenes: list[Scene] = []
    for index, image in enumerate(cast("Iterable[UInt8Array]", images)):
        try:
            scenes.append(read(_checked(image)))
        except PerceptionError as fault:
            raise PerceptionError(f"image {index}: {fault}") from None
    return scenes


def image_size_of(image: UInt8Array) -> str:
    """ "half" or "native". Raises PerceptionError for an array that is no image."""
    shrink = _sizes()[_checked(image).shape]
    return next(name for name, value in SHRINKS.items() if value == shrink)


def recoloured(image: UInt8Array, colours: Sequence[Colour]) -> UInt8Array:
    """A new picture of the same scene in other colours, without reading it; `colours`: what each colour becomes.

    Raises PerceptionError naming a pixel that no scene has there.
    """
    shrink = _sizes()[_checked(image).shape]
    table = _recoloured_pixels(tuple(colours), shrink)
    new = np.empty_like(image)
    for index, region in enumerate(_regions(shrink)):
        new[:, region.columns] = table.take(_hashes(image[:, region.columns], index, shrink), axis=0)
    return new


def _reader(appearance: str) -> Callable[[UInt8Array], Scene]:
    return choose("appearance", appearance, {"tower": _tower, "scatter": _scatter})


@cache
def _sizes() -> Mapping[tuple[int, ...], int]:
    return {image_shape(name): shrink for name, shrink in SHRINKS.items()}


def _checked(image: object) -> UInt8Array:
    if isinstance(image, np.ndarray):
        array = cast("UInt8Array", image)
        if array.dtype == np.uint8 and array.shape in _sizes():
            return array
        got = f"{array.dtype} {array.shape}"
    else:
        got = repr(type(image).__name__)
    choices = " or ".join(map(str, sorted(_sizes())))
    raise PerceptionError(f"an image must be a uint8 array of shape {choices}, not {got}")


# Tower


@cache
def _tower_pictures(shrink: int) -> tuple[UInt8Array, UInt8Array]:
    """(121, height, width, 3) the picture of each box of `tower_tables`, and the picture of the empty scene."""
    name = {value: key for key, value in SHRINKS.items()}[shrink]
    side = BOX_SIDE // shrink
    scenes = [Scene((box, Box(), Box())) for box in tower_tables().boxes]
    return np.stack([draw(scene, name)[:, :side] for scene in scenes]), draw(Scene.empty(), name)


@cache
def _tower_numbers() -> dict[tuple[int, ...], int]:
    """The number of a box by the green of its levels' centres (yellow, black, blue and bare differ in it)."""
    greens = {-1: BOX_RGB[1], **{int(colour): rgb[1] for colour, rgb in COLOUR_RGB.items()}}
    rows = tower_tables().colours.tolist()
    return {tuple(greens[colour] for colour in row): number for number, row in enumerate(rows)}


@cache
def _tower_places(shrink: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(3, 4) row and column of a pixel in the middle of each level of each box."""
    rows = np.array([(y + 10) // shrink for y in LEVEL_Y])
    columns = np.array([(box * BOX_PITCH + BLOCK_X + 10) // shrink for box in range(BOX_COUNT)])
    return np.broadcast_to(rows, (BOX_COUNT, len(rows))), np.broadcast_to(columns[:, None], (BOX_COUNT, len(rows)))


def _tower(image: UInt8Array) -> Scene:
    shrink = _sizes()[image.shape]
    rows, columns = _tower_places(shrink)
    numbers = _tower_numbers()
    pictures, empty = _tower_pictures(shrink)
    expected = empty.copy()
    boxes: list[Box] = []
    for index, greens in enumerate(image[rows, columns, 1].tolist()):
        number = numbers.get(tuple(greens))
        if number is None:
            raise PerceptionError(f"box {index}: the levels of a tower, from below, cannot have the green {greens}")
        left = index * BOX_PITCH // shrink
        expected[:, left : left + BOX_SIDE // shrink] = pictures[number]
        boxes.append(tower_tables().boxes[number])
    if not np.array_equal(image, expected):
        row, column = np.argwhere((image != expected).any(axis=2))[0].tolist()
        raise PerceptionError(
            f"pixel (row {row}, column {column}) is {image[row, column].tolist()};"
            f" it would be {expected[row, column].tolist()} with these towers"
        )
    left, middle, right = boxes
    return Scene((left, middle, right))


# Scatter: pixels as counts


class _Counting(NamedTuple):
    """What a pixel says of its block, by 256 values of a hash of its red, green and blue."""

    factors: tuple[np.uint8, np.uint8]  # of green and blue in the hash, which is taken modulo 256
    pixels: UInt8Array  # (512, 3) the pixel of a box that has the hash, then the pixel of a separator that has it
    counts: UInt8Array  # (3, 256) native pixels of each colour
    is_box: BoolArray  # (256,) whether a box has such pixels
    bare: int  # hash of a separator's pixel with nothing on it
    yellow_black: bytes  # (256,) yellow pixels, and 16 times the black ones
    blue: bytes  # (256,)


@cache
def _counting(shrink: int) -> _Counting:
    area = shrink**2
    axes = np.indices((area + 1,) * len(Colour)).reshape(len(Colour), -1).T
    counts = axes[axes.sum(axis=1) <= area]  # (n, 3) every mixture of colours in a block
    bare = area - counts.sum(axis=1, keepdims=True)
    painted = counts @ np.array([COLOUR_RGB[colour] for colour in Colour])
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
    in_box, on_separator = hashes[: len(counts)], hashes[len(counts) :]
    table = np.zeros((512, 3), np.uint8)
    table[:, 0] = np.arange(512) + 1  # a pixel that does not have this hash
    table[in_box] = pixels[: len(counts)]
    table[on_separator + 256] = pixels[len(counts) :]
    by_hash = np.zeros((len(Colour), 256), np.uint8)
    by_hash[:, in_box] = by_hash[:, on_separator] = counts.T
    return _Counting(
        (np.uint8(green), np.uint8(blue)),
        table,
        by_hash,
        is_box=np.isin(np.arange(256), in_box),
        bare=int(on_separator[0]),
        yellow_black=(by_hash[Colour.YELLOW] + 16 * by_hash[Colour.BLACK]).tobytes(),
        blue=by_hash[Colour.BLUE].tobytes(),
    )


@lru_cache(maxsize=64)
def _recoloured_pixels(colours: tuple[Colour, ...], shrink: int) -> UInt8Array:
    """(256, 3) what becomes of the pixel that has each hash."""
    counting = _counting(shrink)
    counts = counting.counts[[colours.index(colour) for colour in Colour]].astype(np.int64)
    bare = shrink**2 - counts.sum(axis=0)
    painted = counts.T @ np.array([COLOUR_RGB[colour] for colour in Colour])
    background = np.where(counting.is_box[:, None], BOX_RGB, SEPARATOR_RGB)
    return ((painted + bare[:, None] * background) // shrink**2).astype(np.uint8)


class _Region(NamedTuple):
    """A box of the picture with the halves of the separators beside it."""

    columns: slice  # of the picture
    before: int  # columns to the left of the box
    after: int
    tables: NDArray[np.uint16]  # (columns,) first entry of `_Counting.pixels` for each: 0, or 256 on separators


@cache
def _regions(shrink: int) -> tuple[_Region, ...]:
    return tuple(_region(index, shrink) for index in range(BOX_COUNT))


def _region(index: int, shrink: int) -> _Region:
    first, side = index * BOX_PITCH // shrink, BOX_SIDE // shrink
    before = MARGIN // shrink if index else 0
    after = MARGIN // shrink if index < BOX_COUNT - 1 else 0
    tables = np.full(before + side + after, 256, np.uint16)
    tables[before : before + side] = 0
    return _Region(slice(first - before, first + side + after), before, after, tables)


def _hashes(pixels: UInt8Array, index: int, shrink: int) -> UInt8Array:
    """(height, columns) of each pixel of a region. Raises PerceptionError naming one that no scene has there."""
    counting, region = _counting(shrink), _regions(shrink)[index]
    green, blue = counting.factors
    channels = pixels.reshape(-1, 3).T.copy()
    hashes = channels[1] * green
    hashes += channels[2] * blue
    hashes += channels[0]
    hashes = hashes.reshape(len(pixels), -1)
    entries = hashes.astype(np.uint16)
    entries += region.tables
    wrong = np.not_equal(counting.pixels[entries], pixels)
    if wrong.any():
        row, column = np.argwhere(wrong.any(axis=2))[0].tolist()
        place = f"row {row}, column {column + region.columns.start}"
        raise PerceptionError(f"pixel ({place}) is {pixels[row, column].tolist()}: no scene has it there")
    return hashes


# Scatter: items that hide nothing of each other

# A box with MARGIN pixels on each side is told of by a number for each colour, whose bytes are the counts, row by row.
# Items are found at its lowest byte that is not zero.


class _Look(NamedTuple):
    """How an item shows at even or odd coordinates, as bytes from the first block of its first row on."""

    shape: Shape
    size: Size
    odd_x: int
    odd_y: int
    first: int  # blocks of the patch before that block
    width: int  # blocks of the patch in a row
    counts: int
    around: int  # 255 in its blocks and their neighbours
    guard: int  # 128 in its blocks
    value: int  # of its first block
    pixels: int  # a bit for each native pixel, in rows of REGION_SIDE, from the bounding square's corner on


REGION_SIDE = BOX_SIDE + 2 * MARGIN  # native pixels


@cache
def _looks(shrink: int) -> tuple[_Look, ...]:
    """Of all footprints, the largest first."""
    odd = range(shrink)
    looks = [_look(footprint, x, y, shrink) for footprint in range(FOOTPRINT_COUNT) for x in odd for y in odd]
    return tuple(sorted(looks, key=lambda look: -look.pixels.bit_count()))


def _look(footprint: int, odd_x: int, odd_y: int, shrink: int) -> _Look:
    counts = _unit_counts(footprint, odd_x, odd_y, shrink)
    rows, columns = counts.shape
    pitch = REGION_SIDE // shrink
    spread = np.zeros((rows + 2, pitch), np.uint8)
    spread[1:-1, 1 : columns + 1] = counts
    near = np.zeros_like(spread)
    for row, column in np.argwhere(spread):
        near[row - 1 : row + 2, column - 1 : column + 2] = 255
    first = int(np.flatnonzero(counts[0])[0])
    start = pitch + 1 + first
    return _Look(
        Shape(footprint // len(Size)),
        Size(footprint % len(Size)),
        odd_x,
        odd_y,
        first,
        columns,
        _number(spread, start),
        _number(near, start),
        _number((spread > 0) * np.uint8(128), start),
        int(counts[0, first]),
        _bits(footprint),
    )


@cache
def _unit_counts(footprint: int, odd_x: int, odd_y: int, shrink: int) -> UInt8Array:
    """(rows, columns) native pixels of an item in each block of its patch."""
    weight = palette(shrink).weights[Colour.YELLOW]
    return stamp(footprint, Colour.YELLOW, odd_x, odd_y, shrink).counts // np.uint8(weight)


def _number(entries: UInt8Array, start: int) -> int:
    return int.from_bytes(entries.tobytes()[start:], "little")


def _bits(footprint: int) -> int:
    drawn = np.zeros((FOOTPRINT_SIDES[footprint], REGION_SIDE), np.uint8)
    drawn[:, : FOOTPRINT_SIDES[footprint]] = _unit_counts(footprint, 0, 0, 1)
    return int.from_bytes(np.packbits(drawn, bitorder="little").tobytes(), "little")


@cache
def _by_first_row(shrink: int) -> tuple[int, Mapping[int, Sequence[_Look]]]:
    """The looks by the bytes of their first row, with a mask for so many of them as matter."""
    looks = _looks(shrink)
    pitch = REGION_SIDE // shrink
    mask = (1 << 8 * (max(look.width for look in looks) + 1)) - 1
    found: dict[int, list[_Look]] = {}
    for look in looks:
        found.setdefault(look.counts & ((1 << 8 * (pitch - look.first)) - 1) & mask, []).append(look)
    return mask, found


Placed = tuple[_Look, Colour, int]  # a look whose first block is that byte of a box


def _item(placed: Placed, shrink: int) -> Item:
    look, colour, place = placed
    row, column = divmod(place, REGION_SIDE // shrink)
    x = (column - look.first) * shrink + look.odd_x - MARGIN
    return Item(x, row * shrink + look.odd_y, look.shape, colour, look.size)


class _Part(NamedTuple):
    """Blocks of a colour, connected with each other, that are not one whole item."""

    colour: Colour
    counts: int
    place: int  # byte of the box that is the lowest of `counts`


def _alone(counts: int, colour: Colour, shrink: int) -> tuple[list[Item], list[_Part]]:
    """The items of a colour that stand apart from others of it, and what else there is, in connected parts."""
    mask, by_first_row = _by_first_row(shrink)
    items: list[Item] = []
    parts: list[_Part] = []
    place = 0
    while counts:
        skipped = ((counts & -counts).bit_length() - 1) >> 3
        counts >>= 8 * skipped
        place += skipped
        for look in by_first_row.get(counts & mask, ()):
            if counts & look.around == look.counts:
                items.append(_item((look, colour, place), shrink))
                counts ^= look.counts
                break
        else:
            part = _connected(counts, shrink)
            counts ^= part
            parts.append(_Part(colour, part, place))
    return items, parts


@cache
def _ones(shrink: int) -> int:
    """A 1 in each byte of a box."""
    return int.from_bytes(b"\1" * (REGION_SIDE * BOX_SIDE // shrink**2), "little")


def _connected(counts: int, shrink: int) -> int:
    """The part of `counts`, whose lowest byte is not zero, that is connected with that byte, corners included."""
    ones = _ones(shrink)
    present = (((counts + 127 * ones) >> 7) & ones) * 255
    row = 8 * (REGION_SIDE // shrink)
    part, grown = 0, 255
    while grown != part:
        part = grown
        wide = part | part << 8 | part >> 8
        grown = (wide | wide << row | wide >> row) & present
    return counts & part


class _Assembly:
    """A search for the fewest items of a colour whose counts add up to those of a connected part."""

    def __init__(self, colour: Colour, shrink: int, *, legal: bool, every: bool = False) -> None:
        """`legal`: only items that lie in the box and overlap none of each other; `every`: all that are as few."""
        self._colour, self._shrink, self._legal, self._every = colour, shrink, legal, every
        self._trials = 0
        self.found: list[list[Item]] = []

    def search(self, counts: int, place: int, chosen: list[Item]) -> None:
        if not counts:
            if self.found and len(chosen) < len(self.found[0]):
                self.found.clear()
            self.found.append(chosen.copy())
            return
        if self.found and len(chosen) + 1 + (not self._every) > len(self.found[0]):
            return
        skipped = ((counts & -counts).bit_length() - 1) >> 3
        counts >>= 8 * skipped
        place += skipped
        value = counts & 255
        for look in _looks(self._shrink):
            if look.value > value or ((counts | look.guard) - look.counts) & look.guard != look.guard:
                continue
            self._trials += 1
            if self._trials > MOST_TRIALS:
                return
            item = _item((look, self._colour, place), self._shrink)
            if -MARGIN <= item.x <= BOX_SIDE + MARGIN - item.side and (not self._legal or _joins(item, chosen)):
                chosen.append(item)
                self.search(counts - look.counts, place, chosen)
                chosen.pop()


def _joins(item: Item, others: Sequence[Item]) -> bool:
    """Whether an item lies in the box and overlaps no other."""
    return fits_box(item.footprint, item.x, item.y) and is_free(item.footprint, item.x, item.y, others)


def _assembled(part: _Part, shrink: int) -> list[Item] | None:
    """The fewest items that make up a part, those of legal scenes before others; None where there are none."""
    for legal in (True, False):
        assembly = _Assembly(part.colour, shrink, legal=legal)
        assembly.search(part.counts, part.place, [])
        if assembly.found:
            return assembly.found[0]
    return None


def _are_apart(items: Sequence[Item], shrink: int) -> bool:
    """Whether no two items are drawn on the same native pixel."""
    pixels = {(look.shape, look.size): look.pixels for look in _looks(shrink)}
    drawn = 0
    for item in items:
        own = pixels[item.shape, item.size] << ((item.y + MARGIN) * REGION_SIDE + item.x + MARGIN)
        if drawn & own:
            return False
        drawn |= own
    return True


class _BoxesByPixels:
    """The boxes that were read last in a region of pictures."""

    def __init__(self, index: int, shrink: int) -> None:
        region, height = _regions(shrink)[index], IMAGE_HEIGHT // shrink
        self._index, self._shrink = index, shrink
        self._bytes = 3 * len(region.tables) * height
        words = -(-self._bytes // 8)
        self._factors = np.random.default_rng(0).integers(1 << 63, size=words, dtype=np.uint64) * 2 + 1
        self._most = KEPT_BYTES // BOX_COUNT // (8 * words)
        self._pixels = np.zeros((0, words), np.uint64)  # (room, words) of each box
        self._boxes: list[Box] = []
        self._places: dict[int, int] = {}  # among them, by hash
        self._lock = Lock()

    def read(self, images: UInt8Array) -> list[Box | PerceptionError]:
        """Each picture's box, or why it cannot be read; up to the first of those."""
        pixels = np.zeros((len(images), 8 * self._pixels.shape[1]), np.uint8)
        columns = _regions(self._shrink)[self._index].columns
        count, height, width, _ = images.shape
        rows = images.reshape(count, height, 3 * width)[:, :, 3 * columns.start : 3 * columns.stop]
        pixels[:, : self._bytes].reshape(rows.shape)[...] = rows  # a view: each row of `pixels` is without gaps
        words = pixels.view(np.uint64)
        hashes: list[int] = np.einsum("ij,j->i", words, self._factors).tolist()
        with self._lock:
            places = [self._places.get(value, 0) for value in hashes]
            known = (self._pixels[places] == words).all(axis=1) if self._boxes else np.zeros(len(images), np.bool_)
            found: list[Box | PerceptionError] = []
            kept = self._boxes
            for row, (place, is_known) in enumerate(zip(places, known.tolist(), strict=True)):
                found.append(kept[place] if is_known else self._new(pixels[row], words[row], hashes[row]))
                if isinstance(found[-1], PerceptionError):
                    break
        return found

    def _new(self, pixels: UInt8Array, words: NDArray[np.uint64], value: int) -> Box | PerceptionError:
        place = self._places.get(value)
        if place is not None and np.array_equal(self._pixels[place], words):  # read since, in the same call
            return self._boxes[place]
        try:
            box = _box(pixels[: self._bytes].tobytes(), self._index, self._shrink)
        except PerceptionError as fault:
            return fault
        if len(self._boxes) >= self._most:
            self._boxes, self._places = [], {}
        place = len(self._boxes)
        if place >= len(self._pixels):
            more = np.zeros((min(self._most, 64 + 2 * place) - place, self._pixels.shape[1]), np.uint64)
            self._pixels = np.concatenate([self._pixels, more])
        self._pixels[place] = words
        self._boxes.append(box)
        self._places[value] = place
        return box


@cache
def _boxes_by_pixels(shrink: int) -> Sequence[_BoxesByPixels]:
    """By region."""
    return [_BoxesByPixels(index, shrink) for index in range(BOX_COUNT)]


def _numbers(pixels: bytes, index: int, shrink: int) -> list[int]:
    """By colour, the counts of a region, to whose pixels a missing margin is added."""
    height = IMAGE_HEIGHT // shrink
    counting, region = _counting(shrink), _regions(shrink)[index]
    hashes = _hashes(np.frombuffer(pixels, np.uint8).reshape(height, -1, 3), index, shrink)
    if not (region.before and region.after):
        padded = np.full((height, REGION_SIDE // shrink), counting.bare, np.uint8)
        start = MARGIN // shrink - region.before
        padded[:, start : start + hashes.shape[1]] = hashes
        hashes = padded
    by_block = hashes.tobytes()
    yellow_black = int.from_bytes(by_block.translate(counting.yellow_black), "little")
    low = _ones(shrink) * 15
    blue = int.from_bytes(by_block.translate(counting.blue), "little")
    return [yellow_black & low, (yellow_black >> 4) & low, blue]


def _box(pixels: bytes, index: int, shrink: int) -> Box:
    """The box that the pixels of a region show."""
    numbers = _numbers(pixels, index, shrink)
    items: list[Item] = []
    parts: list[_Part] = []
    for colour, number in zip(Colour, numbers, strict=True):
        if number:
            alone, others = _alone(number, colour, shrink)
            items += alone
            parts += others
    if parts or (shrink > 1 and _mixed(numbers, shrink)):
        items = _entangled(items, parts, index, shrink)
    else:
        items.sort()
    return Box(tuple(items))


def _mixed(numbers: Sequence[int], shrink: int) -> bool:
    """Whether some block shows two colours."""
    present = [number for number in numbers if number]
    sevens = _ones(shrink) * 127
    flags = [number + sevens for number in present]  # bit 7 of each byte: whether the block shows the colour
    shared = 0
    for one, other in combinations(flags, 2):
        shared |= one & other
    return bool(shared & (sevens + _ones(shrink)))


def _entangled(items: list[Item], parts: Sequence[_Part], index: int, shrink: int) -> list[Item]:
    """All items of a box, in their order, from those that stand apart and the parts that show several."""
    assembled = [_assembled(part, shrink) for part in parts]
    visible = items + [item for found in assembled for item in found or ()]
    unread = [part for part, found in zip(parts, assembled, strict=True) if found is None]
    if not unread and _are_apart(visible, shrink):
        return sorted(visible)
    found = _behind(visible, unread, index, shrink) if unread else None
    if found is None and parts:
        found = _HiddenSearch(index, shrink).search(items, parts)
    if found is not None:
        return _in_order(found)
    names = ", ".join(Colour(colour).name.lower() for colour in sorted({part.colour for part in parts}))
    raise PerceptionError(f"box {index}: no items could be found that explain its {names or 'coloured'} pixels")


def _behind(visible: list[Item], parts: Sequence[_Part], index: int, shrink: int) -> list[Item] | None:
    """All items from the back to the front: those that show the parts, behind those that are `visible`.

    Each part is searched by itself first, which is quick; those that show nothing whole, together.
    """
    drawn: list[Item] = visible
    left: list[_Part] = []
    for part in parts:
        found = _HiddenSearch(index, shrink).search(drawn, [part])
        if found is None:
            left.append(part)
        else:
            drawn = found
    return _HiddenSearch(index, shrink).search(drawn, left) if left else drawn


# Scatter: items of which something is hidden


class _Hiding(NamedTuple):
    """A placement that explains some of what is not explained yet."""

    cost: int  # twice its hidden native pixels less those that it shows
    item: Item
    shown: IntArray  # (rows, columns) native pixels that it explains in each block of its patch


class _HiddenSearch:
    """Looks for items from the front to the back: what is found hides whatever lies behind it.

    Arrays tell of the box with MARGIN pixels on each side.
    """

    def __init__(self, index: int, shrink: int) -> None:
        self._shrink = shrink
        self._steps = 0
        unseen = np.zeros((REGION_SIDE, REGION_SIDE), np.bool_)  # native pixels in front of which something may lie
        unseen[:MARGIN] = unseen[MARGIN + BOX_SIDE :] = True
        if index == 0:
            unseen[:, :MARGIN] = True
        if index == BOX_COUNT - 1:
            unseen[:, MARGIN + BOX_SIDE :] = True
        self._unseen = unseen

    def search(self, front: Sequence[Item], parts: Sequence[_Part]) -> list[Item] | None:
        """All items from the back to the front: those that show the parts, and `front`."""
        side = REGION_SIDE // self._shrink
        margin = MARGIN // self._shrink
        counts = np.zeros((len(Colour), side, side), np.int16)
        for colour, part, place in parts:
            seen = (part << 8 * place).to_bytes(side * (side - 2 * margin), "little")
            counts[colour, margin:-margin] += np.frombuffer(seen, np.uint8).reshape(-1, side)
        unseen = self._unseen.copy()
        for item in front:
            unseen[_native(item)] |= _drawn(item.footprint)
        for limit in range(1, MOST_HIDDEN_ITEMS + 1):
            for anchored in (True, False):
                behind = self._placed(counts, unseen, limit, anchored=anchored)
                if behind is not None:
                    return [*reversed(behind), *front]
        return None

    def _placed(self, counts: IntArray, unseen: BoolArray, limit: int, *, anchored: bool) -> list[Item] | None:
        """At most `limit` items, from the front to the back, that show the counts.

        `anchored`: each shows the topmost, leftmost block of what those in front of it leave; that is quick to search.
        """
        left = int(counts.sum())
        if not left:
            return []
        if left > limit * max(FOOTPRINT_SIDES) ** 2 or self._steps >= MOST_SEARCH_STEPS:
            return None
        self._steps += 1
        choices = self._choices(counts, unseen, anchored=anchored)
        if limit == 1:
            choices = [hiding for hiding in choices if int(hiding.shown.sum()) == left]
        for hiding in choices[:CHOICES_A_STEP]:
            item = hiding.item
            rest, hidden = counts.copy(), unseen.copy()
            rest[item.colour][_blocks(item, self._shrink)] -= hiding.shown
            hidden[_native(item)] |= _drawn(item.footprint)
            behind = self._placed(rest, hidden, limit - 1, anchored=anchored)
            if behind is not None:
                return [item, *behind]
        return None

    def _choices(self, counts: IntArray, unseen: BoolArray, *, anchored: bool) -> list[_Hiding]:
        """Placements whose every visible pixel has the right colour: first those that show much and hide little."""
        found: list[_Hiding] = []
        row, column = np.argwhere(counts.any(axis=0))[0].tolist()
        for colour in Colour:
            if anchored and not counts[colour, row, column]:
                continue
            wanted = counts[colour]
            if anchored:
                wanted = np.zeros_like(wanted)
                wanted[row, column] = counts[colour, row, column]
            if not wanted.any():
                continue
            for item in self._candidates(counts[colour], wanted, unseen, colour):
                shown = _by_block(item, unseen[_native(item)], self._shrink)
                place = _blocks(item, self._shrink)
                if (shown > counts[colour][place]).any() or not (shown * wanted[place]).any():
                    continue
                hidden = int(np.count_nonzero(_drawn(item.footprint)) - shown.sum())
                found.append(_Hiding(2 * hidden - int(shown.sum()), item, shown))
        return sorted(found, key=lambda hiding: (hiding.cost, hiding.item))

    def _candidates(self, counts: IntArray, wanted: IntArray, unseen: BoolArray, colour: Colour) -> Iterator[Item]:
        """Placements at which each block has room for the item, if all that is unseen in it belongs to the item.

        Only those whose patch is not all outside of the smallest rectangle around what is `wanted`.
        """
        shrink = self._shrink
        side = REGION_SIDE // shrink
        room = counts + unseen.reshape(side, shrink, side, shrink).sum(axis=(1, 3), dtype=np.int16)
        seen = [np.flatnonzero(wanted.any(axis=axis)).tolist() for axis in (1, 0)]  # rows, columns
        for look in _looks(shrink):
            footprint = look.shape * len(Size) + look.size
            own = _unit_counts(footprint, look.odd_x, look.odd_y, shrink)
            height, width = own.shape
            top, left = max(0, seen[0][0] - height + 1), max(0, seen[1][0] - width + 1)
            rows, columns = min(side - height, seen[0][-1]) - top + 1, min(side - width, seen[1][-1]) - left + 1
            near = room[top : top + rows + height - 1, left : left + columns + width - 1]
            fits = np.ones((rows, columns), np.bool_)
            for row, column in _probes(footprint, look.odd_x, look.odd_y, shrink):
                fits &= near[row : row + rows, column : column + columns] >= own[row, column]
            for row, column in np.argwhere(fits).tolist():
                if (near[row : row + height, column : column + width] >= own).all():
                    x, y = (left + column) * shrink + look.odd_x - MARGIN, (top + row) * shrink + look.odd_y - MARGIN
                    yield Item(x, y, look.shape, colour, look.size)


@cache
def _probes(footprint: int, odd_x: int, odd_y: int, shrink: int) -> list[list[int]]:
    """Row and column of blocks all over an item."""
    filled = np.argwhere(_unit_counts(footprint, odd_x, odd_y, shrink)).tolist()
    return filled[:: max(1, len(filled) // PROBES)]


@cache
def _drawn(footprint: int) -> BoolArray:
    """(side, side) whether each native pixel of the bounding square is drawn."""
    return _unit_counts(footprint, 0, 0, 1).astype(np.bool_)


def _native(item: Item) -> tuple[slice, slice]:
    """Rows and columns of an item's bounding square."""
    x, y, side = item.x + MARGIN, item.y + MARGIN, item.side
    return slice(y, y + side), slice(x, x + side)


def _blocks(item: Item, shrink: int) -> tuple[slice, slice]:
    """Rows and columns of the blocks that it touches."""
    x, y, side = item.x + MARGIN, item.y + MARGIN, item.side
    return slice(y // shrink, -(-(y + side) // shrink)), slice(x // shrink, -(-(x + side) // shrink))


def _by_block(item: Item, unseen: BoolArray, shrink: int) -> IntArray:
    """(rows, columns) drawn pixels of an item that can be seen, in each block it touches."""
    before_x, before_y = item.x % shrink, item.y % shrink  # MARGIN is a whole number of blocks
    rows, columns = -(-(before_y + item.side) // shrink), -(-(before_x + item.side) // shrink)
    shown = np.zeros((rows * shrink, columns * shrink), np.bool_)
    shown[before_y : before_y + item.side, before_x : before_x + item.side] = _drawn(item.footprint) & ~unseen
    return shown.reshape(rows, shrink, columns, shrink).sum(axis=(1, 3), dtype=np.int16)


def _in_order(drawn: Sequence[Item]) -> list[Item]:
    """Items by x, then y, but one that is drawn over another after it; `drawn` from the back to the front."""
    left = list(drawn)
    ordered: list[Item] = []
    while left:
        free = [item for place, item in enumerate(left) if all(_are_apart((item, other), 1) for other in left[:place])]
        item = min(free)
        left.remove(item)
        ordered.append(item)
    return ordered


def _scatter(image: UInt8Array) -> Scene:
    found = [region.read(image[None])[0] for region in _boxes_by_pixels(_sizes()[image.shape])]
    return _scene(found)


def _scatters(images: UInt8Array) -> list[Scene]:
    scenes: list[Scene] = []
    for first in range(0, len(images), TOGETHER):
        some = images[first : first + TOGETHER]
        columns = [region.read(some) for region in _boxes_by_pixels(_sizes()[images.shape[1:]])]
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
