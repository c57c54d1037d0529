"""Single edits of a Scatter box under the exact rules of placement."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from lilgym_mp.scene import BOX_PITCH, BOX_SIDE, Box, Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.actions import AddItem, RemoveItem
from lilgym_mp.scene.appearances import PlacementRules, Scatter

FINEST_STEP = 10  # pixels between the cells that are tried for additions; on finer grids some are left out

BoxEdit = AddItem | RemoveItem
ItemType = tuple[Shape, Colour, Size]
EMPTY_SCENE = Scene.empty()


class EditedBox(NamedTuple):
    """An edit of one box and the resulting box."""

    edit: BoxEdit
    box: Box


@dataclass(frozen=True)
class BoxEditor:
    """Applies single edits to box `index` of a scene."""

    scatter: Scatter
    rules: PlacementRules
    index: int

    @cached_property
    def is_exhaustive(self) -> bool:
        """Whether every cell is tried."""
        return min(self.scatter.cell) >= FINEST_STEP

    def added(self, box: Box, item_type: ItemType, x: int, y: int) -> EditedBox | None:
        """The addition of an item of that type to the cell at pixel (x, y); None if it is invalid."""
        return self._edited(box, AddItem(*self._cell(x, y), *item_type))

    def removed(self, box: Box, position: int) -> EditedBox | None:
        """The removal of the item at that position; None if no cell that is tried removes it."""
        expected = box.items[:position] + box.items[position + 1 :]
        for column, row in self._cells_of(box.items[position]):
            edited = self._edited(box, RemoveItem(column, row))
            if edited is not None and edited.box.items == expected:
                return edited
        return None

    @cached_property
    def corners(self) -> Sequence[tuple[int, int]]:
        """The top-left pixels of the cells to try for additions."""
        columns, rows = (range(0, BOX_SIDE, -(-FINEST_STEP // side) * side) for side in self.scatter.cell)
        return list(itertools.product(columns, rows))

    def _edited(self, box: Box, edit: BoxEdit) -> EditedBox | None:
        after, invalid = self.scatter.apply(EMPTY_SCENE.with_box(self.index, box), edit, self.rules)
        return None if invalid else EditedBox(edit, after.boxes[self.index])

    def _cell(self, x: int, y: int) -> tuple[int, int]:
        width, height = self.scatter.cell
        return (self.index * BOX_PITCH + x) // width, y // height

    def _cells_of(self, item: Item) -> Iterable[tuple[int, int]]:
        """The cells that the item covers, the one at its centre first."""
        half = item.side // 2
        centre = [(item.x + half, item.y + half)]
        width, height = self.scatter.cell
        xs = _points(item.x, item.side, width)
        ys = _points(item.y, item.side, height)
        points = itertools.chain(centre, itertools.product(xs, ys))
        return dict.fromkeys(self._cell(x, y) for x, y in points if 0 <= x < BOX_SIDE and 0 <= y < BOX_SIDE)


def _points(start: int, side: int, step: int) -> list[int]:
    """Every `step`-th pixel of a side, and its last."""
    return [*range(start, start + side - 1, step), start + side - 1]
