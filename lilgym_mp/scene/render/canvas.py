"""Canvas: an image buffer that redraws only what changed. Its pixels equal those of `drawing.draw`, the reference."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.scene import (
    BOX_COUNT,
    BOX_PITCH,
    BOX_SIDE,
    FOOTPRINTS,
    SIZE_PIXELS,
    Box,
    Colour,
    Item,
    Scene,
    Shape,
    Size,
)
from lilgym_mp.scene.appearances.base import fits_box
from lilgym_mp.scene.arrays import UInt8Array
from lilgym_mp.scene.render.drawing import (
    LARGEST_PATCH,
    SHRINKS,
    draw,
    empty_picture,
    image_shape,
    item_mask,
    palette,
    shrink_of,
    stamp,
)

# Plain tuples instead of named tuples: unpacking them takes a third of the time.

# Pixels to copy into a box: first row, end row, first column, end column, (rows, columns, 3) pixels.
Blit = tuple[int, int, int, int, UInt8Array]

# An item drawn on its patch, the smallest area of whole blocks (2 x 2 native pixels) that contains it: the patch's
# width and height in native pixels, (rows, columns, 3) pixels with the item alone and without it, then two arrays
# packed into ints, in rows of `_pitch` entries: `drawn`, a bit per native pixel, set where the item covers it, and
# `counts`, a byte per block, as in the item's stamp.
_Patch = tuple[int, int, UInt8Array, UInt8Array, int, int]
_Patches = Sequence[Sequence[Sequence[Sequence[Sequence[_Patch]]]]]  # by shape, colour, size, parity of x, parity of y


_BLITS_KEYS = {shrink: f"blits {shrink}" for shrink in SHRINKS.values()}  # in a box's memo, by shrink


def box_blits(box: Box, shrink: int) -> tuple[Blit, ...] | None:
    """The blits that draw a box's items on an empty box; None as in `_patch_blit`. Cached in the box's memo."""
    key = _BLITS_KEYS[shrink]
    memo = box.memo
    if key not in memo:
        items = box.items
        patches = _patches(shrink)
        blits = [
            _patch_blit(item, items[:index] + items[index + 1 :], patches, shrink, shown=True)
            for index, item in enumerate(items)
        ]
        memo[key] = None if None in blits else tuple(blits)
    return memo[key]


class Canvas:
    """An image buffer that equals `draw` of the scene last shown, and redraws only what changed."""

    def __init__(self, image_size: str = "half", pixels: UInt8Array | None = None) -> None:
        """`pixels`: the contiguous buffer to draw into, of `image_shape(image_size)`; a new one by default."""
        self._image_size = image_size
        self._shrink = shrink_of(image_size)
        self.pixels = np.empty(image_shape(image_size), np.uint8) if pixels is None else pixels
        lefts = [index * BOX_PITCH // self._shrink for index in range(BOX_COUNT)]
        self._boxes = [self.pixels[:, left : left + BOX_SIDE // self._shrink] for left in lefts]
        self._patches = _patches(self._shrink)
        # Keys in a box's memo for the blits that add and remove its last item, which Tower's shared boxes need often.
        self._added_key = f"added {image_size}"
        self._removed_key = f"removed {image_size}"
        self._shown: tuple[Box, Box, Box] | None = None  # None if the buffer must be redrawn completely

    def __reduce__(self) -> tuple[type[Canvas], tuple[str]]:
        """A copy has its own buffer, which is redrawn."""
        return Canvas, (self._image_size,)

    def show(self, scene: Scene) -> UInt8Array:
        """The buffer, showing `scene`; valid until the next call."""
        before = self._shown
        after = scene.boxes
        self._shown = None  # until finished, so that the buffer is redrawn completely after an interrupt
        if before is not None and (
            (after[0] is before[0] or self._update(0, before[0], after[0]))
            and (after[1] is before[1] or self._update(1, before[1], after[1]))
            and (after[2] is before[2] or self._update(2, before[2], after[2]))
        ):
            self._shown = after
        else:
            self._begin(scene)
        return self.pixels

    def _update(self, index: int, before: Box, after: Box) -> bool:
        """Makes a box show `after`; False, and nothing done, unless one item was added at the end or removed."""
        old = before.items
        new = after.items
        kept = after.memo.get(self._added_key)
        if kept is None or kept[0] is not old:
            kept = before.memo.get(self._removed_key)
            if kept is None or kept[0] is not new:
                kept = None
        blit = self._blit(before, after) if kept is None else kept[1]
        if blit is None:
            return False
        top, bottom, left, right, pixels = blit
        self._boxes[index][top:bottom, left:right] = pixels
        return True

    def _blit(self, before: Box, after: Box) -> Blit | None:
        """The blit that turns `before` into `after`, None as in `_update`."""
        old = before.items
        new = after.items
        difference = len(new) - len(old)
        if difference == 1 and new[:-1] == old:
            blit = _patch_blit(new[-1], old, self._patches, self._shrink, shown=True)
            after.memo[self._added_key] = old, blit
        elif difference == -1 and (removed := _removed(old, new)) is not None:
            blit = _patch_blit(removed, new, self._patches, self._shrink, shown=False)
            if removed is old[-1]:
                before.memo[self._removed_key] = new, blit
        else:
            return None
        return blit

    def _begin(self, scene: Scene) -> None:
        """Shows an unrelated scene."""
        if not self._draw_items(scene):
            self.pixels[:] = draw(scene, self._image_size)
            inside = all(fits_box(item.footprint, item.x, item.y) for item in scene.items())
            self._shown = scene.boxes if inside else None

    def _draw_items(self, scene: Scene) -> bool:
        """Draws the scene item by item; returns False and does nothing if a box needs drawing in order."""
        by_box = [box_blits(box, self._shrink) for box in scene.boxes]
        if None in by_box:
            return False
        self.pixels[:] = empty_picture(self._shrink)
        for pixels, blits in zip(self._boxes, by_box, strict=True):
            for top, bottom, left, right, patch in blits or ():
                pixels[top:bottom, left:right] = patch
        self._shown = scene.boxes
        return True


def _removed(before: Sequence[Item], after: Sequence[Item]) -> Item | None:
    """The item missing from `after`, if that is the only difference."""
    first = 0
    for item in after:
        if item is not before[first]:
            break
        first += 1
    return before[first] if before[first + 1 :] == after[first:] else None


def _pitch(shrink: int) -> int:
    """Entries per row of `drawn` (shrink 1) or `counts`: enough for a patch with neighbours on both sides."""
    return 3 * LARGEST_PATCH // shrink


def _patch(footprint: int, colour: Colour, odd_x: int, odd_y: int, shrink: int) -> _Patch:
    sprite, counts = stamp(footprint, colour, odd_x, odd_y, shrink)
    rows, columns = counts.shape
    bare = empty_picture(shrink)[:rows, :columns]
    mask = np.pad(item_mask(footprint), ((odd_y, 0), (odd_x, 0)))
    drawn = int.from_bytes(np.packbits(_in_rows(mask, _pitch(1)), bitorder="little").tobytes(), "little")
    packed_counts = int.from_bytes(_in_rows(counts, _pitch(shrink)).tobytes(), "little")
    return columns * shrink, rows * shrink, sprite, bare, drawn, packed_counts


def _in_rows(entries: NDArray[Any], pitch: int) -> NDArray[Any]:
    return np.pad(entries, ((0, 0), (0, pitch - entries.shape[1])))


@cache
def _patches(shrink: int) -> _Patches:
    """Patches of all item types and parities; shifting one to its position is as fast as a cache by position."""
    patches = np.empty((len(Shape), len(Colour), len(Size), 2, 2), object)
    for shape, colour, size, odd_x, odd_y in product(Shape, Colour, Size, (0, 1), (0, 1)):
        patch = _patch(FOOTPRINTS[shape][size], colour, odd_x, odd_y, shrink)
        patches[shape, colour, size, odd_x, odd_y] = patch
    return patches.tolist()


def _patch_blit(item: Item, others: Sequence[Item], patches: _Patches, shrink: int, *, shown: bool) -> Blit | None:
    """The pixels of a box on the patch of `item`, with the `others` and, if `shown`, the item itself.

    None if an item there extends beyond the box or overlaps another, since then the drawing order matters.
    """
    x, y, shape, colour, size = item
    width, height, alone, bare, _, _ = patches[shape][colour][size][x & 1][y & 1]
    left = x & -2
    top = y & -2
    right = left + width
    bottom = top + height
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
    """A patch of that shape (rows, columns, 3) with the items on and near it; None as in `_patch_blit`."""
    # Adds packed ints because arrays are too slow for so few entries: in random play of Scatter one step in ten comes
    # here, for two items on average, and takes 7 us so and 24 us with arrays of NumPy.
    patches = _patches(shrink)
    pitch = _pitch(1)
    block_pitch = _pitch(shrink)
    drawn = counts = 0
    for item in items:
        if not fits_box(item.footprint, item.x, item.y):
            return None
        x, y, item_shape, colour, size = item
        _, _, _, _, own_drawn, own_counts = patches[item_shape][colour][size][x & 1][y & 1]
        across = (x & -2) - left
        down = (y & -2) - top
        shift = down * pitch + across
        own_drawn = own_drawn << shift if shift >= 0 else own_drawn >> -shift
        if drawn & own_drawn:
            return None
        drawn |= own_drawn
        shift = 8 * (down // shrink * block_pitch + across // shrink)
        counts += own_counts << shift if shift >= 0 else own_counts >> -shift
    # The maximum length, as an item near the patch may begin in its last row.
    by_block = counts.to_bytes(2 * LARGEST_PATCH // shrink * block_pitch, "little")
    blocks = np.ndarray(shape[:2], np.uint8, by_block, strides=(block_pitch, 1))
    return palette(shrink).colours.take(blocks, axis=0)
