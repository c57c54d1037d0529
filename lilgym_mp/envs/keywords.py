"""Replacements of unknown keywords and ids, named in errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NoReturn

import gymnasium as gym

_OF_BATCHES = "gymnasium.make_vec(id, num_envs=N, {}=...), as it belongs to batches"
_OF_WORKERS = 'lilgym_mp.envs.workers.WorkerVectorEnv(id, N, {}=...), or backend="workers" for SB3'
INSTEAD = {  # of keywords of the release, of Gymnasium, and of other kinds of environments
    "data": 'corpus=PATH, or corpus="lilgym" with the environment variable LILGYM_DATA',
    "stop_forcing": "lilgym_mp.wrappers.StopForcing(env)",
    "evaluate": "lilgym_mp.evaluation.evaluate, which plays each start scene once",
    "max_episode_steps": "horizon=N",
    "num_envs": "gymnasium.make_vec(id, num_envs=N), which makes a batch",
    **dict.fromkeys(("autoreset_mode", "evaluation", "copy"), _OF_BATCHES),
    **dict.fromkeys(("num_workers", "start_method", "timeout_seconds"), _OF_WORKERS),
    "env_kwargs": "its entries as keywords, such as split=..., horizon=...",
    "wrapper_class": "lilgym_mp.sb3.make_vec_env(id, wrap=WRAPPER)",
    "vec_env_cls": 'lilgym_mp.sb3.make_vec_env(id, backend="subproc") or "dummy"',
    "monitor_dir": "lilgym_mp.sb3.make_vec_env(id, monitor=False) and VecMonitor(env, filename)",
    "render_cells": "gymnasium.make(id, {}=...), as it belongs to single environments",
}


SB3_INSTEAD = {  # of keywords that `lilgym_mp.sb3.make_vec_env` sets itself or has under another name
    "num_envs": "n_envs=N",
    "env_id": "id",
    "wrapper_kwargs": "wrap=functools.partial(WRAPPER, ...)",
    "monitor_kwargs": "monitor=False and VecMonitor(env, ...)",
    "start_index": "seed=SEED + START_INDEX",
    **dict.fromkeys(("vectorization_mode", "vector_kwargs", "vec_env_kwargs"), "backend=... and its keywords"),
    "autoreset_mode": "no other than the mode that Stable-Baselines3 needs",
}


def check_keywords(unknown: Iterable[str], choices: Iterable[str], instead: Mapping[str, str] = INSTEAD) -> None:
    """Raises TypeError for any keyword, naming what replaces it, or the choices."""
    for name in unknown:
        advice = f"use {instead[name].format(name)}" if name in instead else f"choose from {', '.join(choices)}"
        raise TypeError(f"unknown keyword {name!r}; {advice}")


def refuse_old_id(new_id: str, **_: Any) -> NoReturn:
    """Raises NameNotFound naming the id that replaces one of the release."""
    raise gym.error.NameNotFound(f"this environment's id is {new_id!r}; the ids of the release are not used")
