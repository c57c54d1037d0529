"""The base class of wrappers, which applies a transformation to one Gymnasium environment as a batch of one, and the
SuperSuit-style factories for any kind of environment."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Concatenate, Generic, ParamSpec, SupportsFloat, TypeVar, cast, get_args

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs

from lilgym_mp.envs.interface import UNCHANGED_REWARD
from lilgym_mp.envs.masks import action_masks
from lilgym_mp.envs.rules import State
from lilgym_mp.scene.arrays import BoolArray
from lilgym_mp.wrappers.transformation import (
    Batch,
    EnvDescription,
    EnvState,
    Transformation,
    WrongEnvironment,
    change_tasks,
    description_of,
    stacked,
    to_python,
    unstacked,
)
from lilgym_mp.wrappers.vector_adapter import VectorEnvWrapper

TransformationT = TypeVar("TransformationT", bound=Transformation)
Settings = ParamSpec("Settings")
AnyEnv = Any  # a Gymnasium environment or vector environment, or a PettingZoo AEC or parallel environment


class EnvWrapper(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs, Generic[TransformationT]):
    """The base class of wrappers. `gym.make(env.spec)` rebuilds the stack; `action_masks` passes through it."""

    transformation_class: ClassVar[Callable[..., Transformation]]  # called with a description and the settings

    def __init_subclass__(cls) -> None:
        """In `class W(EnvWrapper[T])`, T is the transformation's class, unless W names another."""
        super().__init_subclass__()
        if "__orig_bases__" in vars(cls) and "transformation_class" not in vars(cls):
            (cls.transformation_class,) = get_args(vars(cls)["__orig_bases__"][0])

    def __init__(self, env: gym.Env[Any, Any], **settings: Any) -> None:
        """`settings`: recorded in the spec and passed to the transformation."""
        RecordConstructorArgs.__init__(self, **settings)
        gym.Wrapper.__init__(self, env)
        description = description_of(env, type(self).__name__)
        self.transformation = cast("TransformationT", type(self).transformation_class(description, **settings))
        change_tasks(env, self.transformation)
        self.observation_space = self.transformation.observation_space()
        self.action_space = self.transformation.action_space()
        self._state = SingleEnvState(description, env)
        self._potentials = np.zeros(1)  # (1,) of the current state, if rewards are changed

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        if self.transformation.changes_rewards:
            self._potentials = self.transformation.potentials(self._state.states())
        return self._transformed(observation), self._extended_info(info, {})

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        entries: Mapping[str, Batch] = {}
        if self.transformation.changes_actions:
            actions, entries = self.transformation.actions(stacked([action]), self._state)
            action = actions[0]
        observation, reward, terminated, truncated, info = self.env.step(action)
        if self.transformation.changes_rewards:
            entries = {**entries, UNCHANGED_REWARD: (reward,)}
        if entries:
            ended, started = terminated or truncated, self._state.states()[0].steps == 0  # by this step, in a wrapper
            acted = ended or not started
            if self.transformation.changes_rewards:
                changed = self._transformed_reward(float(reward), ended=ended, started=started)
                reward = changed if acted else reward
            entries = entries if acted else {}
        return self._transformed(observation), reward, terminated, truncated, self._extended_info(info, entries)

    def _transformed_reward(self, reward: float, *, ended: bool, started: bool) -> float:
        before, transformation = self._potentials, self.transformation
        if started or not ended:
            self._potentials = transformation.potentials(self._state.states())
        return transformation.rewards(np.array([reward]), before, np.zeros(1) if ended else self._potentials).item()

    def action_masks(self) -> BoolArray:
        """(actions,) bool, a new array: the legal actions after this wrapper and the wrapped ones."""
        return self.transformation.action_masks(self._state)[0]

    def _transformed(self, observation: Any) -> Any:
        if not self.transformation.changes_observations:
            return observation
        batch = self.transformation.observations(stacked([observation]), self._state)
        return unstacked(self.observation_space, batch)[0]

    def _extended_info(self, info: dict[str, Any], entries: Mapping[str, Batch]) -> dict[str, Any]:
        if self.transformation.adds_infos:
            entries = {**entries, **self.transformation.added_infos(info, self._state)}
        return {**info, **{name: to_python(value[0]) for name, value in entries.items()}} if entries else info


class SingleEnvState(EnvState):
    """The state of one environment, with the masks of its wrappers up to `env`."""

    def __init__(self, description: EnvDescription, env: gym.Env[Any, Any]) -> None:
        super().__init__(description)
        self._env = env

    def states(self) -> Sequence[State]:
        return (self._env.unwrapped.state,)  # pyright: ignore[reportAttributeAccessIssue]

    def action_masks(self) -> BoolArray:
        return action_masks(self._env)[None]


def factory(
    wrapper: Callable[Concatenate[gym.Env[Any, Any], Settings], EnvWrapper[Any]],
) -> Callable[Concatenate[AnyEnv, Settings], AnyEnv]:
    """A function that applies `wrapper` to any kind of environment and returns the same kind."""
    assert isinstance(wrapper, type)
    signature = inspect.signature(wrapper)

    def wrap(env: AnyEnv, *args: Settings.args, **kwargs: Settings.kwargs) -> AnyEnv:
        if isinstance(env, gym.Env):
            return wrapper(env, *args, **kwargs)
        bound = signature.bind(env, *args, **kwargs)
        bound.apply_defaults()
        settings = dict(bound.arguments)
        del settings["env"]
        settings |= settings.pop("settings", {})  # of a wrapper that defines none
        if isinstance(env, gym.vector.VectorEnv):
            return VectorEnvWrapper(env, wrapper, settings)
        if "pettingzoo" in sys.modules and hasattr(env, "possible_agents"):
            from lilgym_mp.wrappers.pettingzoo_adapter import is_game, wrap_game

            if is_game(env):
                return wrap_game(env, wrapper.__name__, wrapper.transformation_class, settings)
        raise WrongEnvironment(
            f"{wrapper.__name__} wraps this package's Gymnasium environments, vector environments, and PettingZoo"
            f" environments of the proposer-verifier game, not {env!r}"
        )

    words = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", wrapper.__name__)
    wrap.__name__ = wrap.__qualname__ = f"{words.lower()}_v0"  # `NLVRReward` has `nlvr_reward_v0`
    wrap.__module__ = sys._getframe(1).f_globals["__name__"]  # of the caller, where pickle finds it
    wrap.__doc__ = f"Applies `{wrapper.__name__}` to an environment of any kind.\n\n{wrapper.__doc__}"
    wrap.__signature__ = signature.replace(return_annotation="AnyEnv")  # pyright: ignore[reportFunctionMemberAccess]
    return wrap
