"""Applies a transformation to a vector environment, as one batch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space

from lilgym_mp.arrays import BoolArray, Float64Array, Int16Array, Int64Array
from lilgym_mp.envs.single import UNCHANGED_REWARD
from lilgym_mp.rules import State
from lilgym_mp.wrappers.env_state import BaseEnvState, EnvDescription, EnvState, WrongEnvironment, scene_of
from lilgym_mp.wrappers.gymnasium_adapter import to_python
from lilgym_mp.wrappers.transformation import (
    Batch,
    Format,
    TaskChange,
    Transformation,
    require_innermost,
)

if TYPE_CHECKING:
    AnyVectorWrapper = VectorWrapper[Any, Any, Any, Any, Any]
else:
    AnyVectorWrapper = VectorWrapper  # takes no parameters in Gymnasium 1.2

# Gymnasium's info keys in autoreset mode SAME_STEP
FINAL_OBS, HAS_FINAL_OBS, FINAL_INFO = "final_obs", "_final_obs", "final_info"


class VectorEnvWrapper(AnyVectorWrapper):
    """A wrapper of batched and worker environments; `action_masks` passes through it."""

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        name: str,
        transformation_class: Callable[..., Transformation],
        settings: Mapping[str, Any],
    ) -> None:
        """`transformation_class`: called with an EnvDescription and the settings. `name`: the wrapper's name."""
        super().__init__(env)
        self.name = name
        description = _description_of(env, name)
        self.transformation = transformation_class(description, **settings)
        if isinstance(self.transformation, TaskChange):
            require_innermost(name, env)
            self.unwrapped.change_tasks(self.transformation.change)  # pyright: ignore[reportAttributeAccessIssue]
        if self.transformation.changes_observations:
            self.single_observation_space = self.transformation.observation_space()
            self.observation_space = _batched(self.single_observation_space, env)
        if self.transformation.changes_actions:
            self.single_action_space = self.transformation.action_space()
            self.action_space = batch_space(self.single_action_space, env.num_envs)
        self._state = VectorEnvState(env)
        self._restarting = np.zeros(env.num_envs, np.bool_)  # (N,) where the next step ignores the action and resets
        self._potentials = np.zeros(env.num_envs)  # (N,) potentials of the current states, if rewards are changed
        self.autoreset_mode: AutoresetMode = self.metadata["autoreset_mode"]

    def __del__(self) -> None:
        """Does not close the wrapped environment, unlike Gymnasium's wrappers before 1.3."""

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        observations, infos = self.env.reset(seed=seed, options=options)  # pyright: ignore[reportArgumentType]
        is_reset = (options or {}).get("reset_mask", slice(None))
        self._restarting[is_reset] = False
        if self.transformation.changes_rewards:
            self._update_potentials(np.arange(self.num_envs)[is_reset])
        return self._transformed(observations), self._extended_infos(infos)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        entries: Mapping[str, Batch] = {}
        if self.transformation.changes_actions:
            actions, entries = self.transformation.actions(actions, self._state)
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        ended = np.logical_or(terminated, truncated)
        if self.transformation.changes_rewards:
            entries = {**entries, UNCHANGED_REWARD: rewards}
            rewards = self._transformed_rewards(rewards, ended)
        if entries:
            infos = self._with_entries(infos, entries, ended)
        if FINAL_OBS in infos:
            infos = self._with_transformed_finals(infos)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            self._restarting = ended
        return self._transformed(observations), rewards, terminated, truncated, self._extended_infos(infos)

    def action_masks(self) -> BoolArray:
        """(N, actions) bool, a new array: the legal actions after this wrapper and the wrapped ones."""
        return self.transformation.action_masks(self._state)

    def goal_reached(self) -> BoolArray:
        """(N,) bool: whether STOP would succeed now."""
        return self._state.goal_reached()

    def _transformed_rewards(self, rewards: Float64Array, ended: BoolArray) -> Float64Array:
        """(N,) the transformed rewards, except of steps that only reset; updates the potentials."""
        before = self._potentials.copy()
        same_step = self.autoreset_mode is AutoresetMode.SAME_STEP
        self._update_potentials(np.arange(self.num_envs) if same_step else (~ended).nonzero()[0])
        changed = self.transformation.rewards(rewards, before, np.where(ended, 0.0, self._potentials))
        return np.where(self._restarting, rewards, changed)

    def _update_potentials(self, env_ids: Int64Array) -> None:
        states = self._state.states()
        self._potentials[env_ids] = self.transformation.potentials([states[env_id] for env_id in env_ids.tolist()])

    def _transformed(self, observations: Batch) -> Batch:
        if not self.transformation.changes_observations:
            return observations
        return self.transformation.observations(observations, self._state)

    def _extended_infos(self, infos: dict[str, Any]) -> dict[str, Any]:
        """The infos with the entries that the transformation adds."""
        if not self.transformation.adds_infos:
            return infos
        added = self.transformation.added_infos(infos, self._state)
        return {**infos, **added, **{f"_{name}": np.ones(self.num_envs, np.bool_) for name in added}}

    def _with_transformed_finals(self, infos: dict[str, Any]) -> dict[str, Any]:
        """The infos with transformed final observations and infos of episodes that ended."""
        ended = infos[HAS_FINAL_OBS]
        env_ids = ended.nonzero()[0]
        state = FinalEnvState(self.transformation.env_description, self.env, env_ids)
        changed: dict[str, Any] = {}
        if self.transformation.changes_observations:
            final_obs = changed[FINAL_OBS] = infos[FINAL_OBS].copy()
            transformed = self._transformed_each(final_obs[env_ids].tolist(), state)
            for env_id, observation in zip(env_ids.tolist(), transformed, strict=True):
                final_obs[env_id] = observation
        if self.transformation.adds_infos:
            changed[FINAL_INFO] = dict(infos[FINAL_INFO])
            for name, values in self.transformation.added_infos(infos[FINAL_INFO], state).items():
                column = np.zeros((self.num_envs, *np.shape(values)[1:]), np.asarray(values).dtype)
                column[env_ids] = values
                changed[FINAL_INFO] |= {name: column, f"_{name}": ended.copy()}
        return {**infos, **changed}

    def _with_entries(self, infos: dict[str, Any], entries: Mapping[str, Batch], ended: BoolArray) -> dict[str, Any]:
        """The infos with this step's entries; those of ended episodes go to "final_info" in mode SAME_STEP."""
        acted = ~self._restarting
        if self.autoreset_mode is not AutoresetMode.SAME_STEP:
            return infos | _columns(entries, acted)
        infos = infos | _columns(entries, acted & ~ended)
        if ended.any():
            infos[FINAL_INFO] = infos[FINAL_INFO] | _columns(entries, ended)
        return infos

    def _transformed_each(self, observations: Sequence[Any], state: EnvState) -> list[Any]:
        """The transformed observations of k environments, one by one."""
        transformation = self.transformation
        if not isinstance(transformation, Format):
            return _unstacked(self.single_observation_space, transformation.observations(_stacked(observations), state))
        new = transformation.new_values(_LazyBatch(observations), state)
        return [
            transformation.kept(observation) | {name: to_python(values[position]) for name, values in new.items()}
            for position, observation in enumerate(observations)
        ]

    def __repr__(self) -> str:
        return f"<{self.name}, {self.env}>"


class VectorEnvState:
    """The `EnvState` of a batched or worker environment, read lazily."""

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        self._base: Any = env.unwrapped
        self._action_masks: Callable[[], BoolArray] = _inherited(env, "action_masks")
        self._goal_reached: Callable[[], BoolArray] = _inherited(env, "goal_reached")

    @property
    def task_indices(self) -> Int64Array:
        return self._base.task_indices

    @property
    def steps(self) -> Int64Array:
        return self._base.steps

    @property
    def items(self) -> Int16Array:
        return self._base.scene_array()

    def states(self) -> Sequence[State]:
        return self._base.states()

    def action_masks(self) -> BoolArray:
        return self._action_masks()

    def goal_reached(self) -> BoolArray:
        return self._goal_reached()


class FinalEnvState(BaseEnvState):
    """The final `EnvState` of episodes, after environments have been reset in autoreset mode SAME_STEP."""

    def __init__(
        self,
        description: EnvDescription,
        env: Any,
        env_ids: Int64Array,
        transformations: Sequence[Transformation] | None = None,
    ) -> None:
        """`env_ids` (k,). `transformations`: those of the wrappers up to `env`, innermost first; None: look them up."""
        super().__init__(description)
        self._env = env
        self._env_ids = env_ids
        self._inner = _transformations(env) if transformations is None else transformations

    @property
    def task_indices(self) -> Int64Array:
        return self._env.unwrapped.last_task_indices[self._env_ids]

    @property
    def steps(self) -> Int64Array:
        return self._env.unwrapped.last_steps[self._env_ids]

    @property
    def items(self) -> Int16Array:
        return self._env.unwrapped.last_scene_array()[self._env_ids]

    def states(self) -> Sequence[State]:
        """The k final states, computed lazily."""
        if not self._states:
            tasks = [self._description.tasks[task] for task in self.task_indices.tolist()]
            columns = zip(tasks, map(scene_of, self.items), self.steps.tolist(), strict=True)
            self._states = [State(*fields) for fields in columns]
        return self._states

    def action_masks(self) -> BoolArray:
        if not self._inner:
            return super().action_masks()
        *inner, outermost = self._inner
        return outermost.action_masks(FinalEnvState(self._description, self._env, self._env_ids, inner))


def _transformations(env: Any) -> list[Transformation]:
    """The transformations of a stack of wrappers, innermost first."""
    found: list[Transformation] = []
    while isinstance(env, VectorWrapper):
        found += [env.transformation] if isinstance(env, VectorEnvWrapper) else []
        env = env.env
    return found[::-1]


class _LazyBatch(Mapping[str, Batch]):
    """Single observations as a batch whose parts are stacked lazily, since stacking images is slow."""

    def __init__(self, observations: Sequence[Mapping[str, Any]]) -> None:
        self._observations = observations

    def __getitem__(self, name: str) -> Batch:
        return _stacked([observation[name] for observation in self._observations])

    def __iter__(self) -> Iterator[str]:
        return iter(self._observations[0])

    def __len__(self) -> int:
        return len(self._observations[0])


def _columns(entries: Mapping[str, Batch], where: BoolArray) -> dict[str, Any]:
    """Entries (N,) in the format of Gymnasium's vector infos: each with a mask `_name`; none where there are none."""
    if not where.any():
        return {}
    values = {name: value * where for name, value in entries.items()}
    return values | {f"_{name}": where.copy() for name in entries}


def _stacked(values: Sequence[Any]) -> Batch:
    """Stacks values of one space to a batch."""
    first = values[0]
    if isinstance(first, dict):
        return {name: _stacked([value[name] for value in values]) for name in first}
    return tuple(values) if isinstance(first, str) else np.stack(values)


def _unstacked(space: spaces.Space[Any], batch: Batch) -> list[Any]:
    """Splits a batch into values of `space`."""
    if isinstance(space, spaces.Dict):
        parts = {name: _unstacked(part, batch[name]) for name, part in space.spaces.items()}
        return [dict(zip(parts, values, strict=True)) for values in zip(*parts.values(), strict=True)]
    return batch.tolist() if isinstance(space, spaces.Discrete) else list(batch)


def _batched(single: spaces.Space[Any], env: VectorEnv[Any, Any, Any]) -> spaces.Space[Any]:
    """The batched space. Unchanged parts reuse the spaces of `env`, because a batched Text is large."""
    count, old, old_single = env.num_envs, env.observation_space, env.single_observation_space
    if not isinstance(single, spaces.Dict) or not isinstance(old, spaces.Dict):
        return _batched_part(single, count)
    assert isinstance(old_single, spaces.Dict)
    kept = {name: old[name] for name, part in single.spaces.items() if old_single.spaces.get(name) is part}
    return spaces.Dict(
        {name: kept[name] if name in kept else _batched_part(part, count) for name, part in single.spaces.items()}
    )


def _batched_part(single: spaces.Space[Any], count: int) -> spaces.Space[Any]:
    return spaces.Tuple([single] * count) if isinstance(single, spaces.Text) else batch_space(single, count)


def _inherited(env: Any, name: str) -> Any:
    """The attribute of the outermost environment in the stack whose class defines it."""
    while isinstance(env, VectorWrapper) and not hasattr(type(env), name):
        env = env.env
    return getattr(env, name)


def _description_of(env: VectorEnv[Any, Any, Any], name: str) -> EnvDescription:
    """The description of `env` for the wrapper `name`. Raises WrongEnvironment for another package's environment."""
    base: Any = env.unwrapped
    if not hasattr(base, "scene_array"):
        raise WrongEnvironment(
            f"{name} wraps vector environments of this package, such as gymnasium.make_vec(id, num_envs=64),"
            f" not {env!r}; for others, wrap each environment: gymnasium.make_vec(id, wrappers=[{name}], ...)"
        )
    return EnvDescription(name, base.tasks, base.dynamics, env.single_observation_space, env.single_action_space)
