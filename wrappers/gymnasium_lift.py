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
from lilgym_mp.wrappers.moment import StatesMoment, World, WrongEnvironment
from lilgym_mp.wrappers.transformation import (
    Batch,
    TaskChange,
    Transformation,
    refuse_above_others,
)

Does = TypeVar("Does", bound=Transformation)


class EnvWrapper(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs, Generic[Does]):
    """Base of the wrappers: `gym.make(env.spec)` rebuilds the whole stack, masks pass through it."""

    does: ClassVar[Callable[..., Transformation]]  # makes the transformation from a world and the settings

    def __init__(self, env: gym.Env[Any, Any], **settings: Any) -> None:
        """`settings`: the constructor's arguments, recorded for the spec and given to the transformation."""
        RecordConstructorArgs.__init__(self, **settings)
        gym.Wrapper.__init__(self, env)
        world = world_of(env, type(self).__name__)
        self.transformation = cast("Does", type(self).does(world, **settings))
        if isinstance(self.transformation, TaskChange):
            refuse_above_others(world.wrapper, env)
            self.unwrapped.change_tasks(self.transformation.change)  # pyright: ignore[reportAttributeAccessIssue]
        self.observation_space = self.transformation.observation_space()
        self.action_space = self.transformation.action_space()
        self._moment = EnvMoment(world, env)
        self._values = np.zeros(1)  # of the state now, where rewards are changed

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        if self.transformation.changes_rewards:
            self._values = self.transformation.values(self._moment.states())
        return self._shown(observation), self._told(info, {})

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        entries: Mapping[str, Batch] = {}
        if self.transformation.changes_actions:
            actions, entries = self.transformation.actions(batch_of_one(action), self._moment)
            action = actions[0]
        observation, reward, terminated, truncated, info = self.env.step(action)
        if self.transformation.changes_rewards:
            entries = {**entries, UNCHANGED_REWARD: (reward,)}
            reward = self._changed(float(reward), ended=terminated or truncated)
        return self._shown(observation), reward, terminated, truncated, self._told(info, entries)

    def _changed(self, reward: float, *, ended: bool) -> float:
        before, does = self._values, self.transformation
        self._values = np.zeros(1) if ended else does.values(self._moment.states())
        return does.rewards(np.array([reward]), before, self._values).item()

    def action_masks(self) -> BoolArray:
        """(actions,) bool, a new array: the legal actions, as this wrapper and those beneath leave them."""
        return self.transformation.legal(self._moment)[0]

    def _shown(self, observation: Any) -> Any:
        if not self.transformation.changes_observations:
            return observation
        return only_one(
            self.observation_space, self.transformation.observations(batch_of_one(observation), self._moment)
        )

    def _told(self, info: dict[str, Any], entries: Mapping[str, Batch]) -> dict[str, Any]:
        if self.transformation.tells:
            entries = {**entries, **self.transformation.told(info, self._moment)}
        return {**info, **{name: plain(value[0]) for name, value in entries.items()}} if entries else info


class EnvMoment(StatesMoment):
    """The `Moment` of one environment, as the wrappers up to `env` have narrowed it."""

    def __init__(self, world: World, env: gym.Env[Any, Any]) -> None:
        super().__init__(world)
        self._env = env

    def states(self) -> Sequence[State]:
        return (self._env.unwrapped.state,)  # pyright: ignore[reportAttributeAccessIssue]

    def legal(self) -> BoolArray:
        return self._env.get_wrapper_attr("action_masks")()[None]

    def goal_reached(self) -> BoolArray:
        return np.array([self._env.get_wrapper_attr("goal_reached")()])


def world_of(env: gym.Env[Any, Any], wrapper: str) -> World:
    """What `wrapper` sees of `env`. Raises WrongEnvironment when it is none of this package's."""
    base = env.unwrapped if isinstance(env, gym.Env) else env
    tasks, dynamics = getattr(base, "tasks", None), getattr(base, "dynamics", None)
    if not isinstance(env, gym.Env) or tasks is None or dynamics is None:
        raise WrongEnvironment(
            f"{wrapper} wraps one of this package's Gymnasium environments, such as"
            f' gymnasium.make("lilgym_mp/TowerScratch-v0"), not {env!r}'
        )
    return World(wrapper, tasks, dynamics, env.observation_space, env.action_space)


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
