"""A transformation on a vector environment: whole arrays, whatever its number of environments."""

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
from lilgym_mp.wrappers.env_state import EnvDescription, EnvState, StatesOf, WrongEnvironment, scene_of
from lilgym_mp.wrappers.gymnasium_adapter import plain
from lilgym_mp.wrappers.transformation import (
    Batch,
    Format,
    TaskChange,
    Transformation,
    refuse_above_others,
)

if TYPE_CHECKING:
    AnyVectorWrapper = VectorWrapper[Any, Any, Any, Any, Any]
else:
    AnyVectorWrapper = VectorWrapper  # takes no parameters in Gymnasium 1.2

LAST, WHERE_LAST = "final_obs", "_final_obs"  # Gymnasium's names in infos of mode SAME_STEP
LAST_INFO = "final_info"


class VectorEnvWrapper(AnyVectorWrapper):
    """What every factory makes of a batched or worker environment; masks pass through it."""

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        name: str,
        transformation_class: Callable[..., Transformation],
        settings: Mapping[str, Any],
    ) -> None:
        """`transformation_class` is called with a description and the settings; `name`: the wrapper's."""
        super().__init__(env)
        self.name = name
        description = _description_of(env, name)
        self.transformation = transformation_class(description, **settings)
        if isinstance(self.transformation, TaskChange):
            refuse_above_others(name, env)
            self.unwrapped.change_tasks(self.transformation.change)  # pyright: ignore[reportAttributeAccessIssue]
        if self.transformation.changes_observations:
            self.single_observation_space = self.transformation.observation_space()
            self.observation_space = _batched(self.single_observation_space, env)
        if self.transformation.changes_actions:
            self.single_action_space = self.transformation.action_space()
            self.action_space = batch_space(self.single_action_space, env.num_envs)
        self._state = VectorEnvState(env)
        self._restarting = np.zeros(env.num_envs, np.bool_)  # where the next action is ignored, since it only resets
        self._values = np.zeros(env.num_envs)  # of the states now, where rewards are changed
        self.autoreset_mode: AutoresetMode = self.metadata["autoreset_mode"]

    def __del__(self) -> None:
        """Leaves open what it wraps; before Gymnasium 1.3 a wrapper closes that when it is collected."""

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        observations, infos = self.env.reset(seed=seed, options=options)  # pyright: ignore[reportArgumentType]
        begun = (options or {}).get("reset_mask", slice(None))
        self._restarting[begun] = False
        if self.transformation.changes_rewards:
            self._evaluate(np.arange(self.num_envs)[begun])
        return self._shown(observations), self._with_infos(infos)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        entries: Mapping[str, Batch] = {}
        if self.transformation.changes_actions:
            actions, entries = self.transformation.actions(actions, self._state)
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        ended = np.logical_or(terminated, truncated)
        if self.transformation.changes_rewards:
            entries = {**entries, UNCHANGED_REWARD: rewards}
            rewards = self._changed(rewards, ended)
        if entries:
            infos = self._reported(infos, entries, ended)
        if LAST in infos:
            infos = self._with_ends(infos)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            self._restarting = ended
        return self._shown(observations), rewards, terminated, truncated, self._with_infos(infos)

    def action_masks(self) -> BoolArray:
        """(N, actions) bool, a new array: the legal actions, as this wrapper and those beneath leave them."""
        return self.transformation.legal(self._state)

    def goal_reached(self) -> BoolArray:
        """(N,) bool: whether STOP would be rewarded as a success now."""
        return self._state.goal_reached()

    def _changed(self, rewards: Float64Array, ended: BoolArray) -> Float64Array:
        """(N,) the rewards after the change, and `_values` those of the states now; a reset's reward stays."""
        before = self._values.copy()
        same_step = self.autoreset_mode is AutoresetMode.SAME_STEP
        self._evaluate(np.arange(self.num_envs) if same_step else (~ended).nonzero()[0])
        changed = self.transformation.rewards(rewards, before, np.where(ended, 0.0, self._values))
        return np.where(self._restarting, rewards, changed)

    def _evaluate(self, env_ids: Int64Array) -> None:
        states = self._state.states()
        self._values[env_ids] = self.transformation.values([states[env_id] for env_id in env_ids.tolist()])

    def _shown(self, observations: Batch) -> Batch:
        if not self.transformation.changes_observations:
            return observations
        return self.transformation.observations(observations, self._state)

    def _with_infos(self, infos: dict[str, Any]) -> dict[str, Any]:
        """The infos with what the transformation tells of every environment."""
        if not self.transformation.adds_infos:
            return infos
        told = self.transformation.added_infos(infos, self._state)
        return {**infos, **told, **{f"_{name}": np.ones(self.num_envs, np.bool_) for name in told}}

    def _with_ends(self, infos: dict[str, Any]) -> dict[str, Any]:
        """The infos with the last observations and infos of episodes that ended, as this wrapper shows them."""
        ended = infos[WHERE_LAST]
        env_ids = ended.nonzero()[0]
        state = FinalEnvState(self.transformation.env_description, self.env, env_ids)
        changed: dict[str, Any] = {}
        if self.transformation.changes_observations:
            last = changed[LAST] = infos[LAST].copy()
            for env_id, shown in zip(env_ids.tolist(), self._each_shown(last[env_ids].tolist(), state), strict=True):
                last[env_id] = shown
        if self.transformation.adds_infos:
            changed[LAST_INFO] = dict(infos[LAST_INFO])
            for name, values in self.transformation.added_infos(infos[LAST_INFO], state).items():
                spread = np.zeros((self.num_envs, *np.shape(values)[1:]), np.asarray(values).dtype)
                spread[env_ids] = values
                changed[LAST_INFO] |= {name: spread, f"_{name}": ended.copy()}
        return {**infos, **changed}

    def _reported(self, infos: dict[str, Any], entries: Mapping[str, Batch], ended: BoolArray) -> dict[str, Any]:
        """The infos with what became of the actions; of an episode that ended, where Gymnasium has its last info."""
        acted = ~self._restarting
        if self.autoreset_mode is not AutoresetMode.SAME_STEP:
            return infos | _where(entries, acted)
        infos = infos | _where(entries, acted & ~ended)
        if ended.any():
            infos[LAST_INFO] = infos[LAST_INFO] | _where(entries, ended)
        return infos

    def _each_shown(self, observations: Sequence[Any], state: EnvState) -> list[Any]:
        """Observations (k) of single environments as this wrapper shows them."""
        transformation = self.transformation
        if not isinstance(transformation, Format):
            return _apart(self.single_observation_space, transformation.observations(_stacked(observations), state))
        new = transformation.new_values(_Stacked(observations), state)
        return [
            transformation.kept(observation) | {name: plain(values[place]) for name, values in new.items()}
            for place, observation in enumerate(observations)
        ]

    def __repr__(self) -> str:
        return f"<{self.name}, {self.env}>"


class VectorEnvState:
    """The `EnvState` of a batched or worker environment; it looks when asked."""

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        self._base: Any = env.unwrapped
        self._action_masks: Callable[[], BoolArray] = _reach(env, "action_masks")
        self._goal_reached: Callable[[], BoolArray] = _reach(env, "goal_reached")

    @property
    def task_numbers(self) -> Int64Array:
        return self._base.task_numbers

    @property
    def steps(self) -> Int64Array:
        return self._base.steps

    @property
    def items(self) -> Int16Array:
        return self._base.scene_array()

    def states(self) -> Sequence[State]:
        return self._base.states()

    def legal(self) -> BoolArray:
        return self._action_masks()

    def goal_reached(self) -> BoolArray:
        return self._goal_reached()


class FinalEnvState(StatesOf):
    """The `EnvState` at the end of episodes in autoreset mode SAME_STEP, when the environments are in the next ones."""

    def __init__(
        self,
        description: EnvDescription,
        env: Any,
        env_ids: Int64Array,
        beneath: Sequence[Transformation] | None = None,
    ) -> None:
        """`env_ids` (k,); `beneath`: transformations of the wrappers up to `env`, the innermost first, if known."""
        super().__init__(description)
        self._env = env
        self._env_ids = env_ids
        self._beneath = _transformations(env) if beneath is None else beneath

    @property
    def task_numbers(self) -> Int64Array:
        return self._env.unwrapped.last_task_numbers[self._env_ids]

    @property
    def steps(self) -> Int64Array:
        return self._env.unwrapped.last_steps[self._env_ids]

    @property
    def items(self) -> Int16Array:
        return self._env.unwrapped.last_scene_array()[self._env_ids]

    def states(self) -> Sequence[State]:
        """(k) the last states, made when first asked for."""
        if not self._states:
            tasks = [self._description.tasks[task] for task in self.task_numbers.tolist()]
            columns = zip(tasks, map(scene_of, self.items), self.steps.tolist(), strict=True)
            self._states = [State(*fields) for fields in columns]
        return self._states

    def legal(self) -> BoolArray:
        if not self._beneath:
            return super().legal()
        *deeper, top = self._beneath
        return top.legal(FinalEnvState(self._description, self._env, self._env_ids, deeper))


def _transformations(env: Any) -> list[Transformation]:
    """Those of a stack of wrappers, the innermost first."""
    found: list[Transformation] = []
    while isinstance(env, VectorWrapper):
        found += [env.transformation] if isinstance(env, VectorEnvWrapper) else []
        env = env.env
    return found[::-1]


class _Stacked(Mapping[str, Batch]):
    """Observations of single environments as a batch, each part stacked when it is asked for: images take long."""

    def __init__(self, observations: Sequence[Mapping[str, Any]]) -> None:
        self._observations = observations

    def __getitem__(self, name: str) -> Batch:
        return _stacked([observation[name] for observation in self._observations])

    def __iter__(self) -> Iterator[str]:
        return iter(self._observations[0])

    def __len__(self) -> int:
        return len(self._observations[0])


def _where(entries: Mapping[str, Batch], where: BoolArray) -> dict[str, Any]:
    """Entries (N,) as Gymnasium's infos have them: beside each a mask `_name` of where it holds."""
    values = {name: value * where for name, value in entries.items()}
    return values | {f"_{name}": where.copy() for name in entries}


def _stacked(values: Sequence[Any]) -> Batch:
    """Values of one space as a batch."""
    first = values[0]
    if isinstance(first, dict):
        return {name: _stacked([value[name] for value in values]) for name in first}
    return tuple(values) if isinstance(first, str) else np.stack(values)


def _apart(space: spaces.Space[Any], batch: Batch) -> list[Any]:
    """The values of `space` that the batch consists of."""
    if isinstance(space, spaces.Dict):
        parts = {name: _apart(part, batch[name]) for name, part in space.spaces.items()}
        return [dict(zip(parts, values, strict=True)) for values in zip(*parts.values(), strict=True)]
    return batch.tolist() if isinstance(space, spaces.Discrete) else list(batch)


def _batched(single: spaces.Space[Any], env: VectorEnv[Any, Any, Any]) -> spaces.Space[Any]:
    """The space of N observations. Unchanged parts stay those of `env`: a batched Text takes much room."""
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


def _reach(env: Any, name: str) -> Any:
    """The attribute of the outermost environment in the stack that has it itself."""
    while isinstance(env, VectorWrapper) and not hasattr(type(env), name):
        env = env.env
    return getattr(env, name)


def _description_of(env: VectorEnv[Any, Any, Any], name: str) -> EnvDescription:
    """What the wrapper called `name` sees of `env`. Raises WrongEnvironment when it is none of this package's."""
    base: Any = env.unwrapped
    if not hasattr(base, "scene_array"):
        raise WrongEnvironment(
            f"{name} wraps this package's own vector environments, such as gymnasium.make_vec(id, num_envs=64) gives,"
            f" not {env!r}; for others wrap each environment: gymnasium.make_vec(id, wrappers=[{name}], ...)"
        )
    return EnvDescription(name, base.tasks, base.dynamics, env.single_observation_space, env.single_action_space)
