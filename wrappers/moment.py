"""What a wrapper may know of an environment: `World` stays, a `Moment` of B environments passes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from lilgym_mp.actions import STOP
from lilgym_mp.corpus import TaskSet
from lilgym_mp.rules import Dynamics

BoolArray = NDArray[np.bool_]
Int64Array = NDArray[np.int64]


class WrongEnvironment(TypeError):
    """A wrapper on an environment that lacks what it works on; names both and what would do."""


class Moment(Protocol):
    """What is the case now in B environments, beside what their observations show."""

    @property
    def task_numbers(self) -> Int64Array:  # (B,) place of each current task in the world's tasks
        ...

    def legal(self) -> BoolArray:
        """(B, actions) a new array: the legal actions, as the wrappers beneath leave them."""
        ...

    def goal_reached(self) -> BoolArray:
        """(B,) whether STOP would be rewarded as a success now."""
        ...


@dataclass(frozen=True)
class World:
    """What is the same in every episode of the environment beneath a wrapper."""

    wrapper: str  # the wrapper's name, for errors
    tasks: TaskSet
    dynamics: Dynamics
    observation_space: spaces.Space[Any]  # of one environment
    action_space: spaces.Space[Any]  # of one environment
    stop: int = field(init=False)  # the number of STOP

    _numbers: dict[str, int] = field(init=False, repr=False)  # by task id

    def __post_init__(self) -> None:
        object.__setattr__(self, "stop", self.dynamics.appearance.encode(STOP))
        object.__setattr__(self, "_numbers", {name: number for number, name in enumerate(self.tasks.ids)})

    def task_number(self, task_id: str) -> int:
        """The place of a task in `tasks`."""
        return self._numbers[task_id]

    def part(self, name: str) -> spaces.Space[Any]:
        """The space of the observation's part `name`. Raises WrongEnvironment naming the parts there are."""
        space = self.observation_space
        if not isinstance(space, spaces.Dict):
            raise WrongEnvironment(
                f"{self.wrapper} needs observations with a part {name!r}; beneath it they are {space}."
                f" Put {self.wrapper} nearer to the environment"
            )
        if name not in space.spaces:
            raise WrongEnvironment(
                f"{self.wrapper} needs observations with a part {name!r}; beneath it they have"
                f" {', '.join(sorted(space.spaces))}. Put {self.wrapper} nearer to the environment"
            )
        return space[name]

    def numbered_actions(self) -> spaces.Discrete:
        """The space of action numbers. Raises WrongEnvironment where actions have another form."""
        space = self.action_space
        if not isinstance(space, spaces.Discrete):
            raise WrongEnvironment(
                f"{self.wrapper} needs numbered actions, Discrete({self.dynamics.appearance.action_count});"
                f" beneath it they are {space}. Put {self.wrapper} nearer to the environment"
            )
        return space
