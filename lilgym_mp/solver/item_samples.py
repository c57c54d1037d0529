"""One item for each look and each way to lie to the walls: all that a test of one item by itself can tell apart.

Words that test single items look at colour, shape, size and at which walls are within 0, 4 or 8 pixels. So 1,323 items
stand for all, and a test's answers to them are its answers to every item.
"""

from __future__ import annotations

import itertools
from functools import cache

from lilgym_mp.programs.functions.items import MARGIN, WIDE_MARGIN
from lilgym_mp.scene import BOX_SIDE, SIZE_PIXELS, Colour, Item, Shape, Size

BEYOND = 2 * BOX_SIDE  # pixels by which an item may lie outside its box and still be looked up
PLACE_COUNT = 7  # along one axis: in the open, at the near wall and within either margin of it, likewise the far one
COLOUR_COUNT = len(Colour)
ITEM_TYPE_COUNT = len(Shape) * COLOUR_COUNT  # of one size, as samples are numbered
PLACES_IN_ALL = PLACE_COUNT**2


@cache
def every_item() -> tuple[Item, ...]:
    """The samples, by number."""
    items: list[Item] = []
    for size in Size:
        last = BOX_SIDE - size.pixels
        near = (0, MARGIN, WIDE_MARGIN)
        places = (last // 2, *near, *(last - distance for distance in near))
        item_types = itertools.product(places, places, Shape, Colour)
        items.extend(Item(x, y, shape, colour, size) for x, y, shape, colour in item_types)
    return tuple(items)


def _place(start: int, side: int) -> int:
    """Which of an axis's places `start` is like, in the order of `every_item`."""
    before, after = start, BOX_SIDE - side - start
    for place, distance in enumerate((0, MARGIN, WIDE_MARGIN), start=1):
        if before <= distance:
            return place
        if after <= distance:
            return place + 3
    return 0


@cache
def places() -> tuple[tuple[int, ...], ...]:
    """By size and pixel plus BEYOND: the place along an axis, 0 .. 6."""
    pixels = range(-BEYOND, BOX_SIDE + BEYOND)
    return tuple(tuple(_place(pixel, side) for pixel in pixels) for side in SIZE_PIXELS)


def sample_number(item: Item) -> int:
    """The number of the sample that tests of one item cannot tell from `item`."""
    x, y, shape, colour, size = item
    by_pixel = places()[size]
    place = by_pixel[x + BEYOND] * PLACE_COUNT + by_pixel[y + BEYOND]
    return (size * PLACES_IN_ALL + place) * ITEM_TYPE_COUNT + shape * COLOUR_COUNT + colour
