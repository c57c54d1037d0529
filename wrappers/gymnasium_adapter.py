"""Applies a transformation to a Gymnasium environment, as a batch of one, or to a vector environment: the base class of
wrappers, and the SuperSuit-style factories for any kind of environment."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Concatenate, Generic, ParamSpec, SupportsFloat, TypeVar, cast

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space

from lilgym_mp.envs.batched import batched
from lilgym_mp.envs.interface import UNCHANGED_REWARD
from lilgym_mp.envs.masks import action_masks, layers
from lilgym_mp.envs.rules import State
from lilgym_mp.scene.arrays import AnyDict, AnyMapping, BoolArray, Int16Array, Int64Array
from lilgym_mp.wrappers.transformation import (
    Batch,
    Batches,
    EnvDescription,
    EnvState,
    GymEnv,
    Transformation,
    WrongEnvironment,
    change_tasks,
    description_of,
    stacked,
    to_python,
    unstacked,
)

if TYPE_CHECKING:
    from lilgym_mp.corpus import Vocabulary

    AnyVectorWrapper = VectorWrapper[Any, Any, Any, Any, Any]
else:
    AnyVectorWrapper = VectorWrapper  # takes no parameters in Gymnasium 1.2

TransformationT = TypeVar("TransformationT", bound=Transformation)
Settings = ParamSpec("Settings")
AnyEnv = Any  # a Gymnasium environment or vector environment, or a PettingZoo AEC or parallel environment

# Gymnasium's info keys in autoreset mode SAME_STEP
FINAL_OBS = "final_obs"
HAS_FINAL_OBS = "_final_obs"
FINAL_INFO = "final_info"


class EnvWrapper(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs, Generic[TransformationT]):
    """The base class of wrappers. `gym.make(env.spec)` rebuilds the stack; `action_masks` passes through it."""

    transformation_class: ClassVar[Callable[..., Transformation]]  # called with a description and the settings

    def __init__(self, env: GymEnv, **settings: Any) -> None:
        """Makes the transformation.

        Args:
            env: The environment to wrap.
            settings: Recorded in the spec and passed to the transformation.
        """
        RecordConstructorArgs.__init__(self, _disable_deepcopy=True, **settings)  # an encoder can be large
        gym.Wrapper.__init__(self, env)
        description = description_of(env, type(self).__name__)
        self.transformation = cast("TransformationT", type(self).transformation_class(description, **settings))
        change_tasks(env, self.transformation)
        self.observation_space = self.transformation.observation_space()
        self.action_space = self.transformation.action_space()
        self._state = SingleEnvState(description, env)

    def reset(self, *, seed: int | None = None, options: AnyDict | None = None) -> tuple[Any, AnyDict]:
        observation, info = self.env.reset(seed=seed, options=options)
        return self._transformed(observation), self._extended_info(info, {})

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, AnyDict]:
        entries: Batches = {}
        transformation = self.transformation
        states = self._state.states
        if transformation.changes_actions:
            actions, entries = transformation.actions(stacked([action]), self._state)
            action = actions[0]
        before = transformation.potentials(states()) if transformation.changes_rewards else None
        observation, reward, terminated, truncated, info = self.env.step(action)
        if entries or before is not None:
            ended = terminated or truncated
            if not ended and states()[0].steps == 0:  # reset by this step, in a wrapper
                entries = {}
            elif before is not None:
                entries = {**entries, UNCHANGED_REWARD: (reward,)}
                after = np.zeros(1) if ended else transformation.potentials(states())
                reward = transformation.rewards(np.array([float(reward)]), before, after).item()
        return self._transformed(observation), reward, terminated, truncated, self._extended_info(info, entries)

    def action_masks(self) -> BoolArray:
        """(actions,) bool, a new array: the legal actions after this wrapper and the wrapped ones."""
        return self.transformation.action_masks(self._state)[0]

    def _transformed(self, observation: Any) -> Any:
        if not self.transformation.changes_observations:
            return observation
        batch = self.transformation.observations(stacked([observation]), self._state)
        return unstacked(self.observation_space, batch)[0]

    def _extended_info(self, info: AnyDict, entries: Batches) -> AnyDict:
        if self.transformation.adds_infos:
            entries = {**entries, **self.transformation.added_infos(info, self._state)}
        return {**info, **{name: to_python(value[0]) for name, value in entries.items()}} if entries else info


class SingleEnvState(EnvState):
    """The state of one environment, with the masks of its wrappers up to `env`."""

    def __init__(self, description: EnvDescription, env: GymEnv) -> None:
        super().__init__(description)
        self._env = env

    def states(self) -> Sequence[State]:
        return (self._env.unwrapped.state,)  # pyright: ignore[reportAttributeAccessIssue]

    def action_masks(self) -> BoolArray:
        return action_masks(self._env)[None]


class VectorEnvWrapper(AnyVectorWrapper):
    """A wrapper of batched and worker environments; `action_masks` passes through it."""

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        wrapper_class: Any,
        settings: AnyMapping,
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
        self.autoreset_mode: AutoresetMode = self.metadata["autoreset_mode"]

    @property
    def vocabulary(self) -> Vocabulary:
        """The vocabulary of token ids. Raises AttributeError if statements are texts."""
        arrays = getattr(self.transformation, "arrays", None)
        return self.env.vocabulary if arrays is None else arrays.vocabulary  # pyright: ignore[reportAttributeAccessIssue]

    def __del__(self) -> None:
        """Does not close the wrapped environment, unlike Gymnasium's wrappers before 1.3."""

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: AnyMapping | None = None
    ) -> tuple[Any, AnyDict]:
        observations, infos = self.env.reset(seed=seed, options=options)  # pyright: ignore[reportArgumentType]
        return self._transformed(observations), self._extended_infos(infos)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, AnyDict]:
        entries: Batches = {}
        transformation = self.transformation
        states = self._state.states
        if transformation.changes_actions:
            actions, entries = transformation.actions(actions, self._state)
        before = transformation.potentials(states()) if transformation.changes_rewards else None
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        if entries or before is not None:
            ended = np.logical_or(terminated, truncated)
            acted = ended | (self._base.steps > 0)  # not reset by this step, in whatever layer
            if before is not None:
                entries = {**entries, UNCHANGED_REWARD: rewards}
                after = np.where(ended, 0.0, transformation.potentials(states()))
                rewards = np.where(acted, transformation.rewards(rewards, before, after), rewards)
            infos = self._with_entries(infos, entries, acted, ended)
        if FINAL_OBS in infos:
            infos = self._with_transformed_finals(infos)
        return self._transformed(observations), rewards, terminated, truncated, self._extended_infos(infos)

    def action_masks(self) -> BoolArray:
        """(N, actions) bool, a new array: the legal actions after this wrapper and the wrapped ones."""
        return self.transformation.action_masks(self._state)

    def goal_reached(self) -> BoolArray:
        """(N,) a new array: whether STOP would be rewarded +1 now."""
        return self._base.goal_reached()

    def _transformed(self, observations: Batch) -> Batch:
        if not self.transformation.changes_observations:
            return observations
        return self.transformation.observations(observations, self._state)

    def _extended_infos(self, infos: AnyDict) -> AnyDict:
        """The infos with the entries that the transformation adds."""
        if not self.transformation.adds_infos:
            return infos
        added = self.transformation.added_infos(infos, self._state)
        return {**infos, **added, **{f"_{name}": np.ones(self.num_envs, bool) for name in added}}

    def _with_transformed_finals(self, infos: AnyDict) -> AnyDict:
        """The infos with transformed final observations and infos of episodes that ended."""
        ended = infos[HAS_FINAL_OBS]
        env_ids = ended.nonzero()[0]
        state = FinalEnvState(self.transformation.env_description, self.env, env_ids)
        changed: AnyDict = {}
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

    def _with_entries(self, infos: AnyDict, entries: Batches, acted: BoolArray, ended: BoolArray) -> AnyDict:
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
        self._env = env
        self._env_ids = env_ids

    def action_masks(self) -> BoolArray:
        inner = next((layer for layer in layers(self._env) if isinstance(layer, VectorEnvWrapper)), None)
        if inner is None:
            return super().action_masks()
        return inner.transformation.action_masks(FinalEnvState(self._description, inner.env, self._env_ids))


def _columns(entries: Batches, where: BoolArray) -> AnyDict:
    """Entries (N,) in the format of Gymnasium's vector infos: each with a mask `_name`; none where there are none."""
    if not where.any():
        return {}
    values = {name: value * where for name, value in entries.items()}
    return values | {f"_{name}": where.copy() for name in entries}


def factory(
    wrapper: Callable[Concatenate[GymEnv, Settings], EnvWrapper[Any]], module: str | None = None
) -> Callable[Concatenate[AnyEnv, Settings], AnyEnv]:
    """A function that applies a wrapper to any kind of environment and returns the same kind.

    Args:
        wrapper: A subclass of EnvWrapper. The function is called as it is, in snake case, with "_v0" at the end.
        module: `__name__` of the module that assigns the function to that name, where pickle finds it. By default the
            module of the class.
    """
    assert isinstance(wrapper, type)
    signature = inspect.signature(wrapper)

    def wrap(env: AnyEnv, *args: Settings.args, **kwargs: Settings.kwargs) -> AnyEnv:
        if isinstance(env, gym.Env):
            return wrapper(env, *args, **kwargs)
        bound = signature.bind(env, *args, **kwargs)
        bound.apply_defaults()
        settings = dict(bound.arguments)
        del settings["env"]
        settings |= settings.pop("settings", {})  # of a wrapper that defines none
        if isinstance(env, VectorEnv):
            return VectorEnvWrapper(env, wrapper, settings)
        if "pettingzoo" in sys.modules and hasattr(env, "possible_agents"):
            from lilgym_mp.wrappers.pettingzoo_adapter import is_game, wrap_game

            if is_game(env):
                return wrap_game(env, wrapper.__name__, wrapper.transformation_class, settings)
        raise WrongEnvironment(
            f"{wrapper.__name__} wraps this package's Gymnasium environments, vector environments, and PettingZoo"
            f" environments of the proposer-verifier game, not {env!r}"
        )

    words = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", wrapper.__name__)
    wrap.__name__ = wrap.__qualname__ = f"{words.lower()}_v0"  # `NLVRReward` has `nlvr_reward_v0`
    wrap.__module__ = module or wrapper.__module__
    wrap.__doc__ = (
        f"Applies `{wrapper.__name__}` to an environment of any kind; takes its arguments.\n\n{wrapper.__doc__}"
    )
    return wrap
