"""The compiled core of Scatter.

The release's rules let items overlap or lie outside their box. Such unfit scenes are drawn by `draw`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import cast

import numpy as np

from lilgym_mp.envs.buffers import NO_REASON, Buffers
from lilgym_mp.envs.cores import scatter_kernels as kernels
from lilgym_mp.envs.cores.compiled import NO_VERSION, CompiledCore, item_from_code
from lilgym_mp.envs.cores.kernels import compiling
from lilgym_mp.envs.cores.program_evaluator import ItemBoxLowering
from lilgym_mp.envs.cores.scatter_kernels import TIE, grid_tables, tied_move
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_COUNT, Box, Scene
from lilgym_mp.scene.appearances import Scatter
from lilgym_mp.scene.appearances.scatter.actions import ITEM_TYPE_FOOTPRINTS, cell_and_item_type
from lilgym_mp.scene.appearances.scatter.cell_places import cell_places
from lilgym_mp.scene.arrays import BoolArray, Int64Array
from lilgym_mp.scene.render import draw
from lilgym_mp.scene.render.canvas import box_blits

MAX_CACHED_ITEMS = 16_384


class ScatterCore(CompiledCore):
    """`Scene` objects are made only on demand, and only for boxes that changed since the last one."""

    def __init__(self, dynamics: Dynamics, tasks: Sequence[Task], buffers: Buffers, image_size: str) -> None:
        super().__init__(dynamics, tasks, buffers, image_size, ItemBoxLowering())
        count = len(buffers.action)
        appearance = cast(Scatter, dynamics.appearance)
        placement = dynamics.rules.placement
        self._tables = grid_tables(appearance, placement)
        self._places = cell_places(*appearance.cell, searches=appearance.searches(placement))
        self._scratch = np.empty(self._places.empty.shape[2], np.uint64)
        self._scenes = [Scene.empty()] * count  # scenes at the versions in `_scene_versions`
        self._scene_versions = np.full((count, BOX_COUNT), NO_VERSION)
        self._versions_by_env = self._current.versions.reshape(count, BOX_COUNT)
        self._written_masks = np.full(len(self._current.versions), NO_VERSION)  # versions of boxes as of `buffers.mask`
        buffers.mask[:, 0] = True
        self._prepare_edits(kernels.edit_scatter_scenes)

    def _start_episodes(self, env_ids: Int64Array, tasks: Int64Array) -> None:
        super()._start_episodes(env_ids, tasks)
        self._scene_versions[env_ids] = NO_VERSION
        self._draw_unfit(env_ids)

    def _add_start(self, task: int) -> None:
        super()._add_start(task)
        self._starts.is_unfit[task] = any(box_blits(box, 1) is None for box in self._tasks[task].start.boxes)

    def _draw_unfit(self, env_ids: Int64Array) -> None:
        """Draws the scenes of environments (k,) that are unfit."""
        for env_id in env_ids[self._current.is_unfit.take(env_ids)]:
            (scene,) = self._scenes_of(env_id[None])
            self._buffers.image[env_id] = draw(scene, self._image_size)

    def _edit(self, env_ids: Int64Array, actions: Int64Array, applies: BoolArray) -> Int64Array:
        tables = self._tables
        drawing = self._drawing
        current = self._current
        reasons = np.empty(len(env_ids), np.int64)
        ties = np.empty((len(env_ids), 3), np.int64)
        tied = kernels.edit_scatter_scenes(
            tables, self._places, drawing, current, env_ids, actions, applies, reasons, ties, self._scratch
        )
        if tied:
            for k in (reasons == TIE).nonzero()[0].tolist():
                cell, item_type = cell_and_item_type(int(actions[k]), tables.cell_count)
                box = int(tables.boxes[cell])
                row = BOX_COUNT * int(env_ids[k]) + box
                x, y, slot = ties[k].tolist()
                other = _cached_item(int(current.items[row, slot]))
                move = tied_move(ITEM_TYPE_FOOTPRINTS[item_type], x, y, other, box, self.dynamics.rules.placement)
                kernels.place_item(tables, drawing, current, row, item_type, x, y, move, applies[k])
                reasons[k] = NO_REASON
        self._draw_unfit(env_ids)
        return reasons

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
        counts = self._current.counts.take(rows)
        scenes = self._scenes
        codes = self._current.items.take(rows, 0)[:, : int(counts.max())].tolist()
        for env_id, box, count, items in zip(env_ids.tolist(), boxes.tolist(), counts.tolist(), codes, strict=True):
            scenes[env_id] = scenes[env_id].with_box(box, Box(tuple(map(_cached_item, items[:count]))))

    def write_masks(self) -> None:
        mask = self._buffers.mask
        with compiling(kernels.write_masks):
            kernels.write_masks(self._tables, self._places, self._current, self._written_masks, self._scratch, mask)


_cached_item = lru_cache(MAX_CACHED_ITEMS)(item_from_code)  # on a grid they recur
