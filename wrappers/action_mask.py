"""The action mask in infos."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Batch, EnvState, Transformation

MASK = "action_mask"  # the info's key


class MaskInfo(Transformation):
    """Adds "action_mask" to infos."""

    adds_infos = True

    def added_infos(self, info: Mapping[str, Any], state: EnvState) -> Mapping[str, Batch]:
        return {MASK: state.action_masks().view(np.int8)}


class ActionMask(EnvWrapper[MaskInfo]):
    """Adds the exact mask of legal actions as info["action_mask"]: int8 (actions,), as `Discrete.sample` expects.

    Legality takes account of the environment's grid, placement search and snapping, and of wrapped wrappers that
    narrow the mask, such as StopForcing.
    """

    transformation_class = MaskInfo
