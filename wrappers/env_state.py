"""What transformations may read: the fixed `EnvDescription`, and the current `EnvState` of B environments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from lilgym_mp.actions import STOP
from lilgym_mp.arrays import BoolArray, Int16Array, Int64Array
from lilgym_mp.corpus import TaskSet
from lilgym_mp.observation import EMPTY, item_array, item_capacity
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import Colour, Item, Scene, Shape, Size

IMAGE, ITEMS, PLANES = "image", "item_array", "planes"  # observation keys that show the scene
SCENE_PARTS = frozenset((IMAGE, ITEMS, PLANES))


class WrongEnvironment(TypeError):
    """The environment lacks something that the wrapper needs."""


class EnvState(Protocol):
    """The current state of B environments."""

    @property
    def task_indices(self) -> Int64Array:  # (B,) indices of the current tasks in the description's TaskSet
        ...

    @property
    def steps(self) -> Int64Array:  # (B,) actions taken
        ...

    @property
    def items(self) -> Int16Array:  # (B, 3, capacity, 5): `item_array` of each scene
        ...

    def states(self) -> Sequence[State]:
        """One state per environment."""
        ...

    def action_masks(self) -> BoolArray:
        """(B, actions) a new array: the legal actions after the wrapped wrappers."""
        ...

    def goal_reached(self) -> BoolArray:
        """(B,) whether STOP would succeed now."""
        ...


@dataclass(frozen=True)
class EnvDescription:
    """The fixed properties of the environment that a wrapper wraps."""

    wrapper: str  # the wrapper's name, for error messages
    tasks: TaskSet
    dynamics: Dynamics
    observation_space: spaces.Space[Any]  # space of one environment
    action_space: spaces.Space[Any]  # space of one environment
    item_capacity: int = field(init=False)  # the most items a box can have
    stop_index: int = field(init=False)  # index of the action STOP

    def __post_init__(self) -> None:
        object.__setattr__(self, "item_capacity", item_capacity(self.tasks, self.dynamics))
        object.__setattr__(self, "stop_index", self.dynamics.appearance.encode(STOP))

    def parts(self) -> Mapping[str, spaces.Space[Any]]:
        """The spaces of a Dict observation. Raises WrongEnvironment for other observations."""
        space = self.observation_space
        if not isinstance(space, spaces.Dict):
            raise WrongEnvironment(
                f"{self.wrapper} needs Dict observations, but those of the wrapped environment are {space}."
                f" Apply {self.wrapper} earlier"
            )
        return space.spaces

    def part(self, name: str) -> spaces.Space[Any]:
        """The space of the observation's part `name`. Raises WrongEnvironment naming the existing parts."""
        parts = self.parts()
        if name not in parts:
            raise WrongEnvironment(
                f"{self.wrapper} needs observations with a part {name!r}, but the wrapped environment has"
                f" {', '.join(sorted(parts))}. Apply {self.wrapper} earlier"
            )
        return parts[name]

    def require_scene(self) -> None:
        """Raises WrongEnvironment unless observations show the scene: formats must not reveal more."""
        parts = self.parts()
        if not parts.keys() & SCENE_PARTS:
            raise WrongEnvironment(
                f"{self.wrapper} needs observations that show the scene (a part {' or '.join(sorted(SCENE_PARTS))}),"
                f" but the wrapped environment has {', '.join(sorted(parts))}"
            )

    def discrete_actions(self) -> spaces.Discrete:
        """The Discrete action space. Raises WrongEnvironment for another one."""
        space = self.action_space
        if not isinstance(space, spaces.Discrete):
            raise WrongEnvironment(
                f"{self.wrapper} needs the action space Discrete({self.dynamics.appearance.action_count}), but that of"
                f" the wrapped environment is {space}. Apply {self.wrapper} earlier"
            )
        return space


class BaseEnvState:
    """An `EnvState` computed from `states()`, with the full masks; subclasses override `states`."""

    def __init__(self, description: EnvDescription, states: Sequence[State] = ()) -> None:
        self._description = description
        self._states = states

    def states(self) -> Sequence[State]:
        """One state per environment."""
        return self._states

    @property
    def task_indices(self) -> Int64Array:
        return np.array([self._description.tasks.index_of(state.task.id) for state in self.states()], np.int64)

    @property
    def steps(self) -> Int64Array:
        return np.array([state.steps for state in self.states()], np.int64)

    @property
    def items(self) -> Int16Array:
        capacity = self._description.item_capacity
        return np.stack([item_array(state.scene, capacity) for state in self.states()])

    def action_masks(self) -> BoolArray:
        return np.stack([self._description.dynamics.legal_mask(state) for state in self.states()])

    def goal_reached(self) -> BoolArray:
        return np.array([self._description.dynamics.goal_reached(state) for state in self.states()], np.bool_)


def scene_of(array: Int16Array) -> Scene:
    """The scene whose `item_array` is `array`."""
    return Scene.of(*([_item(row) for row in box if row[-1] != EMPTY] for box in array.tolist()))


def _item(row: list[int]) -> Item:
    x, y, shape, colour, size = row
    return Item(x, y, Shape(shape), Colour(colour), Size(size))
