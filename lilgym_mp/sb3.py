"""The environments as Stable-Baselines3's `VecEnv`: ours stepped as one batch, or SB3's own around single ones."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
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
from lilgym_mp.envs.workers import AUTO, WorkerVectorEnv
from lilgym_mp.wrappers import tokenized_statement_v0

STATEMENT = "statement"  # the observation's part that SB3 takes as token ids only
VECTOR_METHODS = ("action_masks", "goal_reached")  # give one row for each environment

Infos = Mapping[str, Any]  # as vector environments give them: arrays (N, ...), and masks `_name` of where they hold
Wrap = Callable[[Any], Any]  # such as the factories of `lilgym_mp.wrappers`


class BatchVecEnv(VecEnv):
    """A vector environment of this package as a `VecEnv`.

    Infos hold what the single environment tells, and at the end of an episode "terminal_observation" and
    "TimeLimit.truncated". `env_method("action_masks")` is one call for all environments.
    """

    def __init__(self, venv: VectorEnv[Any, Any, Any]) -> None:
        """Raises ValueError unless `venv` resets in the same step, which is what SB3 expects."""
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
        _spread(infos, self.reset_infos)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, terminated, truncated, infos = self.venv.step(self._actions)
        dones = terminated | truncated
        told: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if infos:
            self._tell(told, infos, dones, truncated & ~terminated)
        return observations, rewards.astype(np.float32), dones, told

    def _tell(self, told: list[dict[str, Any]], infos: dict[str, Any], dones: BoolArray, cut_off: BoolArray) -> None:
        """Gives `told`, (N,), what infos say of this step, and `reset_infos` what they say of episodes just begun."""
        final_info, last = infos.pop("final_info", {}), infos.pop("final_obs", None)
        ended = dones.nonzero()[0]
        now = told.copy()
        for number in ended.tolist():
            now[number] = self.reset_infos[number] = {}
        _spread(infos, now)
        _spread(final_info, told)
        for number in ended.tolist():
            told[number]["terminal_observation"] = last[number]
            told[number]["TimeLimit.truncated"] = cut_off.item(number)

    def close(self) -> None:
        self.venv.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        frames = self.venv.render()
        return list(frames) if frames is not None else [None] * self.num_envs  # pyright: ignore[reportReturnType]

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The batch's attribute, once for each environment."""
        return [getattr(self.venv, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        raise AttributeError(f"cannot set {attr_name!r} of environments in a batch; make the batch with it")

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> Any:
        """For "action_masks" and "goal_reached" an array with a row for each environment."""
        if method_name not in VECTOR_METHODS:
            raise AttributeError(
                f"environments in a batch have no method {method_name!r} of their own;"
                f" choose from {', '.join(VECTOR_METHODS)}"
            )
        rows = getattr(self.venv, method_name)(*method_args, **method_kwargs)
        return rows if indices is None else rows[list(self._get_indices(indices))]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """False: what is wrapped is the batch."""
        return [False for _ in self._get_indices(indices)]


class BatchMonitor(VecMonitor):
    """SB3's `VecMonitor`, telling the same, but looking only at the environments whose episode ended."""

    def __init__(self, venv: BatchVecEnv) -> None:
        super().__init__(venv)

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, dones, infos = self.venv.step_wait()
        self.episode_returns += rewards
        self.episode_lengths += 1
        ended = dones.nonzero()[0].tolist()
        if ended:
            returns, lengths = self.episode_returns, self.episode_lengths
            seconds = round(time.time() - self.t_start, 6)
            for number in ended:
                infos[number]["episode"] = {"r": returns[number], "l": lengths[number], "t": seconds}
                returns[number] = lengths[number] = 0
            self.episode_count += len(ended)
        return observations, rewards, dones, infos


def _spread(infos: Infos, rows: Sequence[dict[str, Any]]) -> None:
    """Gives each environment's row what the arrays (N, ...) of `infos` hold for it, NumPy's numbers as Python's."""
    for name, column in infos.items():
        if (holds := infos.get(f"_{name}")) is None:
            continue
        value = column.item if column.ndim == 1 else column.__getitem__
        for number in holds.nonzero()[0].tolist():
            rows[number][name] = value(number)


def _batched(id: str, n_envs: int, wrap: Wrap, options: Mapping[str, Any], kwargs: Mapping[str, Any]) -> VecEnv:
    return _adapted(gym.make_vec(id, num_envs=n_envs, autoreset_mode=AutoresetMode.SAME_STEP, **kwargs), wrap)


def _workers(id: str, n_envs: int, wrap: Wrap, options: Mapping[str, Any], kwargs: Mapping[str, Any]) -> VecEnv:
    venv = WorkerVectorEnv(
        id,
        n_envs,
        options.get("num_workers", AUTO),
        start_method=options.get("start_method"),
        autoreset_mode=AutoresetMode.SAME_STEP,
        **kwargs,
    )
    return _adapted(venv, wrap)


def _adapted(venv: VectorEnv[Any, Any, Any], wrap: Wrap) -> BatchVecEnv:
    """Closes `venv`, which may have processes, when it cannot be wrapped."""
    try:
        return BatchVecEnv(wrap(venv))
    except BaseException:
        venv.close()
        raise


def _subproc(id: str, n_envs: int, wrap: Wrap, options: Mapping[str, Any], kwargs: Mapping[str, Any]) -> VecEnv:
    makers = _makers(id, n_envs, wrap, kwargs)
    makers[0]().close()  # what is wrong is said here, where SB3's processes would only hang up
    return SubprocVecEnv(makers, start_method=options.get("start_method"))


def _dummy(id: str, n_envs: int, wrap: Wrap, options: Mapping[str, Any], kwargs: Mapping[str, Any]) -> VecEnv:
    return DummyVecEnv(_makers(id, n_envs, wrap, kwargs))


def _makers(id: str, n_envs: int, wrap: Wrap, kwargs: Mapping[str, Any]) -> list[Callable[[], gym.Env[Any, Any]]]:
    def make() -> gym.Env[Any, Any]:
        return wrap(gym.make(id, **kwargs))

    return [make] * n_envs


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
    """`n_envs` environments as a `VecEnv`, with statements as token ids (SB3 takes no texts).

    `backend`: "batched", all in this process (the fastest for most uses); "workers", a few processes with a batch
    each (`num_workers`, `start_method` as for `WorkerVectorEnv`); "subproc" and "dummy", SB3's own around single
    environments (`start_method` for "subproc"). All give equal results: environment i has the seed `seed` + i.
    `wrap`: changes the environments, such as `lilgym_mp.wrappers.stop_forcing_v0`; applied to the batch, or to each
    environment with SB3's own backends. `vocabulary`, `length`: as for `TokenizedStatement`. `monitor`: report
    returns and lengths of episodes, as SB3's `make_vec_env` does. Other keywords are those of `gymnasium.make`.
    Raises ValueError naming the value and the choices.
    """
    build = choose("backend", backend, BACKENDS)
    options = {name: kwargs.pop(name) for name in BACKEND_OPTIONS[backend] if name in kwargs}

    def wrapped(env: Any) -> Any:
        env = env if wrap is None else wrap(env)
        space = getattr(env, "single_observation_space", env.observation_space)
        if isinstance(space, spaces.Dict) and isinstance(space.get(STATEMENT), spaces.Text):
            return tokenized_statement_v0(env, vocabulary, length)
        return env

    if isinstance(n_envs, bool) or not isinstance(n_envs, int | np.integer) or n_envs < 1:
        raise ValueError(f"n_envs must be a positive whole number, not {n_envs!r}")
    env = build(id, int(n_envs), wrapped, options, kwargs)
    if seed is not None:
        env.seed(seed)
    if not monitor:
        return env
    return BatchMonitor(env) if isinstance(env, BatchVecEnv) else VecMonitor(env)
