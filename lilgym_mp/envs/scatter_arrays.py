"""Many Scatter scenes at once: a core whose items are numbers, over the tables that the appearance itself reads.

What array operations do not settle (a search in the cell, a tie between nearest points, a scene with items that
overlap or lie outside their box, as the release's rules allow) is the appearance's own to apply, one at a time.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from lilgym_mp.appearances import Edit, InvalidReason, Scatter
from lilgym_mp.appearances.placement import FIRST_TOO_FAR, LARGEST_MOVE, OVERLAPPING
from lilgym_mp.appearances.scatter import LOOKS
from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.block import (
    INVALID_EDIT,
    NO_REASON,
    REASON_NUMBERS,
    RIGHT_STOP,
    VALID_EDIT,
    WRONG_STOP,
    Block,
    BoolArray,
    Int64Array,
)
from lilgym_mp.envs.scatter_masks import ScatterMasks
from lilgym_mp.envs.scatter_painter import TAKEN, Change, ScatterPainter
from lilgym_mp.envs.scatter_tables import (
    EMPTY_SLOT,
    KINDS,
    NO_LOOK,
    PLACE_PITCH,
    SAME_PLACE,
    TIED,
    area_ranks,
    geometry,
    inside,
    packed,
    search,
    unpacked,
)
from lilgym_mp.observation import EMPTY, item_array
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, Box, Colour, Item, Scene, Size

KEPT_ITEMS = 16_384
SEPARATOR = BOX_COUNT  # in place of a box
_ON_SEPARATOR, _OUT_OF_BOX, _OVERLAP, _NOTHING = (
    REASON_NUMBERS[reason]
    for reason in (
        InvalidReason.SEPARATOR,
        InvalidReason.OUT_OF_BOX,
        InvalidReason.OVERLAP,
        InvalidReason.NOTHING_TO_REMOVE,
    )
)
_LOOK_FIELDS = np.array([*LOOKS, (EMPTY, EMPTY, EMPTY)], np.int16)  # (28, 3) shape, colour, size


class _Edits(NamedTuple):
    """ADDs or REMOVEs, one an environment. All arrays (k,)."""

    numbers: Int64Array  # of the environments
    boxes: Int64Array  # or SEPARATOR
    xs: Int64Array  # in the box, of the cell's top-left pixel
    ys: Int64Array
    looks: Int64Array  # in LOOKS, or NO_LOOK for a REMOVE

    def at(self, places: Int64Array | BoolArray) -> _Edits:
        """Some of them."""
        return _Edits(*(array[places] for array in self))

    @property
    def rows(self) -> Int64Array:
        """(k,) 3 * environment + box; on a separator, of some box there is."""
        return self.numbers * BOX_COUNT + np.minimum(self.boxes, BOX_COUNT - 1)


class _Landing(NamedTuple):
    """What became of ADDs. All arrays (k,)."""

    reasons: Int64Array  # numbers of why it is invalid, or NO_REASON
    places: Int64Array  # where the item comes to rest, if valid
    loose: BoolArray  # whether that is over another item or out of the box, where arrays do not follow


class _NewItems(NamedTuple):
    """Items on their way into a box. All arrays (k, ...)."""

    numbers: Int64Array  # of the environments
    boxes: Int64Array
    kinds: Int64Array
    places: Int64Array  # where they are now
    slots: Int64Array  # (k, slots) what is there already

    def at(self, which: Int64Array) -> _NewItems:
        """Some of them."""
        return _NewItems(*(array[which] for array in self))


class ScatterArrays:
    """`cores.Core` for Scatter.

    A box is a row of slots (`scatter_tables.Geometry`), items from the left in their order, the last always empty.
    """

    def __init__(self, dynamics: Dynamics, tasks: TaskSet, block: Block, image_size: str) -> None:
        self._dynamics = dynamics
        self._appearance = appearance = cast(Scatter, dynamics.appearance)
        self._tasks = tasks
        self._block = block
        self._applies = np.array([verdict.applies for verdict in dynamics.verdicts])
        count, capacity = len(block.action), block.items.shape[2]
        self._every = np.arange(count)
        self._slots = np.full((BOX_COUNT * count, capacity + 1), EMPTY_SLOT)
        self._looks = np.full((BOX_COUNT * count, capacity + 1), NO_LOOK)
        self._counts = np.zeros(BOX_COUNT * count, np.int64)
        self._loose = np.zeros(count, np.bool_)  # whether only `_scenes` tells of an environment's scene
        self._items: list[tuple[Item, ...]] = [()] * (BOX_COUNT * count)  # of each box
        self._scenes = [Scene.empty()] * count
        self._stale = np.zeros(count, np.bool_)  # whether `_scenes` lags behind `_items`
        self._painter = ScatterPainter(block.image, image_size)
        self._masks: ScatterMasks | None = None  # made when they are first asked for
        columns, rows = appearance.grid
        width, height = appearance.cell
        boxes, xs = np.divmod(np.arange(columns) * width, BOX_PITCH)
        self._box_of_column = np.where(xs < BOX_SIDE, boxes, SEPARATOR)
        self._x_of_column = np.minimum(xs, BOX_SIDE - width)
        self._y_of_row = np.arange(rows) * height
        self._first_remove = 1 + columns * rows * len(LOOKS)
        self._searches = dynamics.rules.placement.searches_cell and not appearance.is_native
        self._snaps = not appearance.is_native
        self._area_ranks = area_ranks(width, height)

    def start(self, which: Int64Array, tasks: Int64Array) -> None:
        self._block.task[which] = tasks
        self._block.steps[which] = 0
        self._stale[which] = False
        for number, task in zip(which.tolist(), tasks.tolist(), strict=True):
            self._put(number, self._tasks[task].start)

    def _put(self, number: int, scene: Scene) -> None:
        """Makes `scene` that of an environment."""
        self._scenes[number] = scene
        first = number * BOX_COUNT
        self._items[first : first + BOX_COUNT] = [box.items for box in scene.boxes]
        loose = not self._painter.show(number, scene)
        self._loose[number] = loose
        if loose:
            self._painter.redraw(number, scene)
            return
        self._slots[first : first + BOX_COUNT] = EMPTY_SLOT
        self._looks[first : first + BOX_COUNT] = NO_LOOK
        for row, box in enumerate(scene.boxes, first):
            count = self._counts[row] = len(box.items)
            if count:
                self._slots[row, :count], self._looks[row, :count] = _slots_and_looks(box)

    def step(self, which: Int64Array | None) -> None:
        block = self._block
        which = self._every if which is None else which
        actions = block.action[which]
        steps = block.steps[which] + 1
        last = steps >= self._dynamics.horizon
        applies = self._applies[2 * VALID_EDIT + last]
        reasons = np.full(len(which), NO_REASON)
        edits, stops, loose = self._decoded(which, actions), actions == 0, self._loose[which]
        removes = edits.looks == NO_LOOK
        changes: list[Change] = []
        for chosen, take in ((~removes, self._add), (removes, self._remove)):
            places = np.flatnonzero(chosen & ~(stops | loose))
            if len(places):
                reasons[places], change = take(edits.at(places), applies[places])
                changes.append(change)
        if changes:
            self._painter.change(changes)
        for place in np.flatnonzero(loose & ~stops).tolist():
            reasons[place] = self._edit_scene(int(which[place]), applies=bool(applies[place]))
        situations = np.where(reasons == NO_REASON, VALID_EDIT, INVALID_EDIT)
        for place in np.flatnonzero(stops).tolist():
            solved = self._solved(int(which[place]))
            situations[place] = RIGHT_STOP if solved else WRONG_STOP
        block.steps[which] = steps
        block.verdict[which] = 2 * situations + last
        block.invalid[which] = reasons

    def _decoded(self, which: Int64Array, actions: Int64Array) -> _Edits:
        """The actions taken apart; STOP becomes some edit or other."""
        removes = actions >= self._first_remove
        cells, looks = np.divmod(actions - 1, len(LOOKS))
        columns, rows = np.divmod(np.where(removes, actions - self._first_remove, cells), len(self._y_of_row))
        looks[removes] = NO_LOOK
        return _Edits(which, self._box_of_column[columns], self._x_of_column[columns], self._y_of_row[rows], looks)

    def _add(self, adds: _Edits, applies: BoolArray) -> tuple[Int64Array, Change]:
        """(k,) why ADDs are invalid. Those that are valid and apply are done, but for the change in the picture."""
        reasons, places, loose = self._landing(adds)
        done = applies & (reasons == NO_REASON)
        for number in adds.numbers[done & loose].tolist():
            self._edit_scene(number, applies=True)
        kept = np.flatnonzero(done & ~loose)
        adds, places, rows = adds.at(kept), places[kept], adds.rows[kept]
        free = self._counts[rows]
        self._slots[rows, free] = packed(KINDS[adds.looks], places)
        self._looks[rows, free] = adds.looks
        self._counts[rows] = free + 1
        for row, place, look in zip(rows.tolist(), places.tolist(), adds.looks.tolist(), strict=True):
            self._items[row] += (_item(place, look),)
        self._stale[adds.numbers] = True
        return reasons, Change(rows, places, adds.looks)

    def _landing(self, adds: _Edits) -> _Landing:
        kinds, places = KINDS[adds.looks], adds.xs * PLACE_PITCH + adds.ys
        new = _NewItems(adds.numbers, adds.boxes, kinds, places, self._slots[adds.rows])
        reasons = np.where(inside(kinds, adds.xs, adds.ys), NO_REASON, _OUT_OF_BOX)
        reasons[adds.boxes == SEPARATOR] = _ON_SEPARATOR
        closest, clearance = geometry().closest(kinds, places, new.slots)
        loose = np.zeros(len(places), np.bool_)
        blocked = np.flatnonzero((clearance == OVERLAPPING) & (reasons == NO_REASON))
        reasons[blocked] = _OVERLAP
        if self._searches and len(blocked):
            found, free_places = search(self._appearance.cell, kinds[blocked], places[blocked], new.slots[blocked])
            placed = blocked[found]
            reasons[placed] = NO_REASON
            places[placed] = free_places[found]
            closest[placed], clearance[placed] = geometry().closest(kinds[placed], places[placed], new.slots[placed])
        near = np.flatnonzero((clearance < FIRST_TOO_FAR) & (reasons == NO_REASON))
        if self._snaps and len(near):
            places[near], loose[near] = self._snapped(new.at(near), closest[near])
        return _Landing(reasons, places, loose)

    def _snapped(self, new: _NewItems, closest: Int64Array) -> tuple[Int64Array, BoolArray]:
        """(k,) where items that snap to those in slots `closest` come to rest, and whether arrays cannot follow."""
        numbers, boxes, kinds, places, slots = new
        xs, ys = np.divmod(places, PLACE_PITCH)
        codes = geometry().snap_moves(kinds, places, slots[np.arange(len(closest)), closest])
        xs += (codes >> 4) - LARGEST_MOVE
        ys += (codes & 15) - LARGEST_MOVE
        for tied in np.flatnonzero(codes == TIED).tolist():
            xs[tied], ys[tied] = self._edit(int(numbers[tied])).scene.boxes[boxes[tied]].items[-1][:2]
        fits, new_places = inside(kinds, xs, ys), xs * PLACE_PITCH + ys
        _, clearance = geometry().closest(kinds, np.where(fits, new_places, places), slots)
        unfit = ~fits | (clearance == OVERLAPPING)
        if self._dynamics.rules.placement.keeps_unfit_snaps:
            return new_places, unfit
        return np.where(unfit, places, new_places), np.zeros(len(places), np.bool_)

    def _remove(self, removes: _Edits, applies: BoolArray) -> tuple[Int64Array, Change]:
        """(k,) why REMOVEs are invalid. Those that are valid and apply are done, but for the change in the picture."""
        slots = self._slots[removes.rows]
        cells = removes.xs * PLACE_PITCH + removes.ys
        areas = self._area_ranks.take((SAME_PLACE + cells)[:, None] - slots)
        largest = areas.argmax(1)
        found = areas[np.arange(len(largest)), largest] > 0
        reasons = np.where(found, NO_REASON, _NOTHING)
        reasons[removes.boxes == SEPARATOR] = _ON_SEPARATOR
        done = np.flatnonzero(applies & (reasons == NO_REASON))
        return reasons, self._take(removes.at(done), largest[done])

    def _take(self, removes: _Edits, taken: Int64Array) -> Change:
        """Takes items out of slots `taken` (k,), and moves later ones up."""
        rows = removes.rows
        _, places = unpacked(self._slots[rows, taken])
        change = Change(rows, places, self._looks[rows, taken] + TAKEN)
        sources = np.arange(self._slots.shape[1] - 1)
        sources = sources + (sources >= taken[:, None])  # (k, slots): where what comes to be in each is now
        self._slots[rows, :-1] = self._slots[rows[:, None], sources]
        self._looks[rows, :-1] = self._looks[rows[:, None], sources]
        self._counts[rows] -= 1
        for row, slot in zip(rows.tolist(), taken.tolist(), strict=True):
            items = self._items[row]
            self._items[row] = items[:slot] + items[slot + 1 :]
        self._stale[removes.numbers] = True
        return change

    def _edit(self, number: int) -> Edit:
        """What the appearance makes of an environment's action."""
        action = self._appearance.decode(int(self._block.action[number]))
        return self._appearance.apply(self._scene(number), action, self._dynamics.rules.placement)

    def _edit_scene(self, number: int, *, applies: bool) -> int:
        """Why an action on a scene that arrays cannot follow is invalid. Does it if it is valid and applies."""
        edit = self._edit(number)
        if applies and edit.invalid is None:
            self._scenes[number] = edit.scene
            self._loose[number] = True
            self._items[number * BOX_COUNT : (number + 1) * BOX_COUNT] = [box.items for box in edit.scene.boxes]
            self._painter.redraw(number, edit.scene)
        return _reason(edit)

    def _solved(self, number: int) -> bool:
        return self._tasks[self._block.task[number]].solved_by(self._scene(number))

    def _scene(self, number: int) -> Scene:
        if self._stale[number] and not self._loose[number]:
            first = number * BOX_COUNT
            old = zip(self._scenes[number].boxes, self._items[first : first + BOX_COUNT], strict=True)
            left, middle, right = (box if box.items is items else Box(items) for box, items in old)
            self._scenes[number] = Scene((left, middle, right))
            self._stale[number] = False
        return self._scenes[number]

    def write_masks(self) -> None:
        if self._masks is None:
            self._masks = ScatterMasks(self._appearance, self._dynamics.rules.placement, self._block.mask)
        self._masks.refresh(self._items)

    def write_goals(self) -> None:
        self._block.goal[:] = [self._solved(number) for number in range(len(self._scenes))]

    def write_items(self) -> None:
        items = self._block.items
        shape = items.shape[:3]
        _, places = unpacked(self._slots[:, :-1])
        looks = self._looks[:, :-1]
        for field, values in enumerate(np.divmod(places, PLACE_PITCH)):
            items[..., field] = np.where(looks == NO_LOOK, EMPTY, values).reshape(shape)
        items[..., 2:] = _LOOK_FIELDS[looks].reshape(*shape, 3)
        for number in np.flatnonzero(self._loose).tolist():
            items[number] = item_array(self._scenes[number], shape[2])

    def state(self, number: int) -> State:
        block = self._block
        return State(self._tasks[block.task[number]], self._scene(number), int(block.steps[number]))


@lru_cache(maxsize=KEPT_ITEMS)
def _item(place: int, look: int) -> Item:
    x, y = divmod(place, PLACE_PITCH)
    return Item(x, y, *LOOKS[look])


def _reason(edit: Edit) -> int:
    return NO_REASON if edit.invalid is None else REASON_NUMBERS[edit.invalid]


def _slots_and_looks(box: Box) -> tuple[Int64Array, Int64Array]:
    """What the box's slots hold. Kept in its memo."""
    if "slots" not in box.memo:
        items = np.array(box.items, np.int64)
        xs, ys, shapes, colours, sizes = items.T
        looks = (shapes * len(Colour) + colours) * len(Size) + sizes
        box.memo["slots"] = packed(KINDS[looks], xs * PLACE_PITCH + ys), looks
    return box.memo["slots"]
