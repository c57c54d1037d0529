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


def action_masks(env: AnyEnv) -> BoolArray:
    """(actions,), or (N, actions) for a vector environment: which actions are legal, after any masking by wrappers.

    Raises TypeError for an environment without masks.
    """
    try:
        return attribute(env, "action_masks")()
    except AttributeError:
        if hasattr(env.unwrapped, "action_masks"):
            raise
        raise TypeError(f"action_masks needs one of this package's environments, not {env!r}") from None


class _Passed:
    """A method that Gymnasium's vector wrappers pass on to the environment they wrap."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, wrapper: Any, owner: type) -> Any:
        return self if wrapper is None else getattr(wrapper.env, self._name)


for name in ("action_masks", "goal_reached"):  # so that `envs.action_masks()` works under any of Gymnasium's wrappers
    if not hasattr(VectorWrapper, name):
        setattr(VectorWrapper, name, _Passed(name))
