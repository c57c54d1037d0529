"""The reference core: applies the rules of single environments to one scene after another."""

from __future__ import annotations

from collections.abc import Sequence

from lilgym_mp.envs.buffers import NO_REASON, REASON_INDICES, Buffers
from lilgym_mp.envs.cores.base import Core
from lilgym_mp.envs.observation import item_array
from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.arrays import AnyDict, Int64Array
from lilgym_mp.scene.render.canvas import Canvas


class ScalarCore(Core):
    """A scene and a canvas for each environment, for any appearance."""

    def __init__(self, dynamics: Dynamics, tasks: Sequence[Task], buffers: Buffers, image_size: str) -> None:
        super().__init__(dynamics, tasks, buffers)
        self._scenes = [tasks[0].start] * len(buffers.action)
        self._image_size = image_size
        self._canvases = self._new_canvases()

    def _new_canvases(self) -> list[Canvas]:
        return [Canvas(self._image_size, image) for image in self._buffers.image]

    def __setstate__(self, state: AnyDict) -> None:
        """A copy's canvases draw into its own buffers."""
        vars(self).update(state)
        self._canvases = self._new_canvases()

    def _start_episodes(self, env_ids: Int64Array, tasks: Int64Array) -> None:
        for env_id, task in zip(env_ids.tolist(), tasks.tolist(), strict=True):
            self._scenes[env_id] = self._tasks[task].start
            self._canvases[env_id].show(self._scenes[env_id])

    def step(self, env_ids: Int64Array | None) -> None:
        buffers = self._buffers
        dynamics = self.dynamics
        scenes = self._scenes
        for env_id in (self._all_env_ids if env_ids is None else env_ids).tolist():
            action = dynamics.appearance.decode(int(buffers.action[env_id]))
            before = State(self._tasks[buffers.task[env_id]], scenes[env_id], int(buffers.steps[env_id]))
            after, result, invalid = dynamics.step(before, action)
            if after.scene is not scenes[env_id]:
                scenes[env_id] = after.scene
                self._canvases[env_id].show(after.scene)
            buffers.steps[env_id] = after.steps
            buffers.result[env_id] = result.code
            buffers.invalid[env_id] = NO_REASON if invalid is None else REASON_INDICES[invalid]

    def _scenes_of(self, env_ids: Int64Array) -> list[Scene]:
        return [self._scenes[env_id] for env_id in env_ids.tolist()]

    def write_masks(self) -> None:
        masks = self._buffers.mask
        legal_mask = self.dynamics.appearance.legal_mask
        placement = self.dynamics.rules.placement
        for env_id, scene in enumerate(self._scenes):
            masks[env_id] = legal_mask(scene, placement)

    def write_items(self) -> None:
        items = self._buffers.items
        for slots, scene in zip(items, self._scenes, strict=True):
            slots[:] = item_array(scene, items.shape[2])
