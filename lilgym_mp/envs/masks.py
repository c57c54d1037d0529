"""Reads environments of this package through any wrappers around them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium as gym
from gymnasium.vector import VectorEnv, VectorWrapper

from lilgym_mp.scene.arrays import BoolArray

AnyEnv = gym.Env[Any, Any] | VectorEnv[Any, Any, Any]
_MISSING = object()


def layers(env: Any) -> Iterator[Any]:
    """`env` and the environments it wraps, from the outermost."""
    yield env
    while isinstance(env, gym.Wrapper | VectorWrapper):
        env = env.env  # pyright: ignore[reportUnknownMemberType]
        yield env


def attribute(env: AnyEnv, name: str) -> Any:
    """The attribute of the outermost layer that has it. Raises AttributeError."""
    for layer in layers(env):
        if (value := getattr(layer, name, _MISSING)) is not _MISSING:
            return value
    raise AttributeError(f"neither {env.unwrapped!r} nor a wrapper around it has an attribute {name!r}")


def set_wrapper_attribute(env: AnyEnv, name: str, value: Any) -> None:
    """Sets an attribute of the outermost wrapper that has it. Raises AttributeError unless it is a wrapper's alone."""
    *wrappers, innermost = layers(env)
    owner = next((wrapper for wrapper in wrappers if name in vars(wrapper)), None)
    if owner is None or hasattr(innermost, name):
        raise AttributeError(f"cannot set {name!r} of environments in a batch; pass it when making the batch")
    setattr(owner, name, value)


def action_masks(env: AnyEnv) -> BoolArray:
    """The legal actions, after any masking by wrappers.

    Args:
        env: A single or vector environment of this package, which may be wrapped.

    Returns:
        bool (actions,), or (N, actions) for a vector environment.

    Raises:
        TypeError: For an environment without masks.
    """
    try:
        return attribute(env, "action_masks")()
    except AttributeError:
        if hasattr(env.unwrapped, "action_masks"):
            raise
        raise TypeError(f"action_masks needs one of this package's environments, not {env!r}") from None
