"""Transformations: what wrappers do, written once for batches of B environments.

The adapters apply them to Gymnasium, vector and PettingZoo environments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from lilgym_mp.arrays import BoolArray, Float64Array
from lilgym_mp.corpus import TaskSet
from lilgym_mp.rules import State
from lilgym_mp.wrappers.env_state import EnvDescription, EnvState, WrongEnvironment

Batch = Any  # B values of a space: an array (B, ...), a tuple of B strings, or a dict of these


class Transformation:
    """The identity. Subclasses override what they change, with pure methods."""

    changes_observations: ClassVar[bool] = False
    changes_actions: ClassVar[bool] = False
    uses_mdp_actions: ClassVar[bool] = False  # whether it decodes or describes MDP actions, so cannot wrap the game
    changes_rewards: ClassVar[bool] = False
    adds_infos: ClassVar[bool] = False  # whether `added_infos` has entries

    def __init__(self, description: EnvDescription) -> None:
        """Raises WrongEnvironment for an unsuitable environment, ValueError for invalid settings."""
        self.env_description = description

    def observation_space(self) -> spaces.Space[Any]:
        """The transformed space of one environment."""
        return self.env_description.observation_space

    def action_space(self) -> spaces.Space[Any]:
        """The transformed space of one environment."""
        return self.env_description.action_space

    def observations(self, observations: Batch, state: EnvState) -> Batch:
        """The transformed observations, in new containers."""
        return observations

    def actions(self, actions: Batch, state: EnvState) -> tuple[Batch, Mapping[str, BoolArray]]:
        """The actions for the wrapped environments, and info entries (B,) for this step."""
        return actions, {}

    def action_masks(self, state: EnvState) -> BoolArray:
        """(B, actions) a new array: the transformed masks of legal actions."""
        return state.action_masks()

    def potentials(self, states: Sequence[State]) -> Float64Array:
        """(B,) potentials of non-terminal states, for `rewards`."""
        return np.zeros(len(states))

    def rewards(self, rewards: Float64Array, before: Float64Array, after: Float64Array) -> Float64Array:
        """(B,) the transformed rewards; `before` and `after`: potentials around the step, 0 after the end."""
        return rewards

    def added_infos(self, info: Mapping[str, Any], state: EnvState) -> Mapping[str, Batch]:
        """Info entries to add after reset and step; `info` holds the existing ones."""
        return {}


class TaskChange(Transformation):
    """Replaces the environment's tasks once, when it is wrapped."""

    change: Callable[[TaskSet], TaskSet]  # applied to the environment's tasks


def require_innermost(name: str, env: Any) -> None:
    """Raises WrongEnvironment if `env` already has a wrapper that may depend on the tasks that `name` changes."""
    while env is not None:
        transformation = vars(env).get("transformation")
        if transformation is not None and not isinstance(transformation, TaskChange):
            other = transformation.env_description.wrapper
            raise WrongEnvironment(f"{name} changes the tasks, so it must be applied before {other}")
        env = vars(env).get("env")


class Format(Transformation):
    """Adds or replaces parts of Dict observations; subclasses define `new_spaces` and `new_values`."""

    changes_observations = True
    replaces: tuple[str, ...] = ()  # parts to drop, unless `new_values` has them

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        """The spaces of the new parts, of one environment."""
        raise NotImplementedError

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        """The values of the new parts."""
        raise NotImplementedError

    def observation_space(self) -> spaces.Dict:
        kept = {name: space for name, space in self.env_description.parts().items() if name not in self.replaces}
        return spaces.Dict(kept | dict(self.new_spaces()))

    def kept(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """The unchanged parts of one observation or a batch."""
        return {name: value for name, value in observation.items() if name not in self.replaces}

    def observations(self, observations: Mapping[str, Batch], state: EnvState) -> dict[str, Batch]:
        return self.kept(observations) | dict(self.new_values(observations, state))
