"""The reference core: applies the rules of single environments to one scene after another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.envs.buffers import NO_REASON, REASON_INDICES, Buffers
from lilgym_mp.envs.cores.base import Core
from lilgym_mp.observation import item_array
from lilgym_mp.render import Canvas
from lilgym_mp.rules import Dynamics
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task


class ScalarCore(Core):
    """A scene and a canvas for each environment, for any appearance."""

    def __init__(self, dynamics: Dynamics, tasks: Sequence[Task], buffers: Buffers, image_size: str) -> None:
        super().__init__(dynamics, tasks, buffers)
        self._scenes = [tasks[0].start] * len(buffers.action)
        self._canvases = [Canvas(image_size, image) for image in buffers.image]

    def _start_episodes(self, env_ids: Int64Array, tasks: Int64Array) -> None:
        for env_id, task in zip(env_ids.tolist(), tasks.tolist(), strict=True):
            self._scenes[env_id] = self._tasks[task].start
            self._canvases[env_id].show(self._scenes[env_id])

    def _edit(self, env_ids: Int64Array, actions: Int64Array, applies: BoolArray) -> Int64Array:
        decode, apply = self.dynamics.appearance.decode, self.dynamics.appearance.apply
        placement, scenes = self.dynamics.rules.placement, self._scenes
        reasons: list[int] = []
        for env_id, action, done in zip(env_ids.tolist(), actions.tolist(), applies.tolist(), strict=True):
            reason = NO_REASON
            if action != 0:
                scene, invalid = apply(scenes[env_id], decode(action), placement)
                if invalid is not None:
                    reason = REASON_INDICES[invalid]
                elif done:
                    scenes[env_id] = scene
                    self._canvases[env_id].show(scene)
            reasons.append(reason)
        return np.array(reasons, np.int64)

    def _scenes_of(self, env_ids: Int64Array) -> list[Scene]:
        return [self._scenes[env_id] for env_id in env_ids.tolist()]

    def write_masks(self) -> None:
        for mask, scene in zip(self._buffers.mask, self._scenes, strict=True):
            mask[:] = self.dynamics.appearance.legal_mask(scene, self.dynamics.rules.placement)

    def write_items(self) -> None:
        items = self._buffers.items
        for slots, scene in zip(items, self._scenes, strict=True):
            slots[:] = item_array(scene, items.shape[2])
