"""Applies a transformation to a vector environment, as one batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space

from lilgym_mp.envs.batched import batched
from lilgym_mp.envs.interface import UNCHANGED_REWARD
from lilgym_mp.envs.masks import action_masks, layers
from lilgym_mp.envs.rules import State
from lilgym_mp.scene.arrays import BoolArray, Float64Array, Int16Array, Int64Array
from lilgym_mp.wrappers.transformation import (
    Batch,
    EnvDescription,
    EnvState,
    Transformation,
    change_tasks,
    description_of,
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
        wrapper_class: Any,
        settings: Mapping[str, Any],
    ) -> None:
        """`wrapper_class`: of single environments; its transformation is called with an EnvDescription and settings."""
        super().__init__(env)
        self.name = wrapper_class.__name__
        self.wrapper_class = wrapper_class
        description = description_of(env, self.name)
        self.transformation: Transformation = wrapper_class.transformation_class(description, **settings)
        change_tasks(env, self.transformation)
        if self.transformation.changes_observations:
            self.single_observation_space = self.transformation.observation_space()
            self.observation_space = batched(self.single_observation_space, env.num_envs)
        if self.transformation.changes_actions:
            self.single_action_space = self.transformation.action_space()
            self.action_space = batch_space(self.single_action_space, env.num_envs)
        self._state = VectorEnvState(description, env)
        self._base: Any = env.unwrapped
        self._potentials = np.zeros(env.num_envs)  # (N,) potentials of the current states, if rewards are changed
        self._restorations = 0  # of states, as of `_potentials`
        self.autoreset_mode: AutoresetMode = self.metadata["autoreset_mode"]

    def __del__(self) -> None:
        """Does not close the wrapped environment, unlike Gymnasium's wrappers before 1.3."""

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        observations, infos = self.env.reset(seed=seed, options=options)  # pyright: ignore[reportArgumentType]
        if self.transformation.changes_rewards:
            self._update_potentials(self._base.steps == 0)
        return self._transformed(observations), self._extended_infos(infos)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        entries: Mapping[str, Batch] = {}
        if self.transformation.changes_rewards and self._restorations != self._base.restorations:
            self._update_potentials(np.ones(self.num_envs, np.bool_))
            self._restorations = self._base.restorations
        if self.transformation.changes_actions:
            actions, entries = self.transformation.actions(actions, self._state)
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        if entries or self.transformation.changes_rewards:
            ended = np.logical_or(terminated, truncated)
            started = self._base.steps == 0  # by this step, in whatever layer
            acted = ended | ~started
            if self.transformation.changes_rewards:
                entries = {**entries, UNCHANGED_REWARD: rewards}
                rewards = np.where(acted, self._transformed_rewards(rewards, ended, started), rewards)
            infos = self._with_entries(infos, entries, acted, ended)
        if FINAL_OBS in infos:
            infos = self._with_transformed_finals(infos)
        return self._transformed(observations), rewards, terminated, truncated, self._extended_infos(infos)

    def action_masks(self) -> BoolArray:
        """(N, actions) bool, a new array: the legal actions after this wrapper and the wrapped ones."""
        return self.transformation.action_masks(self._state)

    def _transformed_rewards(self, rewards: Float64Array, ended: BoolArray, started: BoolArray) -> Float64Array:
        """(N,) the transformed rewards; updates the potentials."""
        before = self._potentials.copy()
        self._update_potentials(started | ~ended)
        return self.transformation.rewards(rewards, before, np.where(ended, 0.0, self._potentials))

    def _update_potentials(self, where: BoolArray) -> None:
        states, env_ids = self._state.states(), where.nonzero()[0]
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

    def _with_entries(
        self, infos: dict[str, Any], entries: Mapping[str, Batch], acted: BoolArray, ended: BoolArray
    ) -> dict[str, Any]:
        """The infos with the entries of this step's actions; in mode SAME_STEP those of ended episodes go to
        "final_info"."""
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
        inner = next((layer for layer in layers(self._env) if isinstance(layer, VectorEnvWrapper)), None)
        if inner is None:
            return super().action_masks()
        return inner.transformation.action_masks(FinalEnvState(self._description, inner.env, self._env_ids))


def _columns(entries: Mapping[str, Batch], where: BoolArray) -> dict[str, Any]:
    """Entries (N,) in the format of Gymnasium's vector infos: each with a mask `_name`; none where there are none."""
    if not where.any():
        return {}
    values = {name: value * where for name, value in entries.items()}
    return values | {f"_{name}": where.copy() for name in entries}
