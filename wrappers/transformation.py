"""Transformations: what wrappers do, written once for batches of B environments, and what they may read: the fixed
`EnvDescription`, and the current `EnvState`.

The adapters apply them to Gymnasium, vector and PettingZoo environments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.observation import item_array, item_capacity
from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import STOP
from lilgym_mp.scene.arrays import AnyMapping, BoolArray, Float64Array, Int16Array, Int64Array, Strings

# Observation keys that show the scene
IMAGE = "image"
ITEMS = "item_array"
PLANES = "planes"
STATEMENT = "statement"  # observation key
SCENE_PARTS = frozenset((IMAGE, ITEMS, PLANES))

Batch = Any  # B values of a space: an array (B, ...), a tuple of B strings, or a dict of these
AnySpace = spaces.Space[Any]
Batches = Mapping[str, Batch]  # by name
Spaces = Mapping[str, AnySpace]  # by name
GymEnv = gym.Env[Any, Any]


class WrongEnvironment(TypeError):
    """The environment lacks something that the wrapper needs."""


@dataclass(frozen=True)
class EnvDescription:
    """The fixed properties of the environment that a wrapper wraps."""

    wrapper: str  # the wrapper's name, for error messages
    tasks: TaskSet
    dynamics: Dynamics
    observation_space: AnySpace  # space of one environment
    action_space: AnySpace  # space of one environment

    @cached_property
    def item_capacity(self) -> int:
        """The most items a box can have."""
        return item_capacity(self.tasks, self.dynamics)

    @property
    def stop_index(self) -> int:
        """The index of the action STOP."""
        return self.dynamics.appearance.encode(STOP)

    def parts(self) -> Spaces:
        """The spaces of a Dict observation. Raises WrongEnvironment for other observations."""
        space = self.observation_space
        if not isinstance(space, spaces.Dict):
            raise self._lacking("Dict observations", space)
        return space.spaces

    def part(self, name: str) -> AnySpace:
        """The space of the observation's part `name`. Raises WrongEnvironment naming the existing parts."""
        parts = self.parts()
        if name not in parts:
            raise self._lacking(f"observations with a part {name!r}", ", ".join(sorted(parts)))
        return parts[name]

    def require_scene(self) -> None:
        """Raises WrongEnvironment unless observations show the scene: formats must not reveal more."""
        parts = self.parts()
        if not parts.keys() & SCENE_PARTS:
            names = " or ".join(sorted(SCENE_PARTS))
            raise self._lacking(f"observations that show the scene (a part {names})", ", ".join(sorted(parts)))

    def require_discrete_actions(self) -> None:
        """Raises WrongEnvironment unless actions are indices."""
        if not isinstance(self.action_space, spaces.Discrete):
            count = self.dynamics.appearance.action_count
            raise self._lacking(f"the action space Discrete({count})", self.action_space)

    def _lacking(self, needed: str, found: object) -> WrongEnvironment:
        return WrongEnvironment(
            f"{self.wrapper} needs {needed}, but the wrapped environment has {found}. Apply {self.wrapper} earlier"
        )


def description_of(env: Any, wrapper: str) -> EnvDescription:
    """The description of `env` for `wrapper`. Raises WrongEnvironment for another package's environment."""
    base = env.unwrapped if isinstance(env, gym.Env | VectorEnv) else None
    tasks = getattr(base, "tasks", None)
    dynamics = getattr(base, "dynamics", None)
    if tasks is None or dynamics is None:
        raise WrongEnvironment(
            f"{wrapper} wraps Gymnasium environments of this package, such as gymnasium.make(id), and batches, such as"
            f" gymnasium.make_vec(id, num_envs=64), not {env!r}; for others, wrap each environment:"
            f' gymnasium.make_vec(id, vectorization_mode="sync", wrappers=[{wrapper}], ...)'
        )
    single = "single_" if isinstance(env, VectorEnv) else ""
    observation_space, action_space = (getattr(env, f"{single}{kind}_space") for kind in ("observation", "action"))
    return EnvDescription(wrapper, tasks, dynamics, observation_space, action_space)


class EnvState:
    """The current state of B environments, computed from `states()` unless overridden."""

    def __init__(
        self, description: EnvDescription, states: Sequence[State] = (), masks: BoolArray | None = None
    ) -> None:
        """`masks`: (B, actions) the legal actions, if the wrapped wrappers narrow them."""
        self._description = description
        self._states = states
        self._masks = masks

    def states(self) -> Sequence[State]:
        """One state per environment."""
        return self._states

    @property
    def task_indices(self) -> Int64Array:
        """(B,) indices of the current tasks in the description's TaskSet, its length or more for others."""
        tasks = self._description.tasks
        found = [tasks.find(state.task) for state in self.states()]
        return np.array([len(tasks) if index is None else index for index in found], np.int64)

    def by_task(self, rows: NDArray[Any], make: Callable[[Task], Any]) -> NDArray[Any]:
        """(B, ...) the row of each current task; `rows` are those of the description's tasks, others are made."""
        indices = self.task_indices
        found = rows.take(indices, axis=0, mode="clip")
        for row in (indices >= len(rows)).nonzero()[0].tolist():
            found[row] = make(self.states()[row].task)
        return found

    @property
    def steps(self) -> Int64Array:
        """(B,) actions taken."""
        return np.array([state.steps for state in self.states()], np.int64)

    @property
    def items(self) -> Int16Array:
        """(B, 3, capacity, 5) `item_array` of each scene."""
        capacity = self._description.item_capacity
        return np.stack([item_array(state.scene, capacity) for state in self.states()])

    def action_masks(self) -> BoolArray:
        """(B, actions) a new array: the legal actions after the wrapped wrappers."""
        if self._masks is not None:
            return self._masks.copy()
        return np.stack([self._description.dynamics.legal_mask(state) for state in self.states()])

    def goal_reached(self) -> BoolArray:
        """(B,) whether STOP would succeed now."""
        return np.array([self._description.dynamics.goal_reached(state) for state in self.states()], bool)


class Transformation:
    """The identity. Subclasses override what they change, with pure methods."""

    changes_observations: bool = False
    changes_actions: bool = False  # so cannot wrap the game, whose agents have other action spaces
    uses_mdp_actions: bool = False  # whether it depends on MDP actions in other ways, with the same consequence
    changes_rewards: bool = False
    adds_infos: bool = False  # whether `added_infos` has entries

    def __init__(self, description: EnvDescription) -> None:
        """Raises WrongEnvironment for an unsuitable environment, ValueError for invalid settings."""
        self.env_description = description

    def observation_space(self) -> AnySpace:
        """The transformed space of one environment."""
        return self.env_description.observation_space

    def action_space(self) -> AnySpace:
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
        """(B,) potentials of states, for `rewards`."""
        return np.zeros(len(states))

    def rewards(self, rewards: Float64Array, before: Float64Array, after: Float64Array) -> Float64Array:
        """(B,) the transformed rewards; `before` and `after`: potentials around the step, 0 after the end."""
        return rewards

    def added_infos(self, info: AnyMapping, state: EnvState) -> Batches:
        """Info entries to add after reset and step; `info` holds the existing ones."""
        return {}


class TaskChange(Transformation):
    """Replaces the environment's tasks by `change(tasks)` once, when it is wrapped."""

    def __init__(self, description: EnvDescription, *, change: Callable[[TaskSet], TaskSet]) -> None:
        super().__init__(description)
        self.change = change


def change_tasks(env: Any, transformation: Transformation, applied: Iterable[Transformation] | None = None) -> None:
    """Replaces the tasks of `env` if it is to be wrapped in a TaskChange; `applied`: by default those of its wrappers.

    Raises WrongEnvironment if `env` has a wrapper that may depend on its tasks, or a sampler, which may choose others.
    """
    if not isinstance(transformation, TaskChange):
        return
    description = transformation.env_description
    for other in _transformations(env) if applied is None else applied:
        if not isinstance(other, TaskChange):
            raise WrongEnvironment(
                f"{description.wrapper} changes the tasks, so it must be applied before {other.env_description.wrapper}"
            )
    if getattr(env.unwrapped, "sampler", None) is not None:
        raise WrongEnvironment(f"{description.wrapper} changes the tasks, which a sampler chooses; leave out sampler")
    env.unwrapped.change_tasks(transformation.change)


def _transformations(env: Any) -> Iterator[Transformation]:
    """Those of the wrappers of `env`, outermost first."""
    while env is not None:
        if "transformation" in vars(env):
            yield env.transformation
        env = vars(env).get("env")


class Format(Transformation):
    """Adds or replaces parts of Dict observations; subclasses define `new_spaces` and `new_values`."""

    changes_observations = True
    replaces: Strings = ()  # parts to drop, unless `new_values` has them

    def new_spaces(self) -> Spaces:
        """The spaces of the new parts, of one environment."""
        raise NotImplementedError

    def new_values(self, observations: Batches, state: EnvState) -> Batches:
        """The values of the new parts."""
        raise NotImplementedError

    def observation_space(self) -> spaces.Dict:
        kept = {name: space for name, space in self.env_description.parts().items() if name not in self.replaces}
        return spaces.Dict(kept | dict(self.new_spaces()))

    def observations(self, observations: Batches, state: EnvState) -> dict[str, Batch]:
        kept = {name: values for name, values in observations.items() if name not in self.replaces}
        return kept | dict(self.new_values(observations, state))


class SceneFormat(Format):
    """Another encoding of the scene, which replaces the image or is added to it."""

    def __init__(self, description: EnvDescription, *, keep_image: bool = False) -> None:
        """Raises WrongEnvironment unless observations show the scene."""
        super().__init__(description)
        description.require_scene()
        if not keep_image:
            self.replaces = (IMAGE,)


def stacked(values: Sequence[Any]) -> Batch:
    """Values of one space as a batch."""
    first = values[0]
    if isinstance(first, dict):
        return {name: stacked([value[name] for value in values]) for name in first}
    if isinstance(first, str):
        return tuple(values)
    return np.asarray(first)[None] if len(values) == 1 else np.stack(values)


def unstacked(space: AnySpace, batch: Batch) -> list[Any]:
    """The values of `space` in a batch."""
    if isinstance(space, spaces.Dict):
        parts = {name: unstacked(part, batch[name]) for name, part in space.spaces.items()}
        return [dict(zip(parts, values, strict=True)) for values in zip(*parts.values(), strict=True)]
    return np.asarray(batch).tolist() if isinstance(space, spaces.Discrete) else list(batch)


def to_python(value: Any) -> Any:
    """Converts NumPy scalars to Python numbers; returns anything else unchanged."""
    return value.item() if isinstance(value, np.generic) else value
