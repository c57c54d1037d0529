"""Stable-Baselines3 `VecEnv`s: an adapter of this package's vector environments, or SB3's own over single ones."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.corpus.notes import note_after
from lilgym_mp.envs import preload
from lilgym_mp.envs.checks import checked_count, checked_options
from lilgym_mp.envs.masks import attribute, layers
from lilgym_mp.envs.observation import ARRAYS
from lilgym_mp.envs.single import RESET_OPTIONS
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.learning.common.statement_sampler import StatementSampler
from lilgym_mp.scene.choices import choose
from lilgym_mp.wrappers import stop_forcing_v0

# Imported by a fork server, once, for all its processes.
PRELOADED = ["__main__", "lilgym_mp.envs.preload", "stable_baselines3.common.vec_env.subproc_vec_env"]
OF_STATES = ("state", "scene", "task")
SINGLE_NAMES = {name: f"single_{name}" for name in ("action_space", "observation_space")}  # names in the batch
METHODS_OF_EACH = ("action_masks", "goal_reached", "render")  # the batch's return one row per environment
METHODS = (*METHODS_OF_EACH, "encode_action", "decode_action", "evaluation_tasks")

Wrap = Callable[[Any], Any]  # such as a factory of `lilgym_mp.wrappers`


class BatchVecEnv(VecEnv):
    """Adapts a vector environment of this package to `VecEnv`.

    Infos are those of the single environment, with "terminal_observation" and "TimeLimit.truncated" at the end of an
    episode. `env_method("action_masks")` is one call for all environments.
    """

    def __init__(self, venv: VectorEnv[Any, Any, Any]) -> None:
        """Raises ValueError unless the autoreset mode of `venv` is DISABLED: this class resets, as SB3 expects."""
        mode = venv.metadata["autoreset_mode"]
        if mode is not AutoresetMode.DISABLED:
            raise ValueError(f"BatchVecEnv needs autoreset_mode={AutoresetMode.DISABLED!r}, not {mode!r}")
        self.venv = venv
        self._actions = np.zeros(venv.num_envs, np.int64)
        super().__init__(venv.num_envs, venv.single_observation_space, venv.single_action_space)

    def reset(self) -> VecEnvObs:
        """The option "task" holds for the next episode. Raises ValueError for other options."""
        tasks = [checked_options(options, RESET_OPTIONS).get("task") for options in self._options]
        seeds: Any = list(self._seeds)
        observations, infos = self.venv.reset(seed=seeds, options={"task": tasks})
        self.reset_infos = _rows(infos, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return _changed(observations, _owned)

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, terminated, truncated, infos = self.venv.step(self._actions)
        dones = np.logical_or(terminated, truncated)
        rows = _rows(infos, self.num_envs)
        env_ids = dones.nonzero()[0].tolist()
        for env_id in env_ids:
            rows[env_id]["terminal_observation"] = _changed(observations, partial(_row, env_id))
            rows[env_id]["TimeLimit.truncated"] = not terminated[env_id]
        if env_ids:
            observations, infos = self.venv.reset(options={"reset_mask": dones})
            new = _rows(infos, self.num_envs)
            for env_id in env_ids:
                self.reset_infos[env_id] = new[env_id]
        return _changed(observations, _owned), np.asarray(rewards, np.float32), dones, rows

    def close(self) -> None:
        self.venv.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        return self.env_method("render")

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Each environment's attribute, under the names of single environments, from whichever wrapper has it."""
        env_ids = self._get_indices(indices)
        if attr_name in OF_STATES:
            states = attribute(self.venv, "states")()
            return [states[i] if attr_name == "state" else getattr(states[i], attr_name) for i in env_ids]
        if attr_name in METHODS_OF_EACH:
            return [lambda env_id=env_id: self.env_method(attr_name, indices=env_id)[0] for env_id in env_ids]
        value = attribute(self.venv, SINGLE_NAMES.get(attr_name, attr_name))
        is_column = attr_name == "np_random_seed" or (isinstance(value, np.ndarray) and len(value) == self.num_envs)
        return [value[env_id] if is_column else value for env_id in env_ids]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Sets an attribute of the outermost wrapper that has it. Raises AttributeError for those of the batch itself,
        and for some environments alone."""
        *wrappers, batch = layers(self.venv)
        owners = [wrapper for wrapper in wrappers if hasattr(wrapper, attr_name) and not hasattr(batch, attr_name)]
        if not owners or len(set(self._get_indices(indices))) < self.num_envs:
            raise AttributeError(f"cannot set {attr_name!r}: only attributes of wrappers, for all environments at once")
        setattr(owners[0], attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> Any:
        """What each environment's method returns; "action_masks" and "goal_reached": an array with one row per
        environment. Raises AttributeError naming the methods for others."""
        if method_name not in METHODS:
            raise AttributeError(
                f"environments in a batch have no method {method_name!r}; choose from {', '.join(METHODS)}"
            )
        result = attribute(self.venv, method_name)(*method_args, **method_kwargs)
        if method_name not in METHODS_OF_EACH or result is None:  # None: rendered without a mode
            result = [result] * self.num_envs
        if indices is None:
            return result
        env_ids = list(self._get_indices(indices))
        return result[env_ids] if isinstance(result, np.ndarray) else [result[env_id] for env_id in env_ids]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Whether the batch is wrapped in it, or by the factory of that class."""
        classes = {kind for layer in layers(self.venv) for kind in (type(layer), getattr(layer, "wrapper_class", None))}
        return [wrapper_class in classes for _ in self._get_indices(indices)]


def _changed(observations: Any, change: Callable[[np.ndarray], np.ndarray]) -> Any:
    """The observations with a function applied to each array."""
    if isinstance(observations, dict):
        return {name: change(values) for name, values in observations.items()}
    return change(observations)


def _owned(values: np.ndarray) -> np.ndarray:
    """A copy of images, the only uint8 arrays, which the batch draws over."""
    return values.copy() if values.dtype == np.uint8 else values


def _row(env_id: int, values: np.ndarray) -> np.ndarray:
    return values[env_id].copy()


def _rows(infos: Any, count: int) -> list[dict[str, Any]]:
    """Vector infos, nested or not, as one dict per environment with Python numbers; lists are returned unchanged."""
    if isinstance(infos, list):  # by Gymnasium's DictInfoToList
        return infos
    rows: list[dict[str, Any]] = [{} for _ in range(count)]
    for name, column in infos.items():
        if name.startswith("_"):
            continue
        has = infos.get(f"_{name}")
        values: Any = _rows(column, count) if isinstance(column, dict) else column
        value = values.item if getattr(values, "ndim", 0) == 1 else values.__getitem__
        for env_id in range(count) if has is None else has.nonzero()[0].tolist():
            rows[env_id][name] = value(env_id)
    return rows


def _batch(make: Callable[..., Any], id: str, n_envs: int, wrap: Wrap, kwargs: Mapping[str, Any]) -> VecEnv:
    """Raises ValueError naming the remedies for a wrapper of single environments."""
    venv = make(id, num_envs=n_envs, autoreset_mode=AutoresetMode.DISABLED, copy=False, **kwargs)
    try:
        return BatchVecEnv(wrap(venv))
    except BaseException as error:
        venv.close()  # including its processes
        if not isinstance(error, AssertionError | TypeError | AttributeError):
            raise
        raise ValueError(
            f"wrap must accept a batch ({error}); use a factory of lilgym_mp.wrappers or a wrapper of"
            ' gymnasium.wrappers.vector, or backend="subproc" or "dummy", which wrap each environment'
        ) from None


def _subproc(
    id: str, n_envs: int, wrap: Wrap, kwargs: Mapping[str, Any], start_method: str | None = None
) -> SubprocVecEnv:
    first = _make(id, wrap, kwargs)  # fails here with a clear error, whereas SB3's processes would break the pipe
    origin = first.unwrapped.tasks.provenance  # pyright: ignore[reportAttributeAccessIssue]
    first.close()
    if start_method != "fork":
        os.environ[preload.VARIABLE] = json.dumps([origin.corpus, origin.appearance, origin.start, origin.split])
        if "forkserver" in multiprocessing.get_all_start_methods():
            multiprocessing.set_forkserver_preload(PRELOADED)
    with note_after(f'starting {n_envs} processes; backend="batched" needs none'):
        return SubprocVecEnv([partial(_make, id, wrap, kwargs)] * n_envs, start_method=start_method)


def _dummy(id: str, n_envs: int, wrap: Wrap, kwargs: Mapping[str, Any]) -> DummyVecEnv:
    return DummyVecEnv([partial(_make, id, wrap, kwargs)] * n_envs)


def _make(id: str, wrap: Wrap, kwargs: Mapping[str, Any]) -> gym.Env[Any, Any]:
    # Unpickling it by its name imports this module, and so registers the environments, in processes that have not.
    return wrap(gym.make(id, **kwargs))


BACKENDS: Mapping[str, Callable[..., VecEnv]] = {
    "batched": partial(_batch, gym.make_vec),
    "workers": partial(_batch, WorkerVectorEnv),
    "subproc": _subproc,
    "dummy": _dummy,
}
INSTEAD = {  # of keywords of SB3's own `make_vec_env`
    "env_id": "id",
    "env_kwargs": "its entries as keywords, such as split=..., horizon=...",
    **dict.fromkeys(("wrapper_class", "wrapper_kwargs"), "wrap=WRAPPER"),
    **dict.fromkeys(("vec_env_cls", "vec_env_kwargs"), "backend=..., start_method=... or num_workers=..."),
    **dict.fromkeys(("monitor_dir", "monitor_kwargs"), "monitor=False, and VecMonitor(make_vec_env(...), ...)"),
}


def make_vec_env(
    id: str,
    n_envs: int = 1,
    backend: str = "batched",
    *,
    seed: int | None = None,
    wrap: Wrap | None = None,
    vocabulary: Vocabulary | str | os.PathLike[str] | None = None,
    length: int | None = None,
    monitor: bool = True,
    same_statement: int = 1,
    recolour: bool = False,
    empty_starts: float = 0.0,
    stop_forcing: bool = False,
    **kwargs: Any,
) -> VecEnv:
    """`n_envs` environments as a `VecEnv`, with observations as arrays (SB3 does not support text): the spaces are
    those of `gym.make(id, observation="arrays")`.

    `backend`: "batched", all in this process (usually the fastest); "workers", a few processes with a batch each
    (`num_workers`, `start_method` as for `WorkerVectorEnv`); "subproc" and "dummy", SB3's own over single environments
    (`start_method` for "subproc"). All give equal results: environment i is seeded with `seed` + i.
    `wrap`: a wrapper to apply, such as `lilgym_mp.wrappers.structured_observation_v0`, to the batch, or to each
    environment with SB3's own backends. `monitor`: report episode returns and lengths, as SB3's `make_vec_env` does.
    `same_statement`, `recolour`, `empty_starts`: draw training tasks as `StatementSampler` does. `stop_forcing`: add
    "forced" to observations, whether STOP succeeds now: there `LilGymPolicy` takes STOP, and learns from it.
    Other keywords are those of `gymnasium.make`.
    Raises ValueError naming the value and the choices, TypeError naming what replaces a keyword of SB3's own function.
    """
    build = choose("backend", backend, BACKENDS)
    for name in kwargs.keys() & INSTEAD:
        raise TypeError(f"unknown keyword {name!r}; use {INSTEAD[name]}")
    if same_statement != 1 or recolour or empty_starts:
        if "sampler" in kwargs or kwargs.get("split", "train") != "train":
            raise ValueError("same_statement, recolour and empty_starts draw training tasks: leave out sampler, split")
        if same_statement != 1 and backend in ("subproc", "dummy"):
            raise ValueError(f'same_statement={same_statement} needs backend="batched" or backend="workers"')
        sampling: Any = {"same_statement": same_statement, "recolour": recolour, "empty_starts": empty_starts}
        kwargs["sampler"] = StatementSampler(id, kwargs.get("corpus", "builtin"), **sampling)
    own = {name: kwargs.pop(name) for name in ("start_method",) if name in kwargs and backend == "subproc"}
    outer = wrap or (lambda env: env)
    whole = (lambda env: outer(stop_forcing_v0(env, mode="observe"))) if stop_forcing else outer
    kwargs = {"observation": ARRAYS, "vocabulary": vocabulary, "length": length, **kwargs}
    env = build(id, checked_count("n_envs", n_envs), whole, kwargs, **own)
    if seed is not None:
        env.seed(seed)
    return VecMonitor(env) if monitor else env
