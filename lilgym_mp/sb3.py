"""Stable-Baselines3 `VecEnv`s: adapters of this package's vector environments, or SB3's own over single ones."""

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

try:
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecMonitor
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn
except ModuleNotFoundError as missing:
    from lilgym_mp.extras import install

    message = f"lilgym_mp.sb3 needs {missing.name}: {install('sb3')}"
    raise ModuleNotFoundError(message, name=missing.name) from missing

from lilgym_mp.arrays import BoolArray
from lilgym_mp.choices import choose
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.envs import preload
from lilgym_mp.envs.checks import checked_count
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.observation import ARRAYS
from lilgym_mp.terminal import note_after

# Imported by a fork server, once, for all its processes.
PRELOADED = ["__main__", "lilgym_mp.envs.preload", "stable_baselines3.common.vec_env.subproc_vec_env"]
VECTOR_METHODS = ("action_masks", "goal_reached")  # return one row per environment

Infos = Mapping[str, Any]  # Gymnasium's vector infos: arrays (N, ...), each with a mask `_name`
Wrap = Callable[[Any], Any]  # such as a factory of `lilgym_mp.wrappers`


class BatchVecEnv(VecEnv):
    """Adapts a vector environment of this package to `VecEnv`.

    Infos are those of the single environment, with "terminal_observation" and "TimeLimit.truncated" at the end of an
    episode. `env_method("action_masks")` is one call for all environments.
    """

    def __init__(self, venv: VectorEnv[Any, Any, Any]) -> None:
        """Raises ValueError unless the autoreset mode of `venv` is SAME_STEP, as SB3 expects."""
        mode = venv.metadata["autoreset_mode"]
        if mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f"SB3 needs autoreset_mode={AutoresetMode.SAME_STEP!r}, not {mode!r}")
        self.venv = venv
        self._actions = np.zeros(venv.num_envs, np.int64)
        super().__init__(venv.num_envs, venv.single_observation_space, venv.single_action_space)

    def reset(self) -> VecEnvObs:
        tasks = [options.get("task") for options in self._options]
        seeds: Any = list(self._seeds)
        observations, infos = self.venv.reset(seed=seeds, options={"task": tasks} if any(tasks) else None)
        self.reset_infos = [{} for _ in range(self.num_envs)]
        _split_infos(infos, self.reset_infos)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, terminated, truncated, infos = self.venv.step(self._actions)
        dones = terminated | truncated
        step_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if infos:
            self._convert_infos(infos, step_infos, dones, truncated & ~terminated)
        return observations, rewards.astype(np.float32), dones, step_infos

    def _convert_infos(
        self, infos: dict[str, Any], step_infos: list[dict[str, Any]], dones: BoolArray, only_truncated: BoolArray
    ) -> None:
        """Fills `step_infos` (N) from this step's infos, and `reset_infos` of environments that were reset."""
        final_info, final_obs = infos.pop("final_info", {}), infos.pop("final_obs", None)
        ended = dones.nonzero()[0].tolist()
        current = step_infos.copy()
        for env_id in ended:
            current[env_id] = self.reset_infos[env_id] = {}
        _split_infos(infos, current)
        _split_infos(final_info, step_infos)
        for env_id in ended:
            step_infos[env_id]["terminal_observation"] = final_obs[env_id]
            step_infos[env_id]["TimeLimit.truncated"] = only_truncated.item(env_id)

    def close(self) -> None:
        self.venv.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        frames = self.venv.render()
        return list(frames) if frames is not None else [None] * self.num_envs  # pyright: ignore[reportReturnType]

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The vector environment's attribute, repeated for each environment."""
        return [getattr(self.venv, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        raise AttributeError(f"cannot set {attr_name!r} of environments in a batch; pass it when making the batch")

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> Any:
        """Supports "action_masks" and "goal_reached"; returns an array with one row per environment."""
        if method_name not in VECTOR_METHODS:
            raise AttributeError(
                f"environments in a batch have no method {method_name!r}; choose from {', '.join(VECTOR_METHODS)}"
            )
        rows = getattr(self.venv, method_name)(*method_args, **method_kwargs)
        return rows if indices is None else rows[list(self._get_indices(indices))]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """False, since wrappers are applied to the whole batch."""
        return [False for _ in self._get_indices(indices)]


def _split_infos(infos: Infos, rows: Sequence[dict[str, Any]]) -> None:
    """Splits vector infos into one dict per environment, converting NumPy scalars to Python numbers."""
    for name, column in infos.items():
        if (mask := infos.get(f"_{name}")) is None:
            continue
        value = column.item if column.ndim == 1 else column.__getitem__
        for env_id in mask.nonzero()[0].tolist():
            rows[env_id][name] = value(env_id)


def _batched(id: str, n_envs: int, wrap: Wrap, options: Mapping[str, Any], kwargs: Mapping[str, Any]) -> VecEnv:
    return _adapted(gym.make_vec(id, num_envs=n_envs, autoreset_mode=AutoresetMode.SAME_STEP, **kwargs), wrap)


def _workers(id: str, n_envs: int, wrap: Wrap, options: Mapping[str, Any], kwargs: Mapping[str, Any]) -> VecEnv:
    return _adapted(WorkerVectorEnv(id, n_envs, autoreset_mode=AutoresetMode.SAME_STEP, **options, **kwargs), wrap)


def _adapted(venv: VectorEnv[Any, Any, Any], wrap: Wrap) -> BatchVecEnv:
    """Wraps `venv`; closes it, including its processes, on failure."""
    try:
        return BatchVecEnv(_wrapped(venv, wrap))
    except BaseException:
        venv.close()
        raise


def _wrapped(venv: VectorEnv[Any, Any, Any], wrap: Wrap) -> VectorEnv[Any, Any, Any]:
    """Raises ValueError naming the remedies for a wrapper of single environments."""
    try:
        wrapped = wrap(venv)
    except (AssertionError, TypeError) as error:
        if "gymnasium.Env" not in str(error):  # the message of Gymnasium's own wrappers
            raise
        wrapped = None
    if not isinstance(wrapped, VectorEnv):
        raise ValueError(
            "this backend applies wrap to a whole batch, which it does not accept: use a factory of lilgym_mp.wrappers"
            ' or a wrapper of gymnasium.wrappers.vector, or backend="subproc" or "dummy", which wrap each environment'
        ) from None
    return wrapped


def _subproc(id: str, n_envs: int, wrap: Wrap, options: Mapping[str, Any], kwargs: Mapping[str, Any]) -> VecEnv:
    makers = [partial(_make, id, wrap, kwargs)] * n_envs
    first = makers[0]()  # fails here with a clear error, whereas SB3's processes would just break the pipe
    origin = first.unwrapped.tasks.provenance  # pyright: ignore[reportAttributeAccessIssue]
    first.close()
    method = options.get("start_method")
    if method == "fork":
        return SubprocVecEnv(makers, start_method=method)
    os.environ[preload.VARIABLE] = json.dumps([origin.corpus, origin.appearance, origin.start, origin.split])
    multiprocessing.set_forkserver_preload(PRELOADED)
    with note_after(f'starting {n_envs} processes; backend="batched" needs none'):
        return SubprocVecEnv(makers, start_method=method)


def _dummy(id: str, n_envs: int, wrap: Wrap, options: Mapping[str, Any], kwargs: Mapping[str, Any]) -> VecEnv:
    return DummyVecEnv([partial(_make, id, wrap, kwargs)] * n_envs)


def _make(id: str, wrap: Wrap, kwargs: Mapping[str, Any]) -> gym.Env[Any, Any]:
    # Unpickling it by its name imports this module, and so registers the environments, in processes that have not.
    return wrap(gym.make(id, **kwargs))


Builder = Callable[[str, int, Wrap, Mapping[str, Any], Mapping[str, Any]], VecEnv]
BACKENDS: Mapping[str, Builder] = {"batched": _batched, "workers": _workers, "subproc": _subproc, "dummy": _dummy}
BACKEND_OPTIONS: Mapping[str, tuple[str, ...]] = {
    "batched": (),
    "workers": ("num_workers", "start_method"),
    "subproc": ("start_method",),
    "dummy": (),
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
    **kwargs: Any,
) -> VecEnv:
    """`n_envs` environments as a `VecEnv`, with observations as arrays (SB3 does not support text): the spaces are
    those of `gym.make(id, observation="arrays")`.

    `backend`: "batched", all in this process (usually the fastest); "workers", a few processes with a batch each
    (`num_workers`, `start_method` as for `WorkerVectorEnv`); "subproc" and "dummy", SB3's own over single environments
    (`start_method` for "subproc"). All give equal results: environment i is seeded with `seed` + i.
    `wrap`: a wrapper to apply, such as `lilgym_mp.wrappers.stop_forcing_v0`, to the batch, or to each environment with
    SB3's own backends. `vocabulary`, `length`: as for `gym.make`. `monitor`: report episode returns and
    lengths, as SB3's `make_vec_env` does. Other keywords are those of `gymnasium.make`.
    Raises ValueError naming the value and the choices.
    """
    build = choose("backend", backend, BACKENDS)
    options = {name: kwargs.pop(name) for name in BACKEND_OPTIONS[backend] if name in kwargs}
    count = checked_count("n_envs", n_envs)
    kwargs = {"observation": ARRAYS, "vocabulary": vocabulary, "length": length, **kwargs}
    env = build(id, count, wrap or (lambda env: env), options, kwargs)
    if seed is not None:
        env.seed(seed)
    return VecMonitor(env) if monitor else env
