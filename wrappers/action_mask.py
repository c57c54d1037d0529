"""The mask of legal actions beside every observation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from lilgym_mp.wrappers.env_state import EnvState
from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Batch, Transformation

MASK = "action_mask"  # the info's key


class MaskTold(Transformation):
    """The legal actions as the info's "action_mask"."""

    adds_infos = True

    def added_infos(self, info: Mapping[str, Any], state: EnvState) -> Mapping[str, Batch]:
        return {MASK: state.legal().view(np.int8)}


class ActionMask(EnvWrapper[MaskTold]):
    """Puts the exact mask of legal actions into info["action_mask"]: int8 (actions,), as `Discrete.sample` wants it.

    Legality is that of the environment's grid, its search and snapping included. Wrappers beneath that narrow
    what is legal, such as StopForcing, are obeyed.
    """

    transformation_class = MaskTold

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)


action_mask_v0 = factory(ActionMask)
