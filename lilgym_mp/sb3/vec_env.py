"""Stable-Baselines3 `VecEnv`s: an adapter of this package's vector environments, or SB3's own over single ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.wrappers.vector import DictInfoToList
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from lilgym_mp.corpus.notes import note_after
from lilgym_mp.envs.checks import checked_options
from lilgym_mp.envs.interface import RESET_OPTIONS
from lilgym_mp.envs.keywords import SB3_INSTEAD, check_keywords
from lilgym_mp.envs.masks import attribute, layers, set_wrapper_attribute
from lilgym_mp.envs.observation import ARRAYS, row_of
from lilgym_mp.envs.preload import preloading
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.learning.common.statement_sampler import StatementSampler
from lilgym_mp.scene.arrays import AnyDict
from lilgym_mp.scene.choices import checked_count, choose
from lilgym_mp.wrappers import stop_forcing_v0
from lilgym_mp.wrappers.transformation import WrongEnvironment, to_python

OF_BATCHES = ("autoreset_mode", "closed", "copy", "np_random", "num_envs", "reset", "states", "step", "unwrapped")
BATCH_KEYWORDS = {"autoreset_mode", "copy", "evaluation", "num_envs", "vectorization_mode"}  # in the spec of a batch
METHODS_OF_EACH = ("action_masks", "goal_reached", "render")  # the batch's return one row per environment
METHODS = (*METHODS_OF_EACH, "encode_action", "decode_action", "evaluation_tasks")

DRAWN = {"same_statement": 1, "recolour": False, "empty_starts": 0.0}  # defaults of what makes a StatementSampler

Wrap = Callable[[Any], Any]  # such as a factory of `lilgym_mp.wrappers`


class BatchVecEnv(VecEnv):
    """Adapts a vector environment of this package to `VecEnv`. Infos are those of the single environment, with
    "terminal_observation" and "TimeLimit.truncated" at the end of an episode."""

    def __init__(self, venv: VectorEnv[Any, Any, Any]) -> None:
        """Raises ValueError for observations with text, and unless the autoreset mode of `venv` is DISABLED: this class
        resets, as SB3 expects."""
        mode = venv.metadata["autoreset_mode"]
        if mode is not AutoresetMode.DISABLED:
            raise ValueError(f"BatchVecEnv needs autoreset_mode={AutoresetMode.DISABLED!r}, not {mode!r}")
        space = venv.single_observation_space
        if any(isinstance(part, spaces.Text) for part in getattr(space, "spaces", {"": space}).values()):
            raise ValueError('Stable-Baselines3 has no Text spaces; use observation="arrays" and no text wrapper')
        self.venv = venv
        self._lists: Any = venv if isinstance(venv, DictInfoToList) else DictInfoToList(venv)  # one info for each
        super().__init__(venv.num_envs, venv.single_observation_space, venv.single_action_space)
        self.metadata = venv.metadata  # a recorder reads "render_fps"

    def reset(self) -> VecEnvObs:
        """The option "task" holds for the next episode. Raises ValueError for other options."""
        tasks = [checked_options(options, RESET_OPTIONS).get("task") for options in self._options]
        observations, self.reset_infos = self._lists.reset(seed=self._seeds, options={"task": tasks})
        self._reset_seeds()
        self._reset_options()
        return deepcopy(observations)  # the batch draws over its images

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, terminated, truncated, rows = self._lists.step(self._actions)
        infos = [{name: to_python(value) for name, value in row.items()} for row in rows]
        dones = np.logical_or(terminated, truncated)
        if len(env_ids := dones.nonzero()[0]):
            last = row_of(observations, env_ids)
            observations, new = self._lists.reset(options={"reset_mask": dones})
            for index, env_id in enumerate(env_ids.tolist()):
                infos[env_id]["terminal_observation"] = row_of(last, index)
                infos[env_id]["TimeLimit.truncated"] = not terminated[env_id]
                self.reset_infos[env_id] = new[env_id]
        return deepcopy(observations), np.asarray(rewards, np.float32), dones, infos

    def close(self) -> None:
        self.venv.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        return self.env_method("render")

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Each environment's attribute, under the names of single environments, from whichever wrapper has it."""
        env_ids = self._get_indices(indices)
        if attr_name in ("state", "scene", "task"):
            states = attribute(self.venv, "states")()
            return [states[i] if attr_name == "state" else getattr(states[i], attr_name) for i in env_ids]
        if attr_name in METHODS_OF_EACH:
            return [lambda env_id=env_id: self.env_method(attr_name, indices=env_id)[0] for env_id in env_ids]
        if attr_name in OF_BATCHES:
            raise AttributeError(f"environments in a batch have no {attr_name!r} of their own; see venv.{attr_name}")
        value = attribute(self.venv, f"single_{attr_name}" if attr_name.endswith("_space") else attr_name)
        if attr_name == "spec":
            kwargs = {name: given for name, given in value.kwargs.items() if name not in BATCH_KEYWORDS}
            return [replace(value, kwargs=kwargs) for _ in env_ids]
        is_column = attr_name == "np_random_seed" or (isinstance(value, np.ndarray) and len(value) == self.num_envs)
        values = [value[env_id] if is_column else value for env_id in env_ids]
        return [each.item() if isinstance(each, np.generic) else each for each in values]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        if len(set(self._get_indices(indices))) < self.num_envs:
            raise AttributeError(f"cannot set {attr_name!r} of some environments in a batch alone; leave out indices")
        set_wrapper_attribute(self.venv, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> Any:
        """What each environment's method returns; "action_masks" and "goal_reached": an array with one row per
        environment. Raises AttributeError naming the methods for others."""
        if method_name not in METHODS:
            raise AttributeError(f"a batch has no method {method_name!r}; choose from {', '.join(METHODS)}")
        result = attribute(self.venv, method_name)(*args, **kwargs)
        if method_name not in METHODS_OF_EACH or result is None:  # None: rendered without a mode
            result = [result] * self.num_envs
        env_ids = list(self._get_indices(indices))
        return result[env_ids] if isinstance(result, np.ndarray) else [result[env_id] for env_id in env_ids]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Whether the batch is wrapped in it, or by the factory of that class."""
        classes = {kind for layer in layers(self.venv) for kind in (type(layer), getattr(layer, "wrapper_class", None))}
        return [wrapper_class in classes for _ in self._get_indices(indices)]


def _batch(make: Callable[..., Any], id: str, n_envs: int, wrap: Wrap, kwargs: AnyDict) -> BatchVecEnv:
    """Raises ValueError naming the remedies for a wrapper of single environments."""
    venv = make(id, num_envs=n_envs, autoreset_mode=AutoresetMode.DISABLED, copy=False, **kwargs)
    try:
        return BatchVecEnv(wrap(venv))
    except BaseException as error:
        venv.close()  # including its processes
        if isinstance(error, WrongEnvironment) or not isinstance(error, AssertionError | AttributeError | TypeError):
            raise
        remedies = 'a factory of lilgym_mp.wrappers, or backend="subproc" or "dummy", which wrap each environment'
        raise ValueError(f"wrap must accept a batch ({error}); use {remedies}") from None


def _subproc(id: str, n_envs: int, wrap: Wrap, kwargs: AnyDict) -> SubprocVecEnv:
    start_method = kwargs.pop("start_method", None)
    first = _make(id, wrap, kwargs)  # fails here with a clear error, whereas SB3's processes would break the pipe
    tasks = first.get_wrapper_attr("tasks")
    first.close()
    note = note_after(f'starting {n_envs} processes; backend="batched" needs none')
    with note, preloading(tasks, "stable_baselines3.common.vec_env.subproc_vec_env"):
        return SubprocVecEnv([partial(_make, id, wrap, kwargs)] * n_envs, start_method=start_method)


def _make(id: str, wrap: Wrap, kwargs: AnyDict) -> gym.Env[Any, Any]:
    return wrap(gym.make(id, **kwargs))


BACKENDS: Mapping[str, Callable[[str, int, Wrap, AnyDict], VecEnv]] = {
    "batched": partial(_batch, gym.make_vec),
    "workers": partial(_batch, WorkerVectorEnv),
    "subproc": _subproc,
    "dummy": lambda id, n_envs, wrap, kwargs: DummyVecEnv([partial(_make, id, wrap, kwargs)] * n_envs),
}


def make_vec_env(
    id: str,
    n_envs: int = 1,
    backend: str = "batched",
    *,
    seed: int | None = None,
    wrap: Wrap | None = None,
    monitor: bool = True,
    same_statement: int = 1,
    statement_episodes: int = 2,
    recolour: bool = False,
    empty_starts: float = 0.0,
    stop_forcing: bool = False,
    **kwargs: Any,
) -> VecEnv:
    """Environments as a `VecEnv`, with the spaces of `gym.make(id, observation="arrays")`.

    All backends give equal results: environment i is seeded with `seed` + i.

    Args:
        id: Such as "lilgym_mp/TowerScratch-v0".
        n_envs: The number of environments.
        backend: "batched", all in this process (usually the fastest); "workers", a few processes with a batch each
            (`num_workers`, `start_method` as for `WorkerVectorEnv`); "subproc" and "dummy", SB3's own over single
            environments (`start_method` for "subproc").
        seed: Seed of the first environment.
        wrap: Such as `lilgym_mp.wrappers.structured_observation_v0`, applied to the batch, or to each environment with
            SB3's own backends.
        monitor: Report episode returns and lengths, as SB3's `make_vec_env` does.
        same_statement: Draws training tasks as `StatementSampler` does, like the next three.
        statement_episodes: As for `StatementSampler`.
        recolour: As for `StatementSampler`.
        empty_starts: As for `StatementSampler`.
        stop_forcing: Add "forced" to observations, whether STOP succeeds now: there `LilGymPolicy` takes STOP.
        kwargs: Other keywords of `gymnasium.make`.

    Returns:
        The environments.

    Raises:
        ValueError: For an invalid value; the message names the choices.
        TypeError: For an unknown keyword.
    """
    check_keywords(kwargs.keys() & SB3_INSTEAD, (), SB3_INSTEAD)
    build = choose("backend", backend, BACKENDS)
    drawn = {"same_statement": same_statement, "recolour": recolour, "empty_starts": empty_starts}
    given = [f"{name}={value!r}" for name, value in drawn.items() if value != DRAWN[name]]
    if kwargs.get("evaluation") and backend in ("subproc", "dummy"):
        raise TypeError(
            f'evaluation=True needs backend="batched" or backend="workers", as it belongs to batches, not'
            f" backend={backend!r}"
        )
    if kwargs.get("evaluation") and given:
        raise ValueError(
            f'evaluation=True (with backend="batched" or "workers") plays every task of the split once; leave out'
            f" {', '.join(given)}"
        )
    if given:
        if "sampler" in kwargs:
            raise ValueError("same_statement, recolour and empty_starts make a sampler; leave out sampler")
        if same_statement != 1 and backend in ("subproc", "dummy"):
            raise ValueError(f'same_statement={same_statement} needs backend="batched" or backend="workers"')
        sampling: Any = drawn
        corpus = kwargs.get("corpus", "builtin")
        kwargs["sampler"] = StatementSampler(id, corpus, statement_episodes=statement_episodes, **sampling)
    outer = wrap or (lambda env: env)
    whole = (lambda env: stop_forcing_v0(outer(env), mode="observe")) if stop_forcing else outer
    env = build(id, checked_count("n_envs", n_envs), whole, {"observation": ARRAYS, **kwargs})
    if seed is not None:
        env.seed(seed)
    return VecMonitor(env) if monitor else env
