"""Applies a transformation to a vector environment, as one batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space

from lilgym_mp.arrays import BoolArray, Float64Array, Int16Array, Int64Array
from lilgym_mp.envs.batched import batched
from lilgym_mp.envs.masks import action_masks
from lilgym_mp.envs.single import UNCHANGED_REWARD
from lilgym_mp.rules import State
from lilgym_mp.wrappers.transformation import (
    Batch,
    EnvDescription,
    EnvState,
    Transformation,
    WrongEnvironment,
    change_tasks,
    stacked,
    unstacked,
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
        change_tasks(env, self.transformation)
        if self.transformation.changes_observations:
            self.single_observation_space = self.transformation.observation_space()
            self.observation_space = batched(self.single_observation_space, env.num_envs)
        if self.transformation.changes_actions:
            self.single_action_space = self.transformation.action_space()
            self.action_space = batch_space(self.single_action_space, env.num_envs)
        self._state = VectorEnvState(description, env)
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
            transformed = self.transformation.observations(stacked(final_obs[env_ids].tolist()), state)
            singles = unstacked(self.single_observation_space, transformed)
            for env_id, observation in zip(env_ids.tolist(), singles, strict=True):
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

    def __repr__(self) -> str:
        return f"<{self.name}, {self.env}>"


class VectorEnvState(EnvState):
    """The state of a batched or worker environment, with the masks of its wrappers up to `env`, read lazily."""

    def __init__(self, description: EnvDescription, env: Any) -> None:
        super().__init__(description)
        self._env = env
        self._base = env.unwrapped

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
        return action_masks(self._env)

    def goal_reached(self) -> BoolArray:
        return self._base.goal_reached()


class FinalEnvState(EnvState):
    """The final state of episodes, after environments (k,) have been reset in autoreset mode SAME_STEP."""

    def __init__(self, description: EnvDescription, env: Any, env_ids: Int64Array) -> None:
        super().__init__(description, env.unwrapped.last_states(env_ids))
        self._env, self._env_ids = env, env_ids

    def action_masks(self) -> BoolArray:
        inner = self._env
        while isinstance(inner, VectorWrapper) and not isinstance(inner, VectorEnvWrapper):
            inner = inner.env
        if not isinstance(inner, VectorEnvWrapper):
            return super().action_masks()
        return inner.transformation.action_masks(FinalEnvState(self._description, inner.env, self._env_ids))


def _columns(entries: Mapping[str, Batch], where: BoolArray) -> dict[str, Any]:
    """Entries (N,) in the format of Gymnasium's vector infos: each with a mask `_name`; none where there are none."""
    if not where.any():
        return {}
    values = {name: value * where for name, value in entries.items()}
    return values | {f"_{name}": where.copy() for name in entries}


def _description_of(env: VectorEnv[Any, Any, Any], name: str) -> EnvDescription:
    """The description of `env` for the wrapper `name`. Raises WrongEnvironment for another package's environment."""
    base: Any = env.unwrapped
    if not hasattr(base, "scene_array"):
        raise WrongEnvironment(
            f"{name} wraps vector environments of this package, such as gymnasium.make_vec(id, num_envs=64),"
            f" not {env!r}; for others, wrap each environment: gymnasium.make_vec(id, wrappers=[{name}], ...)"
        )
    return EnvDescription(name, base.tasks, base.dynamics, env.single_observation_space, env.single_action_space)
