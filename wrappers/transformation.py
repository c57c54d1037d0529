"""What a wrapper changes, written once for B environments; the adapters apply it to every kind of environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from lilgym_mp.arrays import BoolArray, Float64Array
from lilgym_mp.corpus import TaskSet
from lilgym_mp.rules import State
from lilgym_mp.wrappers.env_state import EnvDescription, EnvState, WrongEnvironment

Batch = Any  # B values of a space: an array (B, ...), a tuple of B texts, or a dict of such


class Transformation:
    """Does nothing. A wrapper's transformation overrides what it changes; all of it is pure."""

    changes_observations: ClassVar[bool] = False
    changes_actions: ClassVar[bool] = False
    concerns_actions: ClassVar[bool] = False  # whether actions have another form, or are told of, after the change
    changes_rewards: ClassVar[bool] = False
    adds_infos: ClassVar[bool] = False  # whether `added_infos` has entries

    def __init__(self, description: EnvDescription) -> None:
        """Raises WrongEnvironment where the description lacks what is needed, ValueError for unusable settings."""
        self.env_description = description

    def observation_space(self) -> spaces.Space[Any]:
        """Of one environment, after the change."""
        return self.env_description.observation_space

    def action_space(self) -> spaces.Space[Any]:
        """Of one environment, after the change."""
        return self.env_description.action_space

    def observations(self, observations: Batch, state: EnvState) -> Batch:
        """The observations after the change, in new containers."""
        return observations

    def actions(self, actions: Batch, state: EnvState) -> tuple[Batch, Mapping[str, BoolArray]]:
        """The actions for the environments beneath, and entries (B,) for the infos of this step."""
        return actions, {}

    def legal(self, state: EnvState) -> BoolArray:
        """(B, actions) a new array: the legal actions after the change."""
        return state.legal()

    def values(self, states: Sequence[State]) -> Float64Array:
        """(B,) what `rewards` needs to know of states in which an episode goes on."""
        return np.zeros(len(states))

    def rewards(self, rewards: Float64Array, before: Float64Array, after: Float64Array) -> Float64Array:
        """(B,) the rewards after the change, from `values` before and after the actions; 0 after an episode's end."""
        return rewards

    def added_infos(self, info: Mapping[str, Any], state: EnvState) -> Mapping[str, Batch]:
        """Entries to add to the infos after reset and step; `info` is what is there already."""
        return {}


class TaskChange(Transformation):
    """Gives the environment other tasks to play; done once, when it is wrapped."""

    change: Callable[[TaskSet], TaskSet]  # from the environment's tasks; an operation of the corpus


def refuse_above_others(name: str, env: Any) -> None:
    """Raises WrongEnvironment where a wrapper beneath may already have looked at the tasks that `name` changes."""
    while env is not None:
        transformation = vars(env).get("transformation")
        if transformation is not None and not isinstance(transformation, TaskChange):
            beneath = transformation.env_description.wrapper
            raise WrongEnvironment(f"{name} changes the tasks, so it must stand beneath {beneath}, not above it")
        env = vars(env).get("env")


class Format(Transformation):
    """Changes parts of an observation and leaves the others: a pair (new_spaces, new_values)."""

    changes_observations = True
    replaces: tuple[str, ...] = ()  # parts that are left out unless `new_values` gives them anew

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        """The new parts' spaces, of one environment."""
        raise NotImplementedError

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        """The new parts of B observations."""
        raise NotImplementedError

    def observation_space(self) -> spaces.Dict:
        kept = {name: space for name, space in self.env_description.parts().items() if name not in self.replaces}
        return spaces.Dict(kept | dict(self.new_spaces()))

    def kept(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """The parts that it leaves, of one observation or a batch."""
        return {name: value for name, value in observation.items() if name not in self.replaces}

    def observations(self, observations: Mapping[str, Batch], state: EnvState) -> dict[str, Batch]:
        return self.kept(observations) | dict(self.new_values(observations, state))
