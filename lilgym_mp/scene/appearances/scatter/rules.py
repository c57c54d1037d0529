"""Scatter: items of any shape, colour and size anywhere in the boxes, placed by the cells of a grid.

Source: docs/spec.md, "Actions", "Legality and effects", "Rule sets".
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

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
    SceneError,
    Shape,
    Size,
    new_tuple,
)
from lilgym_mp.scene.actions import Action, ActionError, AddItem, RemoveItem, Stop
from lilgym_mp.scene.appearances.base import LAST_CORNER, Edit, Grid, InvalidReason, PlacementRules, slot_value
from lilgym_mp.scene.appearances.grids import RELEASED_GRID, cell_size, checked_grid
from lilgym_mp.scene.appearances.scatter import geometry
from lilgym_mp.scene.appearances.scatter.actions import (
    ITEM_TYPE_INDICES,
    MAX_DECODED,
    action_count,
    add_index,
    all_actions,
    array_form,
    decoded,
    remove_index,
)
from lilgym_mp.scene.arrays import BoolArray

if TYPE_CHECKING:
    from lilgym_mp.scene.appearances.sampling import Sampler


@dataclass(frozen=True, slots=True)
class Scatter:
    """1 + 28 actions per cell: STOP, ADD(x, y, shape, colour, size), REMOVE(x, y), in this order."""

    name = "scatter"
    shapes = tuple(Shape)
    example = AddItem(3, 4, Shape.CIRCLE, Colour.BLUE, Size.SMALL)
    box_capacity = None

    grid: Grid = RELEASED_GRID
    cell: tuple[int, int] = field(init=False)  # width and height in pixels
    _columns: tuple[tuple[int, int] | None, ...] = field(init=False, repr=False)  # box and x in it, by column
    cell_count: int = field(init=False, repr=False)  # cells of the grid, separators included
    box_cells: tuple[range, ...] = field(init=False, repr=False, compare=False)  # cells of each box
    is_native: bool = field(init=False, repr=False, compare=False)  # a cell is one pixel: no search, no snapping
    # decoded actions by index, if there are at most MAX_DECODED
    _table: Sequence[Action] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        columns, rows = grid = checked_grid(self.grid)
        width, height = cell_size(grid)
        places = (divmod(column * width, BOX_PITCH) for column in range(columns))
        by_column = tuple((box, x) if x < BOX_SIDE else None for box, x in places)
        object.__setattr__(self, "grid", grid)
        object.__setattr__(self, "cell", (width, height))
        object.__setattr__(self, "is_native", self.cell == (1, 1))
        object.__setattr__(self, "_columns", by_column)
        object.__setattr__(self, "cell_count", columns * rows)
        firsts = (box * BOX_PITCH // width * rows for box in range(BOX_COUNT))
        object.__setattr__(self, "box_cells", tuple(range(f, f + BOX_SIDE // width * rows) for f in firsts))
        object.__setattr__(self, "_table", all_actions(self.grid) if self.action_count <= MAX_DECODED else ())

    @property
    def sampler(self) -> Sampler:
        """Imported when first used."""
        from lilgym_mp.scene.appearances.scatter.sampling import ScatterSampler

        return ScatterSampler()

    @property
    def action_count(self) -> int:
        return action_count(self.cell_count)

    def decode(self, index: int) -> Action:
        return self._table[index] if self._table else decoded(self.grid, index)

    def encode(self, action: Action) -> int:
        match action:
            case Stop():
                return 0
            case AddItem(column, row, shape, colour, size) if (shape, colour, size) in ITEM_TYPE_INDICES:
                return add_index(self._cell_index(column, row), ITEM_TYPE_INDICES[shape, colour, size])
            case RemoveItem(column, row):
                return remove_index(self._cell_index(column, row), self.cell_count)
            case _:
                raise ActionError(f"{action!r} is not an action of scatter")

    def from_array(self, values: Sequence[int]) -> Action:
        return array_form(self.grid).read(values)

    def to_array(self, action: Action) -> list[int]:
        return array_form(self.grid).write(action)

    def apply(self, scene: Scene, action: Action, rules: PlacementRules) -> Edit:
        if isinstance(action, AddItem):
            return self._add(scene, action, rules)
        if isinstance(action, RemoveItem):
            return self._remove(scene, action)
        raise ActionError(f"{action!r} is not an edit of scatter")

    def _add(self, scene: Scene, action: AddItem, rules: PlacementRules) -> Edit:
        column, row, shape, colour, size = action
        place = self._columns[column]
        if place is None:
            return Edit(scene, InvalidReason.SEPARATOR)
        box_index, x = place
        y = row * self.cell[1]
        items = scene.boxes[box_index].items
        found = self.place(FOOTPRINTS[shape][size], x, y, box_index, items, rules)
        if not isinstance(found, tuple):
            return Edit(scene, found)
        x, y = found
        item = new_tuple(Item, (x, y, shape, colour, size))
        return new_tuple(Edit, (scene.with_box(box_index, Box((*items, item))), None))

    def place(
        self, footprint: int, x: int, y: int, box_index: int, items: Sequence[Item], rules: PlacementRules
    ) -> tuple[int, int] | InvalidReason:
        """The position of an item added to the cell with top-left pixel (x, y) of a box with `items`, or why it cannot
        be added."""
        last = LAST_CORNER[footprint]
        if x > last or y > last:
            return InvalidReason.OUT_OF_BOX
        tables = geometry.placement_tables()
        clearance, closest = tables.closest(footprint, x, y, items)
        if clearance == geometry.OVERLAPPING:
            from lilgym_mp.scene.appearances.scatter.cell_places import searched  # for where items are dense alone

            found = searched(footprint, x, y, self.cell, items) if self.searches(rules) else None
            if found is None:
                return InvalidReason.OVERLAP
            x, y = found
            _, closest = tables.closest(footprint, x, y, items)
        if closest is None or self.is_native:
            return x, y
        return geometry.snapped(footprint, x, y, closest, items, box_index, rules)

    def _remove(self, scene: Scene, action: RemoveItem) -> Edit:
        place = self._columns[action.column]
        if place is None:
            return Edit(scene, InvalidReason.SEPARATOR)
        box_index, x = place
        box = scene.boxes[box_index]
        position = self.covering(box.items, x, action.row * self.cell[1])
        if position < 0:
            return Edit(scene, InvalidReason.NOTHING_TO_REMOVE)
        return Edit(scene.with_box(box_index, box.without(position)))

    def covering(self, items: Sequence[Item], x: int, y: int) -> int:
        """The position of the item that covers most of the cell with top-left pixel (x, y), the first of equals; -1 if
        none covers any of it."""
        areas = [self._area_in_cell(item, x, y) for item in items]
        largest = max(areas, default=0)
        return areas.index(largest) if largest else -1

    def _area_in_cell(self, item: Item, cell_x: int, cell_y: int) -> int:
        width, height = self.cell
        dx = cell_x - item.x + width - 1
        dy = cell_y - item.y + height - 1
        areas = geometry.cell_areas(width, height)[item.footprint]
        return int(areas[dx, dy]) if 0 <= dx < areas.shape[0] and 0 <= dy < areas.shape[1] else 0

    def searches(self, rules: PlacementRules) -> bool:
        """Whether an item that would overlap others at its cell's corner may be placed elsewhere in the cell."""
        return rules.searches_cell and not self.is_native

    def legal_mask(self, scene: Scene, rules: PlacementRules) -> BoolArray:
        mask = np.zeros(self.action_count, bool)
        mask[0] = True
        for box, cells in zip(scene.boxes, self.box_cells, strict=True):
            adds = slice(add_index(cells.start, 0), add_index(cells.stop, 0))
            removes = slice(remove_index(cells.start, self.cell_count), remove_index(cells.stop, self.cell_count))
            mask[adds], mask[removes] = self._legal_in_box(box, rules)
        return mask

    def _legal_in_box(self, box: Box, rules: PlacementRules) -> tuple[BoolArray, BoolArray]:
        """Whether each ADD and each REMOVE in the box's cells is valid, in order of their indices."""
        searches = self.searches(rules)
        key = (self.grid, searches)
        found: tuple[BoolArray, BoolArray] | None = box.memo.get(key)
        if found is None:
            from lilgym_mp.scene.appearances.scatter.cell_places import ADDS, REMOVABLE, legal_edits

            legal = legal_edits(box.items, self.cell, searches=searches)
            found = box.memo[key] = ADDS.take(legal, axis=0).ravel(), legal & REMOVABLE != 0
        return found

    def explain(self, rules: PlacementRules) -> Iterator[str]:
        shapes, colours, sizes = ("|".join(member.name for member in enum) for enum in (Shape, Colour, Size))
        pixels = ", ".join(f"{size.name} {SIZE_PIXELS[size]}" for size in Size)
        yield (
            f"ADD(column, row, {shapes}, {colours}, {sizes}) puts an item into a box, its top-left corner at that of"
            f" the cell. Sides in pixels: {pixels}. Items may neither cross the border of their box nor overlap."
        )
        if self.searches(rules):
            yield "Where it would overlap there, a free place in the cell is looked for."
        if not self.is_native:
            yield "An item put within 4 pixels of another moves up to it."
        yield "REMOVE(column, row) takes away the item that fills the cell most."

    def check_scene(self, scene: Scene) -> Scene:
        for index, box in enumerate(scene.boxes):
            try:
                geometry.check_apart(box.items)
            except SceneError as fault:
                raise SceneError(f"box {index}: {fault}") from None
        return scene

    def _cell_index(self, column: int, row: int) -> int:
        columns, rows = self.grid
        return slot_value("x", column, columns) * rows + slot_value("y", row, rows)
