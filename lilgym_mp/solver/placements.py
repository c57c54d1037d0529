"""What one edit can make of a box of scattered items: where there is room, and which cell takes an item away."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from lilgym_mp.actions import AddItem, RemoveItem
from lilgym_mp.appearances import PlacementRules, Scatter
from lilgym_mp.programs.functions.items import MARGIN, WIDE_MARGIN
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, SIZE_PIXELS, Box, Colour, Item, Scene, Shape, Size

MOST_PLACES = 10  # columns or rows of a box up to which all are tried; of finer grids, some
COARSE_STEP = 10  # pixels between the places tried in the open on finer grids
COVER_STEP = 3  # pixels between the points of an item at which a removal is tried on finer grids

BoxEdit = AddItem | RemoveItem
ItemType = tuple[Shape, Colour, Size]
NOTHING = Box()
ITEM_TYPES: tuple[ItemType, ...] = tuple(itertools.product(Shape, Colour, Size))


class Placed(NamedTuple):
    """An edit of one box, and the box after it."""

    edit: BoxEdit
    box: Box


class Placements:
    """The edits of box `index` of a scene under the rules of placement."""

    def __init__(self, scatter: Scatter, rules: PlacementRules, index: int) -> None:
        self._scatter = scatter
        self._rules = rules
        self._index = index
        self.complete = max(BOX_SIDE // side for side in scatter.cell) <= MOST_PLACES  # whether every cell is tried

    def added(self, box: Box, item_type: ItemType, x: int, y: int) -> Placed | None:
        """What adding an item of that look makes of the box, in the cell at pixel (x, y); None where invalid."""
        return self._edited(box, AddItem(*self._cell(x, y), *item_type))

    def removed(self, box: Box, position: int) -> Placed | None:
        """How to take away the item at that position; None where no cell that is tried does."""
        expected = box.items[:position] + box.items[position + 1 :]
        for column, row in self._cells_of(box.items[position]):
            placed = self._edited(box, RemoveItem(column, row))
            if placed is not None and placed.box.items == expected:
                return placed
        return None

    def every(self, box: Box) -> Iterator[Placed]:
        """Every valid edit: each look in each cell that is tried, and each cell that takes something away."""
        corners = self.corners(box)
        for x, y in corners:
            for item_type in ITEM_TYPES:
                placed = self.added(box, item_type, x, y)
                if placed is not None:
                    yield placed
        for x, y in corners:
            placed = self._edited(box, RemoveItem(*self._cell(x, y)))
            if placed is not None:
                yield placed

    def corners(self, box: Box) -> Sequence[tuple[int, int]]:
        """Top-left pixels of the cells to try: of a coarse grid all; of a fine one those at the walls and beside
        items, and some in the open."""
        width, height = self._scatter.cell
        xs = _places(width, [(item.x, item.side) for item in box.items])
        ys = _places(height, [(item.y, item.side) for item in box.items])
        return [(x, y) for x in xs for y in ys]

    def _edited(self, box: Box, edit: BoxEdit) -> Placed | None:
        boxes = [NOTHING] * BOX_COUNT
        boxes[self._index] = box
        left, middle, right = boxes
        after, invalid = self._scatter.apply(Scene((left, middle, right)), edit, self._rules)
        return None if invalid else Placed(edit, after.boxes[self._index])

    def _cell(self, x: int, y: int) -> tuple[int, int]:
        width, height = self._scatter.cell
        return (self._index * BOX_PITCH + x) // width, y // height

    def _cells_of(self, item: Item) -> Iterable[tuple[int, int]]:
        """The cells that an item lies in, that of its centre first; of a fine grid, some of them."""
        half = item.side // 2
        centre = [(item.x + half, item.y + half)]
        step_x, step_y = self._scatter.cell if self.complete else (COVER_STEP, COVER_STEP)
        xs, ys = _points(item.x, item.side, step_x), _points(item.y, item.side, step_y)
        points = itertools.chain(centre, itertools.product(xs, ys))
        return dict.fromkeys(self._cell(x, y) for x, y in points if 0 <= x < BOX_SIDE and 0 <= y < BOX_SIDE)


def _points(start: int, side: int, step: int) -> list[int]:
    """Pixels from `start` on at most `step` apart, the last one that belongs to the side among them."""
    return [*range(start, start + side - 1, step), start + side - 1]


def _places(cell: int, spans: Sequence[tuple[int, int]]) -> list[int]:
    """Pixels along one axis at which cells of that side begin; `spans` are the items' starts and sides."""
    if BOX_SIDE // cell <= MOST_PLACES:
        return list(range(0, BOX_SIDE, cell))
    wanted = {*range(0, BOX_SIDE, COARSE_STEP), MARGIN, WIDE_MARGIN}
    wanted.update(BOX_SIDE - side - gap for side in SIZE_PIXELS for gap in (0, MARGIN, WIDE_MARGIN))
    wanted.update(start + side for start, side in spans)
    wanted.update(start - side for start, _ in spans for side in SIZE_PIXELS)
    return sorted({pixel // cell * cell for pixel in wanted if 0 <= pixel < BOX_SIDE})
