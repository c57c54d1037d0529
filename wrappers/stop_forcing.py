"""Stop forcing for training: STOP wherever it succeeds. Source: docs/spec.md, "Stop forcing" (PPO+SF)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from lilgym_mp.arrays import BoolArray
from lilgym_mp.choices import choose
from lilgym_mp.wrappers.action_mask import MASK
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Batch, EnvDescription, EnvState, Transformation

TRAINING_SPLIT = "train"
FORCED = "forced_stop"  # info key


class Forcing(Transformation):
    """Where STOP succeeds, masks all other actions, or replaces them by STOP."""

    def __init__(self, description: EnvDescription, *, mode: str, allow_evaluation: bool) -> None:
        """Raises ValueError for an unknown mode or an evaluation split."""
        super().__init__(description)
        self.adds_infos = choose("mode", mode, {"mask": True, "replace": False})
        self.changes_actions = not self.adds_infos
        split = description.tasks.provenance.split
        if split != TRAINING_SPLIT and not allow_evaluation:
            raise ValueError(
                f"{description.wrapper} is for training: split {split!r} is for evaluation, where the agent must choose"
                f' STOP itself; choose split="{TRAINING_SPLIT}" or pass allow_evaluation=True'
            )
        if self.changes_actions:
            description.require_discrete_actions()

    def action_masks(self, state: EnvState) -> BoolArray:
        legal = state.action_masks()
        if not self.changes_actions:
            success = state.goal_reached()
            legal[success] = False
            legal[success, self.env_description.stop_index] = True
        return legal

    def added_infos(self, info: Mapping[str, Any], state: EnvState) -> Mapping[str, Batch]:
        return {MASK: self.action_masks(state).astype(np.int8)} if MASK in info else {}

    def actions(self, actions: Batch, state: EnvState) -> tuple[Batch, Mapping[str, BoolArray]]:
        forced = state.goal_reached() & (actions != self.env_description.stop_index)
        return np.where(forced, self.env_description.stop_index, actions), {FORCED: forced}


class StopForcing(EnvWrapper[Forcing]):
    """Makes the agent STOP in every state where STOP succeeds. For training only.

    mode "mask" (the paper): `action_masks()`, and info["action_mask"] of a wrapped ActionMask, allow only STOP there.
    mode "replace" (the release): any action becomes STOP there; info["forced_stop"] is whether the last action was
    replaced.
    Raises ValueError for evaluation splits unless `allow_evaluation`, since evaluation is without stop forcing.
    """

    transformation_class = Forcing

    def __init__(self, env: gym.Env[Any, Any], mode: str = "mask", *, allow_evaluation: bool = False) -> None:
        super().__init__(env, mode=mode, allow_evaluation=allow_evaluation)
