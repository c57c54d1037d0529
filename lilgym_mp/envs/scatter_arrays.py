"""Many Scatter scenes at once: a core whose items are numbers.

A scene with items that overlap or lie outside their box, as the release's rules allow, is loose: only the appearance
itself follows it, one scene at a time.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np

from lilgym_mp.appearances import Scatter
from lilgym_mp.appearances.scatter import LOOKS
from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.block import (
    EDIT_SITUATIONS,
    NO_REASON,
    REASON_NUMBERS,
    RIGHT_STOP,
    VALID_EDIT,
    WRONG_STOP,
    Block,
    Int64Array,
)
from lilgym_mp.envs.scatter_edits import LOOSE, NO_ITEM, ArrayEdits, Boxes, EditsMaker, item_of
from lilgym_mp.envs.scatter_masks import ScatterMasks
from lilgym_mp.envs.scatter_painter import adds_up
from lilgym_mp.envs.scatter_tables import KINDS, PLACE_PITCH, packed
from lilgym_mp.observation import EMPTY, Int16Array, item_array
from lilgym_mp.render import Canvas
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, Box, Colour, Item, Scene, Size

NOT_WRITTEN = NO_ITEM - 1
_FIELDS = np.dtype([("place", "V4"), ("look", "V6")])  # an item in `observation.item_array`
_XS, _YS = np.divmod(np.arange(BOX_SIDE * PLACE_PITCH), PLACE_PITCH)
_PLACE_FIELDS = np.stack([_XS, _YS], axis=1).astype(np.int16).view("V4")[:, 0]  # (places,) x, y
_LOOK_FIELDS = np.array(LOOKS, np.int16).view("V6")[:, 0]  # (27,) shape, colour, size
_EMPTY_FIELDS = np.full(len(Item._fields), EMPTY, np.int16).view(_FIELDS)


class Makers(NamedTuple):
    """Who makes what a core leaves to others."""

    edits: EditsMaker
    masks: type[ScatterMasks]


class _Starts:
    """The tasks' start scenes, each written down when it is first played."""

    def __init__(self, tasks: TaskSet, slots: int) -> None:
        self._tasks = tasks
        self._known: list[Scene | None] = [None] * len(tasks)
        self.loose = np.zeros(len(tasks), np.bool_)
        self.boxes = Boxes.empty(BOX_COUNT * len(tasks), slots)  # by 3 * task + box; empty where loose

    def scenes(self, tasks: Int64Array) -> list[Scene]:
        """Those of tasks (k,); from now on `boxes` and `loose` tell of them, too."""
        return [self._known[task] or self._first(task) for task in tasks.tolist()]

    def _first(self, task: int) -> Scene:
        scene = self._known[task] = self._tasks[task].start
        self.loose[task] = not adds_up(scene)
        for row, box in enumerate(scene.boxes, BOX_COUNT * task):
            if box.items and not self.loose[task]:
                count = self.boxes.counts[row] = self.boxes.kept[row] = len(box.items)
                xs, ys, shapes, colours, sizes = np.array(box.items, np.int64).T
                places, looks = xs * PLACE_PITCH + ys, (shapes * len(Colour) + colours) * len(Size) + sizes
                self.boxes.slots[row, :count] = packed(KINDS[looks], places)
                self.boxes.items[row, :count] = places * len(LOOKS) + looks
        return scene


class ScatterArrays:
    """`cores.Core` for Scatter."""

    def __init__(
        self, dynamics: Dynamics, tasks: TaskSet, block: Block, image_size: str, makers: Makers | None = None
    ) -> None:
        """`makers`: by default those that use NumPy."""
        self._dynamics = dynamics
        self._appearance = cast(Scatter, dynamics.appearance)
        self._tasks = tasks
        self._block = block
        self._image_size = image_size
        self._applies = np.array([verdict.applies for verdict in dynamics.verdicts])
        count, slots = len(block.action), block.items.shape[2] + 1
        self._every = np.arange(count)
        boxes = Boxes.empty(BOX_COUNT * count, slots)
        self._boxes = boxes.by_environment()
        self._makers = makers = makers or Makers(ArrayEdits, ScatterMasks)
        self._edits = makers.edits(self._appearance, dynamics.rules.placement, boxes, block.image, image_size)
        self._starts = _Starts(tasks, slots)
        self._scenes = [Scene.empty()] * count  # as they were when `_boxes.kept` became `_boxes.counts`
        self._loose = np.zeros(count, np.bool_)  # environments of which only `_scenes` tells
        self._canvases: dict[int, Canvas] = {}  # of those
        self._masks: ScatterMasks | None = None  # made when they are first asked for
        self._written = np.full((BOX_COUNT * count, slots - 1), NOT_WRITTEN)  # what `block.items` is of

    def start(self, which: Int64Array, tasks: Int64Array) -> None:
        if not len(which):
            return
        scenes = self._starts.scenes(tasks)
        self._block.task[which] = tasks
        self._block.steps[which] = 0
        loose = self._loose[which] = self._starts.loose[tasks]
        numbers = which.tolist()
        for number, scene in zip(numbers, scenes, strict=True):
            self._scenes[number] = scene
        for number in self._canvases.keys() & numbers:
            del self._canvases[number]
        unfollowed = loose.nonzero()[0].tolist()
        for place in unfollowed:
            scenes[place] = Scene.empty()
        self._edits.begin(which, self._starts.boxes, tasks, scenes)
        for place in unfollowed:
            self._draw_loose(numbers[place])

    def step(self, which: Int64Array | None) -> None:
        block = self._block
        which = self._every if which is None else which
        actions = block.action[which]
        steps = block.steps[which] + 1
        last = steps >= self._dynamics.horizon
        applies = self._applies[2 * VALID_EDIT + last]
        reasons = self._edits.edit(which, actions, applies, self._loose)
        for place in (reasons == LOOSE).nonzero()[0].tolist():
            reasons[place] = self._edit_scene(int(which[place]), applies=bool(applies[place]))
        situations = EDIT_SITUATIONS.take(reasons == NO_REASON)
        stopping = (actions == 0).nonzero()[0]
        if len(stopping):
            situations[stopping] = np.where(self._solved(which[stopping]), RIGHT_STOP, WRONG_STOP)
        block.steps[which] = steps
        block.verdict[which] = 2 * situations + last
        block.invalid[which] = reasons

    def _edit_scene(self, number: int, *, applies: bool) -> int:
        """Why an action is invalid that makes a scene loose, or meets one. Does it if it is valid and applies."""
        action = self._appearance.decode(int(self._block.action[number]))
        edit = self._appearance.apply(self._scene(number), action, self._dynamics.rules.placement)
        if applies and edit.invalid is None:
            self._scenes[number] = edit.scene
            self._loose[number] = True
            self._draw_loose(number)
        return NO_REASON if edit.invalid is None else REASON_NUMBERS[edit.invalid]

    def _draw_loose(self, number: int) -> None:
        if number not in self._canvases:
            self._canvases[number] = Canvas(self._image_size, self._block.image[number])
        self._canvases[number].show(self._scenes[number])

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
        items, counts = self._boxes.items.take(numbers, 0), self._boxes.counts.take(numbers, 0)
        kept = self._boxes.kept.take(numbers, 0)
        self._boxes.kept[numbers] = counts
        parts = kept.tolist(), counts.tolist(), items[:, :, : int(counts.max())].tolist()
        for number, kept_there, there, items in zip(numbers.tolist(), *parts, strict=True):
            if not self._loose[number]:
                before = self._scenes[number].boxes
                left, middle, right = map(_box_of, before, kept_there, there, items)
                if not (left is before[0] and middle is before[1] and right is before[2]):
                    self._scenes[number] = Scene((left, middle, right))

    def write_masks(self) -> None:
        if self._masks is None:
            self._masks = self._makers.masks(self._appearance, self._dynamics.rules.placement, self._block.mask)
        loose = {
            BOX_COUNT * number + index: box.items
            for number in self._loose.nonzero()[0].tolist()
            for index, box in enumerate(self._scenes[number].boxes)
        }
        slots, _, counts, _ = self._boxes
        self._masks.refresh(slots.reshape(-1, slots.shape[2]), counts.ravel(), loose)

    def write_goals(self) -> None:
        self._block.goal[:] = self._solved(self._every)

    def write_items(self) -> None:
        items = self._block.items
        numbers = self._boxes.items.reshape(len(self._written), -1)[:, :-1]
        differing = (numbers != self._written).ravel().nonzero()[0]
        rows, slots = np.divmod(differing, numbers.shape[1])
        changed = numbers[rows, slots]
        items.reshape(-1, items.shape[3])[differing] = _fields(changed)
        self._written[rows, slots] = changed
        for number in self._loose.nonzero()[0].tolist():
            items[number] = item_array(self._scenes[number], items.shape[2])
            self._written[number * BOX_COUNT : (number + 1) * BOX_COUNT] = NOT_WRITTEN

    def state(self, number: int) -> State:
        block = self._block
        return State(self._tasks[block.task[number]], self._scene(number), int(block.steps[number]))


def _box_of(before: Box, kept: int, count: int, numbers: list[int]) -> Box:
    """The box of the items with the first `count` of these numbers, the first `kept` of which it had `before`."""
    if kept == count == len(before.items):
        return before
    return Box((*before.items[:kept], *map(item_of, numbers[kept:count])))


def _fields(numbers: Int64Array) -> Int16Array:
    """(k, 5) the items with these numbers (k,) as `observation.item_array` tells of them."""
    items = np.empty(numbers.shape, _FIELDS)
    places, looks = np.divmod(numbers, len(LOOKS))
    items["place"], items["look"] = _PLACE_FIELDS.take(places), _LOOK_FIELDS.take(looks)
    items[numbers == NO_ITEM] = _EMPTY_FIELDS
    return items.view(np.int16).reshape(len(numbers), len(Item._fields))
