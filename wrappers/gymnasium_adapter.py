"""Applies a transformation to one Gymnasium environment, as a batch of one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Generic, SupportsFloat, TypeVar, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs

from lilgym_mp.arrays import BoolArray
from lilgym_mp.envs.single import UNCHANGED_REWARD
from lilgym_mp.rules import State
from lilgym_mp.wrappers.env_state import BaseEnvState, EnvDescription, WrongEnvironment
from lilgym_mp.wrappers.transformation import (
    Batch,
    TaskChange,
    Transformation,
    require_innermost,
)

TransformationT = TypeVar("TransformationT", bound=Transformation)


class EnvWrapper(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs, Generic[TransformationT]):
    """The base class of wrappers. `gym.make(env.spec)` rebuilds the stack; `action_masks` passes through it."""

    transformation_class: ClassVar[Callable[..., Transformation]]  # called with a description and the settings

    def __init__(self, env: gym.Env[Any, Any], **settings: Any) -> None:
        """`settings`: the constructor's arguments, recorded in the spec and passed to the transformation."""
        RecordConstructorArgs.__init__(self, **settings)
        gym.Wrapper.__init__(self, env)
        description = description_of(env, type(self).__name__)
        self.transformation = cast("TransformationT", type(self).transformation_class(description, **settings))
        if isinstance(self.transformation, TaskChange):
            require_innermost(description.wrapper, env)
            self.unwrapped.change_tasks(self.transformation.change)  # pyright: ignore[reportAttributeAccessIssue]
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
            actions, entries = self.transformation.actions(as_batch(action), self._state)
            action = actions[0]
        observation, reward, terminated, truncated, info = self.env.step(action)
        if self.transformation.changes_rewards:
            entries = {**entries, UNCHANGED_REWARD: (reward,)}
            reward = self._transformed_reward(float(reward), ended=terminated or truncated)
        return self._transformed(observation), reward, terminated, truncated, self._extended_info(info, entries)

    def _transformed_reward(self, reward: float, *, ended: bool) -> float:
        before, transformation = self._potentials, self.transformation
        self._potentials = np.zeros(1) if ended else transformation.potentials(self._state.states())
        return transformation.rewards(np.array([reward]), before, self._potentials).item()

    def action_masks(self) -> BoolArray:
        """(actions,) bool, a new array: the legal actions after this wrapper and the wrapped ones."""
        return self.transformation.action_masks(self._state)[0]

    def _transformed(self, observation: Any) -> Any:
        if not self.transformation.changes_observations:
            return observation
        return unbatched(self.observation_space, self.transformation.observations(as_batch(observation), self._state))

    def _extended_info(self, info: dict[str, Any], entries: Mapping[str, Batch]) -> dict[str, Any]:
        if self.transformation.adds_infos:
            entries = {**entries, **self.transformation.added_infos(info, self._state)}
        return {**info, **{name: to_python(value[0]) for name, value in entries.items()}} if entries else info


class SingleEnvState(BaseEnvState):
    """The `EnvState` of one environment, with the masks of its wrappers up to `env`."""

    def __init__(self, description: EnvDescription, env: gym.Env[Any, Any]) -> None:
        super().__init__(description)
        self._env = env

    def states(self) -> Sequence[State]:
        return (self._env.unwrapped.state,)  # pyright: ignore[reportAttributeAccessIssue]

    def action_masks(self) -> BoolArray:
        return self._env.get_wrapper_attr("action_masks")()[None]

    def goal_reached(self) -> BoolArray:
        return np.array([self._env.get_wrapper_attr("goal_reached")()])


def description_of(env: gym.Env[Any, Any], wrapper: str) -> EnvDescription:
    """The description of `env` for `wrapper`. Raises WrongEnvironment for another package's environment."""
    base = env.unwrapped if isinstance(env, gym.Env) else env
    tasks, dynamics = getattr(base, "tasks", None), getattr(base, "dynamics", None)
    if not isinstance(env, gym.Env) or tasks is None or dynamics is None:
        raise WrongEnvironment(
            f"{wrapper} wraps Gymnasium environments of this package, such as"
            f' gymnasium.make("lilgym_mp/TowerScratch-v0"), not {env!r}'
        )
    return EnvDescription(wrapper, tasks, dynamics, env.observation_space, env.action_space)


def as_batch(value: Any) -> Batch:
    """One value of a space as a batch of size 1."""
    if isinstance(value, dict):
        return {name: as_batch(part) for name, part in value.items()}
    if isinstance(value, str):
        return (value,)
    return np.asarray(value)[None]


def unbatched(space: spaces.Space[Any], batch: Batch) -> Any:
    """The single value of `space` in a batch of size 1."""
    if isinstance(space, spaces.Dict):
        return {name: unbatched(part, batch[name]) for name, part in space.spaces.items()}
    return int(batch[0]) if isinstance(space, spaces.Discrete) else batch[0]


def to_python(value: Any) -> Any:
    """Converts NumPy scalars to Python numbers; returns anything else unchanged."""
    return value.item() if isinstance(value, np.generic) else value
