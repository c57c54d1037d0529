"""Many Scatter scenes at once: a core whose items are numbers, over the tables that the appearance itself reads.

What array operations do not settle (a search in the cell, a tie between nearest points, a scene with items that
overlap or lie outside their box, as the release's rules allow) is left to the appearance's own functions, one at a
time.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances import Edit, InvalidReason, Scatter
from lilgym_mp.appearances.placement import FIRST_TOO_FAR, placement_tables, searched
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
from lilgym_mp.envs.scatter_painter import TAKEN, Change, Lines, ScatterPainter
from lilgym_mp.envs.scatter_tables import (
    EMPTY_SLOT,
    KINDS,
    NO_KIND,
    NO_LOOK,
    PLACE_PITCH,
    SAME_PLACE,
    TIED,
    area_ranks,
    geometry,
    in_box,
    origins,
    packed,
)
from lilgym_mp.observation import EMPTY, item_array
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, Box, Colour, Item, Scene, Size

KEPT_ITEMS = 16_384
_ON_SEPARATOR, _OUT_OF_BOX, _OVERLAP, _NOTHING = (
    REASON_NUMBERS[reason]
    for reason in (
        InvalidReason.SEPARATOR,
        InvalidReason.OUT_OF_BOX,
        InvalidReason.OVERLAP,
        InvalidReason.NOTHING_TO_REMOVE,
    )
)
NO_ITEM = -1
_LOOK_FIELDS = np.array([*LOOKS, (EMPTY, EMPTY, EMPTY)], np.int16)  # (28, 3) shape, colour, size


class _Cells(NamedTuple):
    """The cells of the grid, by number."""

    count: int
    boxes: Int64Array  # (cells,); some box or other for a separator's
    places: Int64Array  # (cells,) of the top-left pixel in the box
    add_reasons: Int64Array  # (9 * cells,) by kind: why nothing can be added, whatever is there, or NO_REASON
    remove_reasons: Int64Array  # (cells,) likewise

    @classmethod
    def of(cls, appearance: Scatter) -> _Cells:
        columns, rows = appearance.grid
        width, height = appearance.cell
        boxes, xs = (numbers.repeat(rows) for numbers in np.divmod(np.arange(columns) * width, BOX_PITCH))
        on_separator = xs >= BOX_SIDE
        places = np.where(on_separator, 0, xs * PLACE_PITCH + np.tile(np.arange(rows) * height, columns))
        fits = in_box(np.arange(NO_KIND)[:, None], places)
        add_reasons = np.where(on_separator, _ON_SEPARATOR, np.where(fits, NO_REASON, _OUT_OF_BOX))
        remove_reasons = np.where(on_separator, _ON_SEPARATOR, NO_REASON)
        return cls(len(boxes), boxes, places, add_reasons.ravel(), remove_reasons)


class _Start(NamedTuple):
    scene: Scene
    lines: Lines | None  # None where arrays cannot follow


class _Starts:
    """The tasks' start scenes, each written down when it is first played."""

    def __init__(self, tasks: TaskSet, slots: int, painter: ScatterPainter) -> None:
        self._tasks = tasks
        self._painter = painter
        self._starts: list[_Start | None] = [None] * len(tasks)
        shape = len(tasks), BOX_COUNT, slots
        self.slots = np.full(shape, EMPTY_SLOT)  # by task, as in `ScatterArrays`
        self.items = np.full(shape, NO_ITEM)
        self.counts = np.zeros(shape[:2], np.int64)

    def of(self, tasks: Int64Array) -> list[_Start]:
        """The starts of tasks (k,); from now on the arrays tell of them, too."""
        return [self._starts[task] or self._first(task) for task in tasks.tolist()]

    def _first(self, task: int) -> _Start:
        scene = self._tasks[task].start
        start = self._starts[task] = _Start(scene, self._painter.lines(scene))
        for index, box in enumerate(scene.boxes):
            if box.items and start.lines is not None:
                count = self.counts[task, index] = len(box.items)
                xs, ys, shapes, colours, sizes = np.array(box.items, np.int64).T
                places, looks = xs * PLACE_PITCH + ys, (shapes * len(Colour) + colours) * len(Size) + sizes
                self.slots[task, index, :count] = packed(KINDS[looks], places)
                self.items[task, index, :count] = places * len(LOOKS) + looks
        return start


class _Adds(NamedTuple):
    """ADDs, one an environment. All arrays (k,)."""

    numbers: Int64Array  # of the environments
    rows: Int64Array  # 3 * environment + box
    looks: Int64Array  # in LOOKS
    kinds: Int64Array
    places: Int64Array  # of the cells' top-left pixels


class _Landing(NamedTuple):
    """What became of ADDs. All arrays (k,)."""

    reasons: Int64Array  # numbers of why it is invalid, or NO_REASON
    places: Int64Array  # where the item comes to rest, if valid
    loose: BoolArray  # whether that is over another item or out of the box, where arrays do not follow


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
        count, slots = len(block.action), block.items.shape[2] + 1
        self._every = np.arange(count)
        self._slots = np.full((count, BOX_COUNT, slots), EMPTY_SLOT)
        self._items = np.full((count, BOX_COUNT, slots), NO_ITEM)  # place * 27 + look of what the slots hold
        self._counts = np.zeros((count, BOX_COUNT), np.int64)
        self._row_slots = self._slots.reshape(-1, slots)  # the same by row, which is 3 * environment + box
        self._row_items = self._items.reshape(-1, slots)
        self._row_counts = self._counts.reshape(-1)
        self._flat_slots, self._flat_items = self._slots.reshape(-1), self._items.reshape(-1)
        self._slot_count = slots
        self._loose = np.zeros(count, np.bool_)  # whether only `_scenes` tells of an environment's scene
        self._scenes = [Scene.empty()] * count
        self._stale = np.zeros((count, BOX_COUNT), np.bool_)  # boxes in which `_scenes` lags behind the slots
        self._row_stale = self._stale.reshape(-1)
        self._painter = ScatterPainter(block.image, image_size)
        self._starts = _Starts(tasks, slots, self._painter)
        self._masks: ScatterMasks | None = None  # made when they are first asked for
        self._cells = _Cells.of(appearance)
        self._first_remove = 1 + self._cells.count * len(LOOKS)
        self._searches = dynamics.rules.placement.searches_cell and not appearance.is_native
        self._snaps = not appearance.is_native
        self._area_ranks = area_ranks(*appearance.cell)

    def start(self, which: Int64Array, tasks: Int64Array) -> None:
        if not len(which):
            return
        starts = self._starts.of(tasks)
        self._block.task[which] = tasks
        self._block.steps[which] = 0
        self._stale[which] = False
        self._slots[which] = self._starts.slots[tasks]
        self._items[which] = self._starts.items[tasks]
        self._counts[which] = self._starts.counts[tasks]
        self._loose[which] = [start.lines is None for start in starts]
        shown: list[int] = []
        lines: list[Lines] = []
        for number, start in zip(which.tolist(), starts, strict=True):
            self._scenes[number] = start.scene
            if start.lines is None:
                self._painter.redraw(number, start.scene)
            else:
                shown.append(number)
                lines.append(start.lines)
        if shown:
            self._painter.show(np.array(shown), lines)

    def step(self, which: Int64Array | None) -> None:
        block = self._block
        which = self._every if which is None else which
        actions = block.action[which]
        steps = block.steps[which] + 1
        last = steps >= self._dynamics.horizon
        applies = self._applies[2 * VALID_EDIT + last]
        loose, stops, removes = self._loose[which], actions == 0, actions >= self._first_remove
        reasons = np.full(len(which), NO_REASON)
        changes: list[Change] = []
        for chosen, take in ((~(removes | stops | loose), self._add), (removes & ~loose, self._remove)):
            places = chosen.nonzero()[0]
            if len(places):
                reasons[places], change = take(which[places], actions[places], applies[places])
                changes.append(change)
        if changes:
            self._painter.change(changes)
        for place in (loose & ~stops).nonzero()[0].tolist():
            reasons[place] = self._edit_scene(int(which[place]), applies=bool(applies[place]))
        situations = np.where(reasons == NO_REASON, VALID_EDIT, INVALID_EDIT)
        stopping = stops.nonzero()[0]
        if len(stopping):
            situations[stopping] = np.where(self._solved(which[stopping]), RIGHT_STOP, WRONG_STOP)
        block.steps[which] = steps
        block.verdict[which] = 2 * situations + last
        block.invalid[which] = reasons

    def _add(self, numbers: Int64Array, actions: Int64Array, applies: BoolArray) -> tuple[Int64Array, Change]:
        """(k,) why ADDs are invalid. Those that are valid and apply are done, but for the change in the picture."""
        cells, looks = np.divmod(actions - 1, len(LOOKS))
        kinds = KINDS.take(looks)
        rows = numbers * BOX_COUNT + self._cells.boxes.take(cells)
        adds = _Adds(numbers, rows, looks, kinds, self._cells.places.take(cells))
        reasons, places, loose = self._landing(adds, self._cells.add_reasons.take(kinds * self._cells.count + cells))
        done = applies & (reasons == NO_REASON)
        if loose.any():
            for number in numbers[done & loose].tolist():
                self._edit_scene(number, applies=True)
            done &= ~loose
        kept = done.nonzero()[0]
        rows, places, looks, kinds = rows[kept], places[kept], looks[kept], kinds[kept]
        free = rows * self._slot_count + self._row_counts[rows]
        self._flat_slots[free] = packed(kinds, places)
        self._flat_items[free] = places * len(LOOKS) + looks
        self._row_counts[rows] += 1
        self._row_stale[rows] = True
        return reasons, Change(rows, places, looks)

    def _landing(self, adds: _Adds, reasons: Int64Array) -> _Landing:
        """`reasons` (k,) why nothing can be added to the cells, whatever is there, or NO_REASON; written."""
        _, rows, _, kinds, places = adds
        clearance = geometry().clearance
        slots = self._row_slots.take(rows, 0)[:, : int(self._row_counts.take(rows).max()) + 1]
        pairs = origins(kinds, places)[:, None] - slots  # (k, slots) where the tables tell of the new item and each
        codes = clearance.take(pairs)
        blocked = (~_apart(codes) & (reasons == NO_REASON)).nonzero()[0]
        if len(blocked):
            reasons[blocked] = _OVERLAP
            if self._searches:
                placed = self._search(adds, blocked)
                reasons[placed] = NO_REASON
                pairs[placed] = origins(kinds[placed], places[placed])[:, None] - slots[placed]
                codes[placed] = clearance.take(pairs[placed])
        loose = np.zeros(len(places), np.bool_)
        near = ((codes.min(1) < FIRST_TOO_FAR) & (reasons == NO_REASON)).nonzero()[0]
        if self._snaps and len(near):
            some = _Adds(*(array[near] for array in adds))
            places[near], loose[near] = self._snapped(some, pairs[near], codes[near].argmin(1))
        return _Landing(reasons, places, loose)

    def _search(self, adds: _Adds, blocked: Int64Array) -> Int64Array:
        """Looks for a place elsewhere in the cell for the ADDs `blocked`, and writes it. Those that have found one."""
        found: list[int] = []
        rows = adds.rows[blocked]
        parts = adds.kinds[blocked], adds.places[blocked], self._row_counts[rows], self._row_items[rows]
        kinds, corners, counts, there = (part.tolist() for part in parts)
        for add, kind, corner, count, others in zip(blocked.tolist(), kinds, corners, counts, there, strict=True):
            place = searched(kind, *divmod(corner, PLACE_PITCH), self._appearance.cell, map(_item, others[:count]))
            if place is not None:
                adds.places[add] = place[0] * PLACE_PITCH + place[1]
                found.append(add)
        return np.array(found, np.int64)

    def _snapped(self, adds: _Adds, pairs: Int64Array, closest: Int64Array) -> tuple[Int64Array, BoolArray]:
        """(k,) where items that snap to those in the slots `closest` (k,) come to rest.

        And whether that is where arrays cannot follow. `pairs` as in `_landing`.
        """
        _, rows, _, kinds, places = adds
        moves = geometry().moves.take(pairs[np.arange(len(closest)), closest]).astype(np.int64)
        for tied in (moves == TIED).nonzero()[0].tolist():
            moves[tied] = self._tied_move(int(rows[tied]), int(kinds[tied]), int(places[tied]), int(closest[tied]))
        new_places = places + moves
        codes = geometry().clearance.take(pairs + moves[:, None], mode="clip")  # beyond the tables: out of the box
        fits = in_box(kinds, new_places) & _apart(codes)
        if self._dynamics.rules.placement.keeps_unfit_snaps:
            return new_places, ~fits
        return np.where(fits, new_places, places), np.zeros(len(places), np.bool_)

    def _tied_move(self, row: int, kind: int, place: int, closest: int) -> int:
        """By how much the place changes of an item that snaps to the one in slot `closest`."""
        frame_x = row % BOX_COUNT * BOX_PITCH if self._dynamics.rules.placement.rounds_in_image else 0
        other = _item(int(self._row_items[row, closest]))
        move_x, move_y = placement_tables().move(kind, *divmod(place, PLACE_PITCH), other, frame_x)
        return move_x * PLACE_PITCH + move_y

    def _remove(self, numbers: Int64Array, actions: Int64Array, applies: BoolArray) -> tuple[Int64Array, Change]:
        """(k,) why REMOVEs are invalid. Those that are valid and apply are done, but for the change in the picture."""
        cells = actions - self._first_remove
        rows = numbers * BOX_COUNT + self._cells.boxes.take(cells)
        slots = self._row_slots.take(rows, 0)
        areas = self._area_ranks.take((SAME_PLACE + self._cells.places.take(cells))[:, None] - slots)
        largest = areas.argmax(1)
        reasons = self._cells.remove_reasons.take(cells)
        reasons[(areas[np.arange(len(largest)), largest] == 0) & (reasons == NO_REASON)] = _NOTHING
        done = (applies & (reasons == NO_REASON)).nonzero()[0]
        return reasons, self._take(rows[done], largest[done])

    def _take(self, rows: Int64Array, taken: Int64Array) -> Change:
        """Takes items out of slots `taken` (k,), and moves later ones up."""
        places, looks = np.divmod(self._row_items[rows, taken], len(LOOKS))
        sources = np.arange(self._slot_count - 1)
        sources = sources + (sources >= taken[:, None])  # (k, slots): where what comes to be in each is now
        self._row_slots[rows, :-1] = self._row_slots[rows[:, None], sources]
        self._row_items[rows, :-1] = self._row_items[rows[:, None], sources]
        self._row_counts[rows] -= 1
        self._row_stale[rows] = True
        return Change(rows, places, looks + TAKEN)

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
            self._painter.redraw(number, edit.scene)
        return NO_REASON if edit.invalid is None else REASON_NUMBERS[edit.invalid]

    def _solved(self, numbers: Int64Array) -> list[bool]:
        """(k,) whether STOP succeeds in environments."""
        self._bring_scenes(numbers)
        tasks = self._block.task[numbers].tolist()
        pairs = zip(tasks, numbers.tolist(), strict=True)
        return [self._tasks[task].solved_by(self._scenes[number]) for task, number in pairs]

    def _scene(self, number: int) -> Scene:
        self._bring_scenes(np.array([number]))
        return self._scenes[number]

    def _bring_scenes(self, numbers: Int64Array) -> None:
        """Makes `_scenes` tell of environments (k,)."""
        stale = self._stale[numbers]
        if not stale.any():
            return
        self._stale[numbers] = False
        counts = self._counts[numbers]
        most = int(counts.max())
        parts = stale, counts, self._items[numbers, :, :most]
        for number, *boxes in zip(numbers.tolist(), *(part.tolist() for part in parts), strict=True):
            left, middle, right = (
                Box(tuple(map(_item, items[:count]))) if changed else box
                for changed, count, items, box in zip(*boxes, self._scenes[number].boxes, strict=True)
            )
            self._scenes[number] = Scene((left, middle, right))

    def write_masks(self) -> None:
        if self._masks is None:
            self._masks = ScatterMasks(self._appearance, self._dynamics.rules.placement, self._block.mask)
        loose = {
            BOX_COUNT * number + index: box.items
            for number in self._loose.nonzero()[0].tolist()
            for index, box in enumerate(self._scenes[number].boxes)
        }
        self._masks.refresh(self._row_slots, self._row_counts, loose)

    def write_goals(self) -> None:
        self._block.goal[:] = self._solved(self._every)

    def write_items(self) -> None:
        items = self._block.items
        numbers = self._items[..., :-1]
        places, looks = np.divmod(numbers, len(LOOKS))
        for field, values in enumerate(np.divmod(places, PLACE_PITCH)):
            items[..., field] = np.where(numbers == NO_ITEM, EMPTY, values)
        items[..., 2:] = _LOOK_FIELDS[np.where(numbers == NO_ITEM, NO_LOOK, looks)]
        for number in self._loose.nonzero()[0].tolist():
            items[number] = item_array(self._scenes[number], items.shape[2])

    def state(self, number: int) -> State:
        block = self._block
        return State(self._tasks[block.task[number]], self._scene(number), int(block.steps[number]))


def _apart(codes: NDArray[np.uint8]) -> BoolArray:
    """(k,) whether new items overlap nothing, by their clearance codes (k, slots)."""
    return codes.all(1)  # OVERLAPPING is 0


class _Items(dict[int, Item]):
    """Items by number."""

    def __missing__(self, number: int) -> Item:
        if len(self) >= KEPT_ITEMS:
            self.clear()
        place, look = divmod(number, len(LOOKS))
        item = self[number] = Item(*divmod(place, PLACE_PITCH), *LOOKS[look])
        return item


_item = _Items().__getitem__
