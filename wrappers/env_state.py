"""What a wrapper may know of an environment: `EnvDescription` stays, an `EnvState` of B environments passes."""

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

IMAGE, ITEMS, PLANES = "image", "item_array", "planes"  # the observation's parts that show the scene
SCENE_PARTS = frozenset((IMAGE, ITEMS, PLANES))


class WrongEnvironment(TypeError):
    """A wrapper on an environment that lacks what it works on; names both and what would do."""


class EnvState(Protocol):
    """What is the case now in B environments, beside what their observations show."""

    @property
    def task_numbers(self) -> Int64Array:  # (B,) place of each current task in the description's tasks
        ...

    @property
    def steps(self) -> Int64Array:  # (B,) actions taken
        ...

    @property
    def items(self) -> Int16Array:  # (B, 3, capacity, 5): `item_array` of each scene
        ...

    def states(self) -> Sequence[State]:
        """(B) the states."""
        ...

    def legal(self) -> BoolArray:
        """(B, actions) a new array: the legal actions, as the wrappers beneath leave them."""
        ...

    def goal_reached(self) -> BoolArray:
        """(B,) whether STOP would be rewarded as a success now."""
        ...


@dataclass(frozen=True)
class EnvDescription:
    """What is the same in every episode of the environment beneath a wrapper."""

    wrapper: str  # the wrapper's name, for errors
    tasks: TaskSet
    dynamics: Dynamics
    observation_space: spaces.Space[Any]  # of one environment
    action_space: spaces.Space[Any]  # of one environment
    item_capacity: int = field(init=False)  # items that a box can have at most
    stop: int = field(init=False)  # the number of STOP

    def __post_init__(self) -> None:
        object.__setattr__(self, "item_capacity", item_capacity(self.tasks, self.dynamics))
        object.__setattr__(self, "stop", self.dynamics.appearance.encode(STOP))

    def parts(self) -> Mapping[str, spaces.Space[Any]]:
        """The spaces of an observation's parts. Raises WrongEnvironment where observations have none."""
        space = self.observation_space
        if not isinstance(space, spaces.Dict):
            raise WrongEnvironment(
                f"{self.wrapper} needs observations with parts by name; beneath it they are {space}."
                f" Put {self.wrapper} nearer to the environment"
            )
        return space.spaces

    def part(self, name: str) -> spaces.Space[Any]:
        """The space of the observation's part `name`. Raises WrongEnvironment naming the parts there are."""
        parts = self.parts()
        if name not in parts:
            raise WrongEnvironment(
                f"{self.wrapper} needs observations with a part {name!r}; beneath it they have"
                f" {', '.join(sorted(parts))}. Put {self.wrapper} nearer to the environment"
            )
        return parts[name]

    def require_scene(self) -> None:
        """Raises WrongEnvironment where observations do not show the scene: a format reveals nothing new."""
        parts = self.parts()
        if not parts.keys() & SCENE_PARTS:
            raise WrongEnvironment(
                f"{self.wrapper} needs observations that show the scene (a part {' or '.join(sorted(SCENE_PARTS))});"
                f" beneath it they have {', '.join(sorted(parts))}"
            )

    def numbered_actions(self) -> spaces.Discrete:
        """The space of action numbers. Raises WrongEnvironment where actions have another form."""
        space = self.action_space
        if not isinstance(space, spaces.Discrete):
            raise WrongEnvironment(
                f"{self.wrapper} needs numbered actions, Discrete({self.dynamics.appearance.action_count});"
                f" beneath it they are {space}. Put {self.wrapper} nearer to the environment"
            )
        return space


class StatesOf:
    """The `EnvState` of states, nothing having narrowed what is legal."""

    def __init__(self, description: EnvDescription, states: Sequence[State] = ()) -> None:
        self._description = description
        self._states = states

    def states(self) -> Sequence[State]:
        """(B) the states now; subclasses look them up when asked."""
        return self._states

    @property
    def task_numbers(self) -> Int64Array:
        return np.array([self._description.tasks.number(state.task.id) for state in self.states()], np.int64)

    @property
    def steps(self) -> Int64Array:
        return np.array([state.steps for state in self.states()], np.int64)

    @property
    def items(self) -> Int16Array:
        capacity = self._description.item_capacity
        return np.stack([item_array(state.scene, capacity) for state in self.states()])

    def legal(self) -> BoolArray:
        return np.stack([self._description.dynamics.legal_mask(state) for state in self.states()])

    def goal_reached(self) -> BoolArray:
        return np.array([self._description.dynamics.goal_reached(state) for state in self.states()], np.bool_)


def scene_of(array: Int16Array) -> Scene:
    """The scene whose `item_array` is `array`."""
    return Scene.of(*([_item(row) for row in box if row[-1] != EMPTY] for box in array.tolist()))


def _item(row: list[int]) -> Item:
    x, y, shape, colour, size = row
    return Item(x, y, Shape(shape), Colour(colour), Size(size))
