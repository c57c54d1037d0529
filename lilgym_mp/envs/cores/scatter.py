"""The compiled core of Scatter.

The release's rules let items overlap or lie outside their box. The arrays cannot represent such scenes. They fall back
to the scalar rules: kept as a `Scene`, edited by `Scatter.apply` and drawn by a `Canvas`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import cast

import numpy as np

from lilgym_mp.envs.buffers import NO_REASON, REASON_INDICES, Buffers
from lilgym_mp.envs.cores import scatter_kernels as kernels
from lilgym_mp.envs.cores.compiled import NO_VERSION, CompiledCore, item_from_code
from lilgym_mp.envs.cores.kernels import compiling
from lilgym_mp.envs.cores.program_evaluator import ItemBoxLowering
from lilgym_mp.envs.cores.scatter_kernels import FALLBACK, TIE
from lilgym_mp.envs.cores.tables import grid_tables, tied_move
from lilgym_mp.envs.observation import item_array
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_COUNT, Box, Item, Scene
from lilgym_mp.scene.appearances import Scatter
from lilgym_mp.scene.appearances.base import fits_box
from lilgym_mp.scene.appearances.cell_places import cell_places
from lilgym_mp.scene.appearances.numbering import ITEM_TYPE_FOOTPRINTS, cell_and_item_type
from lilgym_mp.scene.arrays import BoolArray, Int64Array
from lilgym_mp.scene.render.canvas import Canvas
from lilgym_mp.scene.render.drawing import stamp

MAX_CACHED_ITEMS = 16_384


class ScatterCore(CompiledCore):
    """`Scene` objects are made only on demand, and only for boxes that changed since the last one."""

    def __init__(self, dynamics: Dynamics, tasks: Sequence[Task], buffers: Buffers, image_size: str) -> None:
        super().__init__(dynamics, tasks, buffers, image_size, ItemBoxLowering())
        count = len(buffers.action)
        self._appearance = cast(Scatter, dynamics.appearance)
        placement = dynamics.rules.placement
        self._tables = grid_tables(self._appearance, placement)
        self._places = cell_places(*self._appearance.cell, searches=self._appearance.searches(placement))
        self._scratch = np.empty(self._places.empty.shape[2], np.uint64)
        self._scenes = [Scene.empty()] * count  # scenes at the versions in `_scene_versions`
        self._scene_versions = np.full((count, BOX_COUNT), NO_VERSION)
        self._versions_by_env = self._current.versions.reshape(count, BOX_COUNT)
        # (tasks,) whether the start scene needs the fallback; known once the task has been played
        self._start_uses_fallback = np.zeros(len(tasks), np.bool_)
        self._uses_fallback = self._current.uses_fallback  # (N,) environments whose scenes are only in `_scenes`
        self._canvases: dict[int, Canvas] = {}  # keyed by env id; only environments that use the fallback
        self._written_masks = np.full(len(self._current.versions), NO_VERSION)  # versions of boxes as of `buffers.mask`
        buffers.mask[:, 0] = True
        with compiling(kernels.edit_scatter_scenes):
            self._edit(self._all_env_ids[:0], self._all_env_ids[:0], np.zeros(0, np.bool_))

    def _start_episodes(self, env_ids: Int64Array, tasks: Int64Array) -> None:
        super()._start_episodes(env_ids, tasks)
        self._scene_versions[env_ids] = NO_VERSION
        uses_fallback = self._start_uses_fallback.take(tasks)
        if self._canvases or np.count_nonzero(uses_fallback):
            self._start_fallback(env_ids, tasks, uses_fallback)

    def _start_fallback(self, env_ids: Int64Array, tasks: Int64Array, uses_fallback: BoolArray) -> None:
        """Falls back to scalar rules where `uses_fallback` (k,), and returns to the arrays elsewhere."""
        self._uses_fallback[env_ids] = uses_fallback
        for env_id in env_ids.tolist():
            self._canvases.pop(env_id, None)
        for env_id, task in zip(env_ids[uses_fallback].tolist(), tasks[uses_fallback].tolist(), strict=True):
            self._scenes[env_id] = self._tasks[task].start
            self._scene_versions[env_id] = self._versions_by_env[env_id]
            self._use_fallback(env_id)

    def _start_scene(self, task: int) -> Scene:
        start = super()._start_scene(task)
        self._start_uses_fallback[task] = not is_representable(start)
        return Scene.empty() if self._start_uses_fallback[task] else start

    def _use_fallback(self, env_id: int) -> None:
        """Represents an environment by `_scenes` instead of the arrays from now on."""
        self._uses_fallback[env_id] = True
        if env_id not in self._canvases:
            self._canvases[env_id] = Canvas(self._image_size, self._buffers.image[env_id])
        self._canvases[env_id].show(self._scenes[env_id])

    def _edit(self, env_ids: Int64Array, actions: Int64Array, applies: BoolArray) -> Int64Array:
        tables, drawing, current = self._tables, self._drawing, self._current
        reasons, ties = np.empty(len(env_ids), np.int64), np.empty((len(env_ids), 3), np.int64)
        unresolved = kernels.edit_scatter_scenes(
            tables, self._places, drawing, current, env_ids, actions, applies, reasons, ties, self._scratch
        )
        if unresolved:
            for k in (reasons == TIE).nonzero()[0].tolist():
                cell, item_type = cell_and_item_type(int(actions[k]), tables.cell_count)
                box = int(tables.boxes[cell])
                row = BOX_COUNT * int(env_ids[k]) + box
                x, y, slot = ties[k].tolist()
                other = _cached_item(int(current.items[row, slot]))
                move = tied_move(ITEM_TYPE_FOOTPRINTS[item_type], x, y, other, box, self.dynamics.rules.placement)
                reasons[k] = kernels.place_item(tables, drawing, current, row, item_type, x, y, move, applies[k])
            for k in (reasons == FALLBACK).nonzero()[0].tolist():
                reasons[k] = self._edit_scene(int(env_ids[k]), int(actions[k]), applies=bool(applies[k]))
        return reasons

    def _edit_scene(self, env_id: int, action: int, *, applies: bool) -> int:
        """Makes an edit by the scalar rules and switches to the fallback. Returns the reason."""
        (scene,) = self._scenes_of(np.array([env_id]))
        edit = self._appearance.apply(scene, self._appearance.decode(action), self.dynamics.rules.placement)
        if edit.invalid is not None:
            return REASON_INDICES[edit.invalid]
        if applies:
            self._scenes[env_id] = edit.scene
            self._use_fallback(env_id)
        return NO_REASON

    def _scenes_of(self, env_ids: Int64Array) -> list[Scene]:
        versions = self._versions_by_env.take(env_ids, 0)
        changed, boxes = (versions != self._scene_versions.take(env_ids, 0)).nonzero()
        if len(changed):
            self._scene_versions[env_ids] = versions
            self._update_boxes(env_ids[changed], boxes)
        return [self._scenes[env_id] for env_id in env_ids.tolist()]

    def _update_boxes(self, env_ids: Int64Array, boxes: Int64Array) -> None:
        """Updates boxes (k,) of `_scenes` of environments (k,); other boxes are shared with the scene before."""
        rows = env_ids * BOX_COUNT + boxes
        counts, scenes = self._current.counts.take(rows), self._scenes
        codes = self._current.items.take(rows, 0)[:, : int(counts.max())].tolist()
        for env_id, box, count, items in zip(env_ids.tolist(), boxes.tolist(), counts.tolist(), codes, strict=True):
            scenes[env_id] = scenes[env_id].with_box(box, Box(tuple(map(_cached_item, items[:count]))))

    def write_masks(self) -> None:
        appearance, placement, mask = self._appearance, self.dynamics.rules.placement, self._buffers.mask
        with compiling(kernels.write_masks):
            kernels.write_masks(self._tables, self._places, self._current, self._written_masks, self._scratch, mask)
        for env_id in self._uses_fallback.nonzero()[0].tolist():
            mask[env_id] = appearance.legal_mask(self._scenes[env_id], placement)
            self._written_masks[BOX_COUNT * env_id : BOX_COUNT * (env_id + 1)] = NO_VERSION

    def write_items(self) -> None:
        super().write_items()
        items = self._buffers.items
        for env_id in self._uses_fallback.nonzero()[0].tolist():
            items[env_id] = item_array(self._scenes[env_id], items.shape[2])
            self._written_items[BOX_COUNT * env_id : BOX_COUNT * (env_id + 1)] = NO_VERSION


def is_representable(scene: Scene) -> bool:
    """Whether `kernels.Scenes` can represent a scene: all items inside their boxes, no pixel shared by two items."""
    return all(
        fits_box(item.footprint, item.x, item.y) and not any(_share_pixels(item, other) for other in box.items[:index])
        for box in scene.boxes
        for index, item in enumerate(box.items)
    )


def _share_pixels(item: Item, other: Item) -> bool:
    """Whether two items inside their box share a pixel."""
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


_cached_item = lru_cache(MAX_CACHED_ITEMS)(item_from_code)  # on a grid they recur
