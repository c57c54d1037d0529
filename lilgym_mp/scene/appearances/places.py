"""What edits name, whole boxes or the cells of a grid: their indices, their names, and where they are."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, Item, Scene
from lilgym_mp.scene.actions import BOX_NAMES, Action, AddItem, RemoveItem
from lilgym_mp.scene.appearances.base import Appearance, Grid
from lilgym_mp.scene.appearances.grids import cell_size
from lilgym_mp.scene.appearances.scatter.actions import ITEM_TYPES
from lilgym_mp.scene.arrays import Int64Array, Rng


class Boxes:
    """Edits name boxes, as AddBlock and RemoveBlock do."""

    fields = ("box",)  # of a REMOVE; the first ones of an ADD
    counts = (BOX_COUNT,)  # values of each field
    size = (BOX_SIDE, BOX_SIDE)  # width and height of a place in pixels
    box_shape = (1, 1)  # rows and columns of places in a box
    box_names = BOX_NAMES  # to show, if edits name them
    limits = ()  # sentences on the numbers that fields may have

    def by_box(self, box: Int64Array) -> Int64Array:
        """The indices of places, by box."""
        return box

    def of_centre(self, box: int, item: Item) -> str:
        """Words on the place of an item's centre, where the box and the item's position do not tell it."""
        return ""

    def columns(self, box: int, spacing: int) -> Iterator[tuple[int, str]]:
        """The numbers of a box's columns, with their first x in the image: none."""
        return iter(())

    def rows(self, spacing: int) -> Iterator[tuple[int, str]]:
        """The numbers of rows, with their first y: none."""
        return iter(())

    def explain(self) -> Iterator[str]:
        """Sentences on where the places are: none, as boxes are known."""
        return iter(())

    def random_edit(self, appearance: Appearance, scene: Scene, rng: Rng) -> Action:
        """A random edit, legal or not."""
        return appearance.decode(1 + int(rng.integers(appearance.action_count - 1)))


class Cells(NamedTuple):
    """Edits name cells of a grid over the image, as AddItem and RemoveItem do."""

    counts: Grid
    fields = ("column", "row")
    box_names = ()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a cell in pixels."""
        return cell_size(self.counts)

    @property
    def box_shape(self) -> tuple[int, int]:
        """(rows, columns) of the cells in a box."""
        width, height = self.size
        return BOX_SIDE // height, BOX_SIDE // width

    @property
    def limits(self) -> tuple[str]:
        """Range of the coordinates, for messages."""
        columns, rows = self.counts
        return (f"COLUMN, 0 .. {columns - 1}, and ROW, 0 .. {rows - 1}",)

    def at(self, box: int, x: int, y: int) -> tuple[int, int]:
        """The cell of a pixel of a box."""
        width, height = self.size
        return (box * BOX_PITCH + x) // width, y // height

    def of_centre(self, box: int, item: Item) -> str:
        """Words on the cell of an item's centre, unless cells are pixels."""
        if self.size == (1, 1):
            return ""
        column, row = self.at(box, item.x + item.side // 2, item.y + item.side // 2)
        return f", its centre in cell ({column}, {row})"

    def by_box(self, column: Int64Array, row: Int64Array) -> Int64Array:
        """The indices of cells, by box, then row-major; those on separators come last."""
        height, width = self.box_shape
        pitch = BOX_PITCH // self.size[0]
        box, column = np.divmod(column, pitch)
        in_box = (box * height + row) * width + column
        on_separator = BOX_COUNT * height * width + (box * height + row) * (pitch - width) + column - width
        return np.where(column < width, in_box, on_separator)

    def columns(self, box: int, spacing: int) -> Iterator[tuple[int, str]]:
        """The numbers of a box's columns at least `spacing` pixels apart, with their first x in the image."""
        width = self.size[0]
        left = BOX_PITCH * box
        for x in range(left, left + BOX_SIDE, width * -(-spacing // width)):
            yield x, str(x // width)

    def rows(self, spacing: int) -> Iterator[tuple[int, str]]:
        """The numbers of rows at least `spacing` pixels apart, with their first y."""
        height = self.size[1]
        for y in range(0, BOX_SIDE, height * -(-spacing // height)):
            yield y, str(y // height)

    def explain(self) -> Iterator[str]:
        """Sentences on where the cells are."""
        width, height = self.size
        lefts = range(0, BOX_COUNT * BOX_PITCH, BOX_PITCH)
        places = [(left // width, (left + BOX_SIDE) // width - 1) for left in lefts]  # first and last column of a box
        boxes = ", ".join(f"{name} {first}-{last}" for name, (first, last) in zip(BOX_NAMES, places, strict=True))
        gaps = [(last + 1, first - 1) for (_, last), (first, _) in pairwise(places)]
        between = " and ".join(f"{first}-{last}" for first, last in gaps if first <= last)
        yield (
            f"Cells (column, row) of {width} x {height} pixels: columns of the boxes {boxes}; columns {between} are"
            f" separators, where nothing can be; rows 0-{self.counts[1] - 1} from the top. A box's cell covers x from"
            f" {width} * (column - its first column) and y from {height} * row."
        )

    def random_edit(self, appearance: Appearance, scene: Scene, rng: Rng) -> Action:
        """A REMOVE of an item's cell as often as an ADD: a REMOVE of any cell would rarely find an item."""
        box = int(rng.integers(BOX_COUNT))
        items = scene.boxes[box].items
        if items and rng.random() < 0.5:
            item = items[rng.integers(len(items))]
            return RemoveItem(*self.at(box, item.x + item.side // 2, item.y + item.side // 2))
        x, y = rng.integers(BOX_SIDE, size=2).tolist()
        return AddItem(*self.at(box, x, y), *ITEM_TYPES[rng.integers(len(ITEM_TYPES))])


def places_of(grid: Grid | None) -> Boxes | Cells:
    """What edits name: the cells of an appearance's grid, if it has one."""
    return Cells(grid) if grid else Boxes()
