"""The environments that agents learn in: the one place that decides how they run side by side."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any

import gymnasium as gym
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv

from lilgym_mp.choices import choose
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.recipe import Recipe
from lilgym_mp.wrappers import StopForcing, TokenizedStatement

TRAINING_SPLIT = "train"
START_METHOD = "forkserver"


def make_training_env(
    settings: Settings, recipe: Recipe, vocabulary: Vocabulary, length: int, corpus: str | None = None
) -> gym.Env[Any, Any]:
    """One environment as an agent learns in it: tokenised statements, stop forcing when the recipe says so.

    `corpus`: in place of the settings' one. Raises as `gymnasium.make` does.
    """
    env = settings.make(TRAINING_SPLIT, corpus=corpus)
    if recipe.stop_forcing:
        env = StopForcing(env, mode="mask")
    return TokenizedStatement(env, vocabulary, length)


def _processes(makers: list[Callable[[], gym.Env[Any, Any]]]) -> VecEnv:
    """One process each; they leave Ctrl-C to this one, and end when it does."""
    if START_METHOD in multiprocessing.get_all_start_methods():
        # Imported once, by the process that the others are forked from.
        multiprocessing.set_forkserver_preload([__name__])
        method = START_METHOD
    else:
        method = None
    with _interrupts_ignored():
        return SubprocVecEnv(makers, start_method=method)


BACKENDS: Mapping[str, Callable[[list[Callable[[], gym.Env[Any, Any]]]], VecEnv]] = {
    "subproc": _processes,
    "dummy": DummyVecEnv,
}


def make_training_envs(make_env: Callable[[], gym.Env[Any, Any]], count: int, backend: str) -> VecEnv:
    """`count` environments side by side: "subproc", a process each, or "dummy", all in this process.

    Raises ValueError naming the choices for an unknown backend.
    """
    return choose("backend", backend, BACKENDS)([partial(make_env) for _ in range(count)])


@contextmanager
def _interrupts_ignored() -> Generator[None, None, None]:
    """New processes inherit that they are not interrupted by Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
