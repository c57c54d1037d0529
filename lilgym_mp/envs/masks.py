"""The mask of legal actions of whatever `gymnasium.make` and `gymnasium.make_vec` give, for type checkers too."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from gymnasium.vector import VectorEnv, VectorWrapper

from lilgym_mp.arrays import BoolArray


def action_masks(env: gym.Env[Any, Any] | VectorEnv[Any, Any, Any]) -> BoolArray:
    """(actions,) or, of a vector environment, (N, actions): the legal actions, as the wrappers of `env` leave them.

    Raises TypeError for an environment that has no such mask.
    """
    masked: Any = env
    while not hasattr(type(masked), "action_masks") and isinstance(masked, gym.Wrapper | VectorWrapper):
        masked = masked.env  # pyright: ignore[reportUnknownMemberType]
    if not hasattr(type(masked), "action_masks"):
        raise TypeError(f"action_masks needs one of this package's environments, not {env!r}")
    return masked.action_masks()
