"""SuperSuit-style factories: one per wrapper, for any kind of environment."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec

import gymnasium as gym

from lilgym_mp.wrappers.env_state import WrongEnvironment
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.vector_adapter import VectorEnvWrapper

Settings = ParamSpec("Settings")
AnyEnv = Any  # a Gymnasium environment or vector environment, or a PettingZoo AEC or parallel environment


def factory(
    wrapper: Callable[Concatenate[gym.Env[Any, Any], Settings], EnvWrapper[Any]],
) -> Callable[Concatenate[AnyEnv, Settings], AnyEnv]:
    """A function that applies `wrapper` to any kind of environment and returns the same kind."""
    assert isinstance(wrapper, type)
    signature = inspect.signature(wrapper)

    def wrap(env: AnyEnv, *args: Settings.args, **kwargs: Settings.kwargs) -> AnyEnv:
        if isinstance(env, gym.Env):
            return wrapper(env, *args, **kwargs)
        settings = signature.bind(env, *args, **kwargs)
        settings.apply_defaults()
        del settings.arguments["env"]
        if isinstance(env, gym.vector.VectorEnv):
            return VectorEnvWrapper(env, wrapper.__name__, wrapper.transformation_class, settings.arguments)
        if _comes_from_pettingzoo(env):
            from lilgym_mp.wrappers.pettingzoo_adapter import is_game, wrap_game

            if is_game(env):
                return wrap_game(env, wrapper.__name__, wrapper.transformation_class, settings.arguments)
        raise WrongEnvironment(
            f"{wrapper.__name__} wraps this package's Gymnasium environments, vector environments, and PettingZoo"
            f" environments of the proposer-verifier game, not {env!r}"
        )

    wrap.__name__ = wrap.__qualname__ = factory_name(wrapper.__name__)
    wrap.__module__ = wrapper.__module__
    wrap.__doc__ = f"Applies `{wrapper.__name__}` to an environment of any kind.\n\n{wrapper.__doc__}"
    wrap.__signature__ = signature.replace(return_annotation="AnyEnv")  # pyright: ignore[reportFunctionMemberAccess]
    return wrap


def factory_name(wrapper: str) -> str:
    """The name of a wrapper's factory: `NLVRReward` has `nlvr_reward_v0`."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", wrapper).lower() + "_v0"


def _comes_from_pettingzoo(env: object) -> bool:
    """Whether `env` may be a PettingZoo environment, tested without importing pettingzoo."""
    return "pettingzoo" in sys.modules and hasattr(env, "possible_agents")
