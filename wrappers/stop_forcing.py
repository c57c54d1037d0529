"""Stop forcing for training: STOP wherever it succeeds. Source: docs/spec.md, "Stop forcing" (PPO+SF)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from lilgym_mp.arrays import BoolArray
from lilgym_mp.choices import choose
from lilgym_mp.wrappers.action_mask import MASK
from lilgym_mp.wrappers.env_state import EnvDescription, EnvState
from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Batch, Transformation

TRAINING_SPLIT = "train"
FORCED = "forced_stop"  # info key


class _Forcing(Transformation):
    def __init__(self, description: EnvDescription, *, allow_evaluation: bool) -> None:
        super().__init__(description)
        split = description.tasks.provenance.split
        if split != TRAINING_SPLIT and not allow_evaluation:
            raise ValueError(
                f"{description.wrapper} is for training: split {split!r} is for evaluation, where the agent must choose"
                f' STOP itself; choose split="{TRAINING_SPLIT}" or pass allow_evaluation=True'
            )


class StopMasked(_Forcing):
    """Masks all other actions where STOP succeeds."""

    adds_infos = True

    def action_masks(self, state: EnvState) -> BoolArray:
        legal = state.action_masks()
        success = state.goal_reached()
        legal[success] = False
        legal[success, self.env_description.stop_index] = True
        return legal

    def added_infos(self, info: Mapping[str, Any], state: EnvState) -> Mapping[str, Batch]:
        return {MASK: self.action_masks(state).astype(np.int8)} if MASK in info else {}


class StopReplaced(_Forcing):
    """Replaces any action by STOP where STOP succeeds."""

    changes_actions = True

    def __init__(self, description: EnvDescription, *, allow_evaluation: bool) -> None:
        super().__init__(description, allow_evaluation=allow_evaluation)
        description.discrete_actions()

    def actions(self, actions: Batch, state: EnvState) -> tuple[Batch, Mapping[str, BoolArray]]:
        forced = state.goal_reached() & (actions != self.env_description.stop_index)
        return np.where(forced, self.env_description.stop_index, actions), {FORCED: forced}


MODES = {"mask": StopMasked, "replace": StopReplaced}


def stop_forcing(description: EnvDescription, *, mode: str, allow_evaluation: bool) -> Transformation:
    """The transformation of `StopForcing`. Raises ValueError for an unknown mode or an evaluation split."""
    return choose("mode", mode, MODES)(description, allow_evaluation=allow_evaluation)


class StopForcing(EnvWrapper[Transformation]):
    """Makes the agent STOP in every state where STOP succeeds. For training only.

    mode "mask" (the paper): `action_masks()`, and info["action_mask"] of a wrapped ActionMask, allow only STOP there.
    mode "replace" (the release): any action becomes STOP there; info["forced_stop"] is whether the last action was
    replaced.
    Raises ValueError for evaluation splits unless `allow_evaluation`, since evaluation is without stop forcing.
    """

    transformation_class = staticmethod(stop_forcing)

    def __init__(self, env: gym.Env[Any, Any], mode: str = "mask", *, allow_evaluation: bool = False) -> None:
        super().__init__(env, mode=mode, allow_evaluation=allow_evaluation)


stop_forcing_v0 = factory(StopForcing)
