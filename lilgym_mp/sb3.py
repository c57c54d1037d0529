"""Stable-Baselines3 `VecEnv`s: adapters of this package's vector environments, or SB3's own over single ones."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

try:
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecMonitor
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn
except ModuleNotFoundError as missing:
    from lilgym_mp.corpus.extras import install

    message = f"lilgym_mp.sb3 needs {missing.name}: {install('sb3')}"
    raise ModuleNotFoundError(message, name=missing.name) from missing

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.corpus.terminal import note_after
from lilgym_mp.envs import preload
from lilgym_mp.envs.checks import INSTEAD, checked_count, checked_options
from lilgym_mp.envs.masks import attribute, layers
from lilgym_mp.envs.observation import ARRAYS
from lilgym_mp.envs.single import RESET_OPTIONS
from lilgym_mp.scene.choices import choose

# Imported by a fork server, once, for all its processes.
PRELOADED = ["__main__", "lilgym_mp.envs.preload", "stable_baselines3.common.vec_env.subproc_vec_env"]
OF_STATES = ("state", "scene", "task")
SINGLE_NAMES = {name: f"single_{name}" for name in ("action_space", "observation_space")}  # names in the batch
OF_BATCHES = ("autoreset_mode", "closed", "copy", "np_random", "num_envs", "reset", "states", "step", "unwrapped")
METHODS_OF_EACH = ("action_masks", "goal_reached", "render")  # the batch's return one row per environment
SHARED_METHODS = ("encode_action", "decode_action", "evaluation_tasks")  # return the same for every environment

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
        """The option "task" holds for the next episode. Raises ValueError for other options."""
        if len(self._options) != self.num_envs:
            raise ValueError(f"options must be one dict or {self.num_envs}, not {len(self._options)}")
        tasks = [checked_options(options, RESET_OPTIONS).get("task") for options in self._options]
        seeds: Any = list(self._seeds)
        has_tasks = any(task is not None for task in tasks)
        observations, infos = self.venv.reset(seed=seeds, options={"task": tasks} if has_tasks else None)
        self.reset_infos = _rows(infos, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, terminated, truncated, infos = self.venv.step(self._actions)
        terminated = np.asarray(terminated)
        dones = terminated | np.asarray(truncated)
        pop = infos.pop if isinstance(infos, dict) else partial(_popped, infos)
        final_infos, final_obs = pop("final_info", {}), pop("final_obs", None)
        step_infos = _rows(infos, self.num_envs)
        final_rows = _rows(final_infos, self.num_envs) if final_infos else []
        for env_id in dones.nonzero()[0].tolist():
            new, info = step_infos[env_id], final_rows[env_id]
            if len(new) > 1:  # what the batch does not also report of the last episode is of a wrapper, of this step
                info |= {name: new.pop(name) for name in new.keys() - info.keys() - {"task"}}
            info["terminal_observation"] = final_obs[env_id]
            info["TimeLimit.truncated"] = not terminated.item(env_id)
            self.reset_infos[env_id], step_infos[env_id] = new, info
        return observations, np.asarray(rewards, np.float32), dones, step_infos

    def close(self) -> None:
        self.venv.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        frames = self.venv.render()
        return list(frames) if frames is not None else [None] * self.num_envs  # pyright: ignore[reportReturnType]

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Each environment's attribute, under the names of single environments, from whichever wrapper has it."""
        values = self._values(attr_name)
        return [values[env_id] for env_id in self._get_indices(indices)]

    def _values(self, name: str) -> Sequence[Any]:
        """(N,) the attribute of each environment. Raises AttributeError."""
        if name in OF_BATCHES:
            raise AttributeError(
                f"environments in a batch have no {name!r} of their own; that of the batch is venv.{name}"
            )
        if name in OF_STATES:
            states = attribute(self.venv, "states")()
            return states if name == "state" else [getattr(state, name) for state in states]
        value = attribute(self.venv, SINGLE_NAMES.get(name, name))
        if name in METHODS_OF_EACH:
            return [partial(self._call_one, name, env_id) for env_id in range(self.num_envs)]
        if name == "np_random_seed" or (isinstance(value, np.ndarray) and value.shape[:1] == (self.num_envs,)):
            return list(value)
        return [value] * self.num_envs

    def _call_one(self, name: str, env_id: int, *args: Any, **kwargs: Any) -> Any:
        return self._call_all(name, *args, **kwargs)[env_id]

    def _call_all(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """(N, ...) or a sequence (N,): what a method of the batch returns for each environment."""
        rows = attribute(self.venv, name)(*args, **kwargs)
        return [None] * self.num_envs if rows is None else rows

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Sets an attribute of the outermost wrapper that has it, for all environments.

        Raises AttributeError for some environments alone, and for attributes of the batch itself.
        """
        *wrappers, batch = layers(self.venv)
        if len(set(self._get_indices(indices))) < self.num_envs:
            raise AttributeError(f"cannot set {attr_name!r} of some environments in a batch alone; leave out indices")
        owner = next((wrapper for wrapper in wrappers if hasattr(wrapper, attr_name)), None)
        if owner is None or hasattr(batch, attr_name):
            raise AttributeError(f"cannot set {attr_name!r} of environments in a batch; pass it when making the batch")
        setattr(owner, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> Any:
        """What each environment's method returns; "action_masks" and "goal_reached": an array with one row per
        environment. Raises AttributeError naming the methods for others."""
        if method_name in METHODS_OF_EACH:
            rows = self._call_all(method_name, *method_args, **method_kwargs)
            if indices is None:
                return rows
            chosen = list(self._get_indices(indices))
            return rows[chosen] if isinstance(rows, np.ndarray) else [rows[env_id] for env_id in chosen]
        if method_name in SHARED_METHODS:
            methods = self.get_attr(method_name, indices)
            return [method(*method_args, **method_kwargs) for method in methods]
        names = ", ".join((*METHODS_OF_EACH, *SHARED_METHODS))
        raise AttributeError(f"environments in a batch have no method {method_name!r}; choose from {names}")

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Whether the batch is wrapped in it, or by the factory of that class."""
        found = any(
            wrapper_class in (type(layer), getattr(layer, "wrapper_class", None)) for layer in layers(self.venv)
        )
        return [found for _ in self._get_indices(indices)]


def _popped(rows: list[dict[str, Any]], name: str, default: Any) -> list[Any]:
    return [row.pop(name, default) for row in rows]


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


def _batched(id: str, n_envs: int, wrap: Wrap, options: Mapping[str, Any], kwargs: Mapping[str, Any]) -> VecEnv:
    return _adapted(gym.make_vec(id, num_envs=n_envs, autoreset_mode=AutoresetMode.SAME_STEP, **kwargs), wrap)


def _workers(id: str, n_envs: int, wrap: Wrap, options: Mapping[str, Any], kwargs: Mapping[str, Any]) -> VecEnv:
    from lilgym_mp.envs.workers import WorkerVectorEnv

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
    except (AssertionError, TypeError, ValueError) as error:
        if "autoreset_mode" in str(error):
            raise ValueError(
                f"{error}: SB3 needs mode SAME_STEP, which this wrapper does not support; use a factory of"
                ' lilgym_mp.wrappers, SB3\'s own wrappers such as VecNormalize, or backend="dummy"'
            ) from None
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
    if "forkserver" in multiprocessing.get_all_start_methods():
        multiprocessing.set_forkserver_preload(PRELOADED)
    with note_after(f'starting {n_envs} processes; backend="batched" needs none'):
        return SubprocVecEnv(makers, start_method=method)


def _dummy(id: str, n_envs: int, wrap: Wrap, options: Mapping[str, Any], kwargs: Mapping[str, Any]) -> VecEnv:
    return DummyVecEnv([partial(_make, id, wrap, kwargs)] * n_envs)


def _make(id: str, wrap: Wrap, kwargs: Mapping[str, Any]) -> gym.Env[Any, Any]:
    # Unpickling it by its name imports this module, and so registers the environments, in processes that have not.
    return wrap(gym.make(id, **kwargs))


Builder = Callable[[str, int, Wrap, Mapping[str, Any], Mapping[str, Any]], VecEnv]
BACKENDS: Mapping[str, tuple[Builder, tuple[str, ...]]] = {  # with the keywords of each alone
    "batched": (_batched, ()),
    "workers": (_workers, ("num_workers", "start_method")),
    "subproc": (_subproc, ("start_method",)),
    "dummy": (_dummy, ()),
}
SB3_INSTEAD = {  # of keywords of SB3's own `make_vec_env`, of `gymnasium.make_vec`, and of those that `VecEnv`s exclude
    "env_id": "use id",
    "num_envs": "use n_envs=N",
    "vectorization_mode": "use backend=...",
    "vector_kwargs": "use start_method=... or num_workers=...",
    "wrappers": "use wrap=WRAPPER",
    "env_kwargs": "give its entries as keywords, such as split=..., horizon=...",
    "wrapper_class": "use wrap=WRAPPER",
    "wrapper_kwargs": "use wrap=functools.partial(WRAPPER, ...)",
    "vec_env_cls": 'use backend="dummy" or backend="subproc"',
    "vec_env_kwargs": "use start_method=... or num_workers=...",
    "monitor_dir": "use monitor=False, and VecMonitor(make_vec_env(...), filename=PATH)",
    "monitor_kwargs": "use monitor=False, and VecMonitor(make_vec_env(...), ...)",
    "start_index": "use seed=SEED + START_INDEX",
    "autoreset_mode": "leave it out: SB3 needs SAME_STEP, which is used",
    "max_episode_steps": f"use {INSTEAD['max_episode_steps']}",
}


def _check_keywords(backend: str, keywords: Iterable[str]) -> None:
    """Raises TypeError naming what to use instead, for keywords of SB3's own function and of other backends."""
    for name in keywords:
        backends = [f'backend="{other}"' for other, (_, names) in BACKENDS.items() if name in names]
        if name in SB3_INSTEAD or (backends and f'backend="{backend}"' not in backends):
            advice = SB3_INSTEAD.get(name) or f"it belongs to {' or '.join(backends)}"
            raise TypeError(f"unknown keyword {name!r}; {advice}")
    if backend in ("subproc", "dummy") and "evaluation" in keywords:
        raise TypeError('evaluation=True belongs to batches; use backend="batched" or backend="workers"')


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
    Raises ValueError naming the value and the choices, TypeError naming what replaces a keyword of SB3's own function.
    """
    build, own_keywords = choose("backend", backend, BACKENDS)
    _check_keywords(backend, kwargs)
    options = {name: kwargs.pop(name) for name in own_keywords if name in kwargs}
    count = checked_count("n_envs", n_envs)
    kwargs = {"observation": ARRAYS, "vocabulary": vocabulary, "length": length, **kwargs}
    env = build(id, count, wrap or (lambda env: env), options, kwargs)
    if seed is not None:
        env.seed(seed)
    return VecMonitor(env) if monitor else env
