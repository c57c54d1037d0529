"""Canonical items: one for each class of items that no test of a single item can tell apart.

Words that test single items depend on shape, colour, size and which walls are within 0, 4 or 8 pixels. So there are
1,323 classes, and a test's values for the canonical items give its value for every item.
"""

from __future__ import annotations

import itertools
from functools import cache

from lilgym_mp.programs.functions.items import MARGIN, WIDE_MARGIN
from lilgym_mp.scene import BOX_SIDE, SIZE_PIXELS, Colour, Item, Shape, Size

OVERHANG = 2 * BOX_SIDE  # pixels by which an item may lie outside its box and still have a canonical index
ZONE_COUNT = 7  # along one axis: away from walls; at the near wall or within either margin of it; the same at the far
ZONE_PAIR_COUNT = ZONE_COUNT**2
COLOUR_COUNT = len(Colour)
TYPES_PER_SIZE = len(Shape) * COLOUR_COUNT  # item types of one size


@cache
def canonical_items() -> tuple[Item, ...]:
    """The canonical items, by index."""
    items: list[Item] = []
    for size in Size:
        last = BOX_SIDE - size.pixels
        near = (0, MARGIN, WIDE_MARGIN)
        starts = (last // 2, *near, *(last - distance for distance in near))
        combinations = itertools.product(starts, starts, Shape, Colour)
        items.extend(Item(x, y, shape, colour, size) for x, y, shape, colour in combinations)
    return tuple(items)


def _zone(start: int, side: int) -> int:
    """The zone along one axis of an item of `side` pixels at `start`, in the order of `canonical_items`."""
    before = start
    after = BOX_SIDE - side - start
    for zone, distance in enumerate((0, MARGIN, WIDE_MARGIN), start=1):
        if before <= distance:
            return zone
        if after <= distance:
            return zone + 3
    return 0


@cache
def zones() -> tuple[tuple[int, ...], ...]:
    """The zone along one axis, 0 to 6, by size and by pixel + OVERHANG."""
    pixels = range(-OVERHANG, BOX_SIDE + OVERHANG)
    return tuple(tuple(_zone(pixel, side) for pixel in pixels) for side in SIZE_PIXELS)


def canonical_index(item: Item) -> int:
    """The index of the canonical item that is equivalent to `item`."""
    x, y, shape, colour, size = item
    by_pixel = zones()[size]
    zone_pair = by_pixel[x + OVERHANG] * ZONE_COUNT + by_pixel[y + OVERHANG]
    return (size * ZONE_PAIR_COUNT + zone_pair) * TYPES_PER_SIZE + shape * COLOUR_COUNT + colour
