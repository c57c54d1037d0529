"""A transformation on one Gymnasium environment: a batch of one."""

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
from lilgym_mp.wrappers.env_state import EnvDescription, StatesOf, WrongEnvironment
from lilgym_mp.wrappers.transformation import (
    Batch,
    TaskChange,
    Transformation,
    refuse_above_others,
)

Does = TypeVar("Does", bound=Transformation)


class EnvWrapper(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs, Generic[Does]):
    """Base of the wrappers: `gym.make(env.spec)` rebuilds the whole stack, masks pass through it."""

    transformation_class: ClassVar[Callable[..., Transformation]]  # called with a description and the settings

    def __init__(self, env: gym.Env[Any, Any], **settings: Any) -> None:
        """`settings`: the constructor's arguments, recorded for the spec and given to the transformation."""
        RecordConstructorArgs.__init__(self, **settings)
        gym.Wrapper.__init__(self, env)
        description = description_of(env, type(self).__name__)
        self.transformation = cast("Does", type(self).transformation_class(description, **settings))
        if isinstance(self.transformation, TaskChange):
            refuse_above_others(description.wrapper, env)
            self.unwrapped.change_tasks(self.transformation.change)  # pyright: ignore[reportAttributeAccessIssue]
        self.observation_space = self.transformation.observation_space()
        self.action_space = self.transformation.action_space()
        self._state = SingleEnvState(description, env)
        self._values = np.zeros(1)  # of the state now, where rewards are changed

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        if self.transformation.changes_rewards:
            self._values = self.transformation.values(self._state.states())
        return self._shown(observation), self._with_infos(info, {})

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        entries: Mapping[str, Batch] = {}
        if self.transformation.changes_actions:
            actions, entries = self.transformation.actions(batch_of_one(action), self._state)
            action = actions[0]
        observation, reward, terminated, truncated, info = self.env.step(action)
        if self.transformation.changes_rewards:
            entries = {**entries, UNCHANGED_REWARD: (reward,)}
            reward = self._changed(float(reward), ended=terminated or truncated)
        return self._shown(observation), reward, terminated, truncated, self._with_infos(info, entries)

    def _changed(self, reward: float, *, ended: bool) -> float:
        before, transformation = self._values, self.transformation
        self._values = np.zeros(1) if ended else transformation.values(self._state.states())
        return transformation.rewards(np.array([reward]), before, self._values).item()

    def action_masks(self) -> BoolArray:
        """(actions,) bool, a new array: the legal actions, as this wrapper and those beneath leave them."""
        return self.transformation.legal(self._state)[0]

    def _shown(self, observation: Any) -> Any:
        if not self.transformation.changes_observations:
            return observation
        return only_one(
            self.observation_space, self.transformation.observations(batch_of_one(observation), self._state)
        )

    def _with_infos(self, info: dict[str, Any], entries: Mapping[str, Batch]) -> dict[str, Any]:
        if self.transformation.adds_infos:
            entries = {**entries, **self.transformation.added_infos(info, self._state)}
        return {**info, **{name: plain(value[0]) for name, value in entries.items()}} if entries else info


class SingleEnvState(StatesOf):
    """The `EnvState` of one environment, as the wrappers up to `env` have narrowed it."""

    def __init__(self, description: EnvDescription, env: gym.Env[Any, Any]) -> None:
        super().__init__(description)
        self._env = env

    def states(self) -> Sequence[State]:
        return (self._env.unwrapped.state,)  # pyright: ignore[reportAttributeAccessIssue]

    def legal(self) -> BoolArray:
        return self._env.get_wrapper_attr("action_masks")()[None]

    def goal_reached(self) -> BoolArray:
        return np.array([self._env.get_wrapper_attr("goal_reached")()])


def description_of(env: gym.Env[Any, Any], wrapper: str) -> EnvDescription:
    """What `wrapper` sees of `env`. Raises WrongEnvironment when it is none of this package's."""
    base = env.unwrapped if isinstance(env, gym.Env) else env
    tasks, dynamics = getattr(base, "tasks", None), getattr(base, "dynamics", None)
    if not isinstance(env, gym.Env) or tasks is None or dynamics is None:
        raise WrongEnvironment(
            f"{wrapper} wraps one of this package's Gymnasium environments, such as"
            f' gymnasium.make("lilgym_mp/TowerScratch-v0"), not {env!r}'
        )
    return EnvDescription(wrapper, tasks, dynamics, env.observation_space, env.action_space)


def batch_of_one(value: Any) -> Batch:
    """One value of a space as a batch."""
    if isinstance(value, dict):
        return {name: batch_of_one(part) for name, part in value.items()}
    if isinstance(value, str):
        return (value,)
    return np.asarray(value)[None]


def only_one(space: spaces.Space[Any], batch: Batch) -> Any:
    """The value of `space` that `batch` consists of."""
    if isinstance(space, spaces.Dict):
        return {name: only_one(part, batch[name]) for name, part in space.spaces.items()}
    return int(batch[0]) if isinstance(space, spaces.Discrete) else batch[0]


def plain(value: Any) -> Any:
    """A NumPy number as Python's own; anything else as it is."""
    return value.item() if isinstance(value, np.generic) else value
