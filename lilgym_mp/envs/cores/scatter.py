"""The compiled core of Scatter.

The release's rules let items overlap or lie outside their box. A scene with such items is *outside* the arrays: the
scalar rules edit it, and it is kept as a `Scene` and drawn by a `Canvas`.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from lilgym_mp.appearances import Scatter
from lilgym_mp.appearances.numbering import ITEM_TYPE_FOOTPRINTS, cell_and_item_type
from lilgym_mp.appearances.placement import fits_box
from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.buffers import NO_REASON, REASON_NUMBERS, Buffers
from lilgym_mp.envs.cores import kernels
from lilgym_mp.envs.cores.cell_places import cell_places
from lilgym_mp.envs.cores.compiled import NEVER_SEEN, CompiledCore, item_of
from lilgym_mp.envs.cores.kernels import OUTSIDE, TIE, compiling
from lilgym_mp.envs.cores.tables import grid_tables, tied_move
from lilgym_mp.envs.cores.truths import ItemBoxes
from lilgym_mp.observation import item_array
from lilgym_mp.render import Canvas
from lilgym_mp.render.drawing import stamp
from lilgym_mp.rules import Dynamics
from lilgym_mp.scene import BOX_COUNT, Box, Item, Scene

KEPT_ITEMS = 16_384
MOST_BYTES_OF_START_MASKS = 64 << 20  # 25,000 tasks on the released grid


class ScatterCore(CompiledCore):
    """A `Scene` is made only when a program or the caller asks for one, of the boxes that changed since the last."""

    def __init__(self, dynamics: Dynamics, tasks: TaskSet, buffers: Buffers, image_size: str) -> None:
        super().__init__(dynamics, tasks, buffers, image_size)
        count = len(buffers.action)
        self._appearance = cast(Scatter, dynamics.appearance)
        self._tables = grid_tables(self._appearance, dynamics.rules.placement)
        self._scenes = [Scene.empty()] * count  # as of the versions in `_scene_versions`
        self._scene_versions = np.full((count, BOX_COUNT), NEVER_SEEN)
        self._versions_by_env = self._current.versions.reshape(count, BOX_COUNT)
        self._starts_outside = np.zeros(len(tasks), np.bool_)  # tasks that start so, as far as they have been played
        self._outside = self._current.outside  # (N,) environments whose scenes are kept in `_scenes` alone
        self._canvases: dict[int, Canvas] = {}  # of `_outside`
        self._written_masks: Int64Array | None = None  # versions that `buffers.mask` shows
        self._start_masks: _StartMasks | None = None
        with compiling(kernels.edit_scatters):
            self._edit(self._every[:0], self._every[:0], np.zeros(0, np.bool_))

    def _begin(self, env_ids: Int64Array, tasks: Int64Array) -> None:
        super()._begin(env_ids, tasks)
        self._scene_versions[env_ids] = NEVER_SEEN
        starts_outside = self._starts_outside.take(tasks)
        if self._canvases or np.count_nonzero(starts_outside):
            self._begin_outside(env_ids, tasks, starts_outside)
        if self._start_masks is not None and self._written_masks is not None:
            begun = self._start_masks.show(env_ids, tasks, self._versions_by_env, self._buffers.mask)
            self._written_masks.reshape(-1, BOX_COUNT)[begun] = self._versions_by_env[begun]

    def _begin_outside(self, env_ids: Int64Array, tasks: Int64Array, starts_outside: BoolArray) -> None:
        """Leaves the arrays where `starts_outside` (k,), and returns to them elsewhere."""
        self._outside[env_ids] = starts_outside
        for env_id in env_ids.tolist():
            self._canvases.pop(env_id, None)
        for env_id, task in zip(env_ids[starts_outside].tolist(), tasks[starts_outside].tolist(), strict=True):
            self._scenes[env_id] = self._tasks[task].start
            self._scene_versions[env_id] = self._versions_by_env[env_id]
            self._leave_arrays(env_id)

    def _start_scene(self, task: int) -> Scene:
        start = super()._start_scene(task)
        self._starts_outside[task] = not fits_arrays(start)
        return Scene.empty() if self._starts_outside[task] else start

    def _leave_arrays(self, env_id: int) -> None:
        """Has `_scenes` alone represent an environment from now on."""
        self._outside[env_id] = True
        if env_id not in self._canvases:
            self._canvases[env_id] = Canvas(self._image_size, self._buffers.image[env_id])
        self._canvases[env_id].show(self._scenes[env_id])

    def _edit(self, env_ids: Int64Array, actions: Int64Array, applies: BoolArray) -> Int64Array:
        tables, painting, current = self._tables, self._painting, self._current
        reasons, ties = np.empty(len(env_ids), np.int64), np.empty((len(env_ids), 3), np.int64)
        unresolved = kernels.edit_scatters(tables, painting, current, env_ids, actions, applies, reasons, ties)
        if unresolved:
            for k in (reasons == TIE).nonzero()[0].tolist():
                cell, item_type = cell_and_item_type(int(actions[k]), tables.cell_count)
                box = int(tables.boxes[cell])
                row = BOX_COUNT * int(env_ids[k]) + box
                x, y, slot = ties[k].tolist()
                other = _item_of(int(current.items[row, slot]))
                move = tied_move(ITEM_TYPE_FOOTPRINTS[item_type], x, y, other, box, self.dynamics.rules.placement)
                reasons[k] = kernels.place(tables, painting, current, row, item_type, x, y, move, applies[k])
            for k in (reasons == OUTSIDE).nonzero()[0].tolist():
                reasons[k] = self._edit_scene(int(env_ids[k]), int(actions[k]), applies=bool(applies[k]))
        return reasons

    def _edit_scene(self, env_id: int, action: int, *, applies: bool) -> int:
        """An edit by the scalar rules, after which the scene is outside the arrays. Gives the reason."""
        (scene,) = self._scenes_of(np.array([env_id]))
        edit = self._appearance.apply(scene, self._appearance.decode(action), self.dynamics.rules.placement)
        if edit.invalid is not None:
            return REASON_NUMBERS[edit.invalid]
        if applies:
            self._scenes[env_id] = edit.scene
            self._leave_arrays(env_id)
        return NO_REASON

    def _scenes_of(self, env_ids: Int64Array) -> list[Scene]:
        versions = self._versions_by_env.take(env_ids, 0)
        changed, boxes = (versions != self._scene_versions.take(env_ids, 0)).nonzero()
        if len(changed):
            self._scene_versions[env_ids] = versions
            self._renew_boxes(env_ids[changed], boxes)
        return [self._scenes[env_id] for env_id in env_ids.tolist()]

    def _renew_boxes(self, env_ids: Int64Array, boxes: Int64Array) -> None:
        """Makes boxes (k,) of `_scenes` of environments (k,) current; the others are shared with the scene before."""
        rows = env_ids * BOX_COUNT + boxes
        counts, scenes = self._current.counts.take(rows), self._scenes
        numbers = self._current.items.take(rows, 0)[:, : int(counts.max())].tolist()
        for env_id, box, count, there in zip(env_ids.tolist(), boxes.tolist(), counts.tolist(), numbers, strict=True):
            scenes[env_id] = scenes[env_id].with_box(box, Box(tuple(map(_item_of, there[:count]))))

    def _boxes(self) -> ItemBoxes:
        return ItemBoxes()

    def write_masks(self) -> None:
        appearance, placement, mask = self._appearance, self.dynamics.rules.placement, self._buffers.mask
        if self._written_masks is None:
            self._written_masks = np.full(len(self._current.versions), NEVER_SEEN)
            mask[:] = False
            mask[:, 0] = True
            if len(self._tasks) * mask.shape[1] <= MOST_BYTES_OF_START_MASKS:
                self._start_masks = _StartMasks(len(self._tasks), mask.shape[1])
        places = cell_places(*appearance.cell, searches=appearance.searches(placement))
        words = np.empty(places.empty.shape[2], np.uint64)
        with compiling(kernels.write_masks):
            kernels.write_masks(self._tables, places, self._current, self._written_masks, words, mask)
        if self._start_masks is not None:
            self._start_masks.keep(self._versions_by_env, mask)
        for env_id in self._outside.nonzero()[0].tolist():
            mask[env_id] = appearance.legal_mask(self._scenes[env_id], placement)
            self._written_masks[BOX_COUNT * env_id : BOX_COUNT * (env_id + 1)] = NEVER_SEEN

    def write_items(self) -> None:
        super().write_items()
        items = self._buffers.items
        for env_id in self._outside.nonzero()[0].tolist():
            items[env_id] = item_array(self._scenes[env_id], items.shape[2])
            self._written_items[BOX_COUNT * env_id : BOX_COUNT * (env_id + 1)] = NEVER_SEEN


class _StartMasks:
    """Masks of start scenes: an episode begins with a copy instead of a look at every cell."""

    def __init__(self, tasks: int, actions: int) -> None:
        self._masks = np.empty((tasks, actions), np.bool_)  # of which memory is taken as they are met
        self._known = np.zeros(tasks, np.bool_)
        self._begun: dict[
            int, tuple[int, tuple[int, ...]]
        ] = {}  # by environment: an unknown task, versions of its boxes

    def show(self, env_ids: Int64Array, tasks: Int64Array, versions: Int64Array, mask: BoolArray) -> Int64Array:
        """Writes into `mask` (N, actions) what is known of tasks (k,) that begin; gives those environments."""
        known = self._known[tasks]
        begun = env_ids[known]
        mask[begun] = self._masks[tasks[known]]
        for env_id, task in zip(env_ids[~known].tolist(), tasks[~known].tolist(), strict=True):
            self._begun[env_id] = task, tuple(versions[env_id].tolist())
        return begun

    def keep(self, versions: Int64Array, mask: BoolArray) -> None:
        """Keeps masks (N, actions) of environments that have begun an unknown task and are still where it starts."""
        for env_id, (task, begun) in self._begun.items():
            if tuple(versions[env_id].tolist()) == begun:
                self._masks[task], self._known[task] = mask[env_id], True
        self._begun.clear()


def fits_arrays(scene: Scene) -> bool:
    """Whether all items lie inside their boxes and draw no pixel in common."""
    return all(
        fits_box(item.footprint, item.x, item.y) and not any(_share_pixels(item, other) for other in box.items[:index])
        for box in scene.boxes
        for index, item in enumerate(box.items)
    )


def _share_pixels(item: Item, other: Item) -> bool:
    """Whether two items, inside their box, draw a pixel in common."""
    left, right = max(item.x, other.x), min(item.x + item.side, other.x + other.side)
    top, bottom = max(item.y, other.y), min(item.y + item.side, other.y + other.side)
    if left >= right or top >= bottom:
        return False
    drawn = (
        stamp(each.footprint, each.colour, 0, 0, 1).counts[
            top - each.y : bottom - each.y, left - each.x : right - each.x
        ]
        for each in (item, other)
    )
    return bool(np.logical_and(*drawn).any())


class _Items(dict[int, Item]):
    """Items by number, made once; on a grid the same ones come again."""

    def __missing__(self, number: int) -> Item:
        if len(self) >= KEPT_ITEMS:
            self.clear()
        item = self[number] = item_of(number)
        return item


_item_of = _Items().__getitem__
