"""Pictures of many Scatter scenes at once.

A picture is kept as counts as well: for each of its pixels, how much of it each colour covers, as one code. Items
that share no native pixel add up in it, so an item comes and goes by adding and subtracting its own counts, whatever
lies around it, and the pixels then follow from a table of codes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances.placement import fits_box
from lilgym_mp.appearances.scatter import LOOKS
from lilgym_mp.envs.block import Int64Array
from lilgym_mp.envs.scatter_tables import KINDS, PLACE_PITCH
from lilgym_mp.render import LARGEST_PATCH, UInt8Array, draw, image_shape, palette, shrink_of, stamp
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, Item, Scene, Size

TAKEN = len(LOOKS)


class Change(NamedTuple):
    """Items that come or go. All arrays (k,)."""

    rows: Int64Array  # 3 * environment + box
    places: Int64Array
    stamps: Int64Array  # number in LOOKS, plus TAKEN where the item goes


class _Lines(NamedTuple):
    """What to put on the counts of an empty scene: runs of a patch's width."""

    starts: NDArray[np.uint16]  # (n,) where each starts in the counts of the scene's boxes
    counts: NDArray[Any]  # (n,) of it


class ScatterPainter:
    """Keeps images equal to `draw` of scenes that add up."""

    def __init__(self, images: UInt8Array, image_size: str) -> None:
        """Makes the images (N, height, width, 3) show empty scenes."""
        self._images = images
        self._shrink = shrink_of(image_size)
        self._background = draw(Scene.empty(), image_size)
        images[:] = self._background
        side, height, width = BOX_SIDE // self._shrink, *images.shape[1:3]
        self._counts = np.zeros((len(images), BOX_COUNT, side, side), np.uint8)
        self._sheet = _sheet(image_size)
        self._pairs = _pixel_pairs(self._shrink)
        patch = LARGEST_PATCH // self._shrink
        self._count_rows = _windows(self._counts, patch)
        self._pixel_rows = _windows(images.reshape(-1, 3), patch)
        rows, lefts = np.arange(patch), BOX_PITCH // self._shrink * np.arange(BOX_COUNT)
        self._row_offsets = rows * side, rows * width, rows * self._sheet.pitch
        self._box_counts, self._scene_counts, self._scene_pixels = side**2, BOX_COUNT * side**2, height * width
        in_scene = lefts[:, None, None] + np.arange(side)[:, None] * width + np.arange(side)
        self._pixel_of_count = in_scene.ravel()  # (scene counts,) which pixel of the image it is
        self._first_pixels = (np.arange(len(images))[:, None] * self._scene_pixels + lefts).ravel()  # (3 N,) by box

    def show(self, which: Int64Array, scenes: Sequence[Scene]) -> None:
        """Makes the images of environments (k,) show scenes."""
        pictures = [self._lines(scene) for scene in scenes]
        self._images[which] = self._background
        self._counts[which] = 0
        starts, lines = (np.concatenate(parts) for parts in zip(*pictures, strict=True))
        if len(starts):
            owners = which.repeat([len(picture.starts) for picture in pictures])
            pixels = owners * self._scene_pixels + self._pixel_of_count.take(starts)
            self._write(owners * self._scene_counts + starts, pixels, lines)

    def _lines(self, scene: Scene) -> _Lines:
        """What `show` puts on the counts of an empty scene. Kept in the scene's memo."""
        key = ("lines", self._shrink)
        if key not in scene.memo:
            scene.memo[key] = _scene_lines(scene, self._shrink)
        return scene.memo[key]

    def change(self, changes: Sequence[Change]) -> None:
        """Puts items into boxes and takes items away: at most one in each environment."""
        sheet = self._sheet
        rows, places, stamps = changes[0] if len(changes) == 1 else map(np.concatenate, zip(*changes, strict=True))
        count_offsets, pixel_offsets, sheet_offsets = self._row_offsets
        first_stamps = sheet.places[places] + stamps * sheet.stamp_size
        first_counts = rows * self._box_counts + sheet.counts[places]
        first_pixels = self._first_pixels[rows] + sheet.pixels[places]
        windows = first_counts[:, None] + count_offsets  # (k, patch)
        change = sheet.rows[first_stamps[:, None] + sheet_offsets]
        counts = self._count_rows[windows].view(np.uint8) + change.view(np.uint8)  # (k, patch ** 2)
        self._write(windows, first_pixels[:, None] + pixel_offsets, counts.view(change.dtype))

    def _write(self, counts: Int64Array, pixels: Int64Array, lines: NDArray[Any]) -> None:
        """Lines of counts (...) go where they start in all counts (...), and their pixels where these start (...)."""
        self._count_rows[counts] = lines
        colours = self._pairs.take(lines.view(np.uint16)).view(np.uint16).reshape(-1, 4)
        compact = np.empty((len(colours), 3), np.uint16)
        for part in range(3):
            compact[:, part] = colours[:, part]
        self._pixel_rows[pixels] = compact.view(np.uint8).reshape(-1).view(self._pixel_rows.dtype).reshape(pixels.shape)


def _windows(array: UInt8Array, length: int) -> NDArray[Any]:
    """Every run of `length` entries of a contiguous array, overlapping: (pixels, 3) or (..., counts)."""
    step = 3 if array.shape[-1] == 3 else 1
    run = np.dtype((np.void, length * step))
    return np.ndarray((array.size // step - length + 1,), run, array, strides=(step,))


def adds_up(scene: Scene) -> bool:
    """Whether its items lie inside their boxes and draw no pixel in common."""
    return all(
        fits_box(item.kind, item.x, item.y) and not any(_meet(item, other) for other in box.items[:number])
        for box in scene.boxes
        for number, item in enumerate(box.items)
    )


def _meet(item: Item, other: Item) -> bool:
    """Whether two items, inside their box, draw a pixel in common."""
    left, right = max(item.x, other.x), min(item.x + item.side, other.x + other.side)
    top, bottom = max(item.y, other.y), min(item.y + item.side, other.y + other.side)
    if left >= right or top >= bottom:
        return False
    drawn = (
        stamp(each.kind, each.colour, 0, 0, 1).counts[top - each.y : bottom - each.y, left - each.x : right - each.x]
        for each in (item, other)
    )
    return bool(np.logical_and(*drawn).any())


def _scene_lines(scene: Scene, shrink: int) -> _Lines:
    side, patch = BOX_SIDE // shrink, LARGEST_PATCH // shrink
    counts = np.zeros((BOX_COUNT, side, side), np.uint8)
    starts: list[int] = []
    for index, box in enumerate(scene.boxes):
        in_box = counts[index]
        for x, y, shape, colour, size in box.items:
            own = stamp(shape * len(Size) + size, colour, x % 2, y % 2, shrink).counts
            rows, columns = own.shape
            left, top = x // 2 * 2 // shrink, y // 2 * 2 // shrink
            in_box[top : top + rows, left : left + columns] += own
            first = (index * side + top) * side + min(left, side - patch)
            starts += range(first, first + rows * side, side)
    chosen = np.array(starts, np.uint16)
    return _Lines(chosen, _windows(counts, patch)[chosen])


class _Sheet(NamedTuple):
    """Every stamp on a canvas of its own, and where to read and write by place.

    A patch that would leave the box lies further left or up, and reads the stamp from as much further there.
    """

    rows: NDArray[Any]  # every run of a patch's width in the canvases, which lie one after another
    stamp_size: int  # counts in a stamp's canvases
    pitch: int  # counts in a canvas's row
    places: Int64Array  # by place: where the patch starts in a stamp's canvases
    counts: Int64Array  # by place: where it starts in a box's counts
    pixels: Int64Array  # by place: where it starts in the image, from the box's first pixel


@cache
def _sheet(image_size: str) -> _Sheet:
    shrink = shrink_of(image_size)
    side, width, patch = BOX_SIDE // shrink, image_shape(image_size)[1], LARGEST_PATCH // shrink
    margin = side - patch
    pitch = margin + patch
    stamps = np.zeros((2, len(LOOKS), 2, 2, pitch, pitch), np.uint8)  # added or taken, look, odd x, odd y
    for look, (_, colour, _) in enumerate(LOOKS):
        for odd_x in (0, 1):
            for odd_y in (0, 1):
                counts = stamp(int(KINDS[look]), colour, odd_x, odd_y, shrink).counts
                rows, columns = counts.shape
                stamps[0, look, odd_x, odd_y, margin : margin + rows, margin : margin + columns] = counts
    stamps[1] = -stamps[0]
    along = np.arange(BOX_SIDE)
    starts = np.minimum((along - along % 2) // shrink, margin)
    shifts = (along - along % 2) // shrink - starts
    origin = margin - shifts
    by_x = 2 * (along % 2) * pitch**2 + origin
    by_y = (along % 2) * pitch**2 + origin * pitch
    return _Sheet(
        rows=_windows(stamps, patch),
        stamp_size=4 * pitch**2,
        pitch=pitch,
        places=_by_place(by_x, by_y),
        counts=_by_place(starts, starts * side),
        pixels=_by_place(starts, starts * width),
    )


def _by_place(by_x: Int64Array, by_y: Int64Array) -> Int64Array:
    """(BOX_SIDE * PLACE_PITCH,) by place, the sum of what x and y contribute."""
    table = np.zeros((BOX_SIDE, PLACE_PITCH), np.int64)
    table[:, :BOX_SIDE] = by_x[:, None] + by_y
    return table.ravel()


@cache
def _pixel_pairs(shrink: int) -> NDArray[np.uint64]:
    """The six bytes of two neighbouring pixels, and two spare ones, by their counts read as one number of 16 bits."""
    colours = palette(shrink).colours
    first, second = np.meshgrid(np.arange(len(colours)), np.arange(len(colours)), indexing="ij")
    numbers = np.stack([first, second], axis=-1).astype(np.uint8).view(np.uint16)[..., 0]
    pairs = np.zeros((int(numbers.max()) + 1, 8), np.uint8)
    pairs[numbers, :3] = colours[first]
    pairs[numbers, 3:6] = colours[second]
    return pairs.view(np.uint64)[:, 0]
