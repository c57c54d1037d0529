"""`action_masks` for any environment made by `gymnasium.make` or `gymnasium.make_vec`, with types."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from gymnasium.vector import VectorEnv, VectorWrapper

from lilgym_mp.arrays import BoolArray


def action_masks(env: gym.Env[Any, Any] | VectorEnv[Any, Any, Any]) -> BoolArray:
    """(actions,), or (N, actions) for a vector environment: which actions are legal, after any masking by wrappers.

    Raises TypeError for an environment without masks.
    """
    masked: Any = env
    while not hasattr(type(masked), "action_masks") and isinstance(masked, gym.Wrapper | VectorWrapper):
        masked = masked.env  # pyright: ignore[reportUnknownMemberType]
    if not hasattr(type(masked), "action_masks"):
        raise TypeError(f"action_masks needs one of this package's environments, not {env!r}")
    return masked.action_masks()
