"""The environments that agents learn in: the one place that decides how they run side by side."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Generator
from contextlib import contextmanager
from functools import partial
from threading import current_thread, main_thread
from typing import Any

import gymnasium as gym
from stable_baselines3.common.vec_env import VecEnv

from lilgym_mp import sb3
from lilgym_mp.choices import choose
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.corpus.matching import solvable_matching_corpus
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.recipe import Recipe
from lilgym_mp.wrappers import stop_forcing_v0
from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import TaskChange

TRAINING_SPLIT = "train"


def check_backend(backend: str) -> None:
    """Raises ValueError naming the choices for an unknown way to run environments side by side."""
    choose("backend", backend, sb3.BACKENDS)


def make_training_envs(
    settings: Settings, recipe: Recipe, vocabulary: Vocabulary, length: int, corpus: str, backend: str
) -> VecEnv:
    """As many environments as the recipe says, with statements of `length` words, and stop forcing if it says so.

    `corpus`: what is learnt from, in place of the settings' one. Processes of theirs leave Ctrl-C to this one.
    Raises ValueError naming the choices for an unknown backend.
    """
    arguments = {**settings.arguments(TRAINING_SPLIT), "corpus": corpus}
    # Imported once, by the process that others are forked from.
    multiprocessing.set_forkserver_preload([sb3.__name__])
    with _interrupts_ignored():
        return sb3.make_vec_env(
            settings.id,
            recipe.envs,
            backend,
            wrap=partial(_wrapped, recipe) if recipe.stop_forcing or recipe.nlvr_reward else None,
            vocabulary=vocabulary,
            length=length,
            monitor=False,
            **arguments,
        )


class _SolvableMatchingTasks(TaskChange):
    change = staticmethod(solvable_matching_corpus)


class _SolvableNLVRReward(EnvWrapper[_SolvableMatchingTasks]):
    """`NLVRReward` without the tasks that no scene of the corpus solves."""

    transformation_class = _SolvableMatchingTasks

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)


_solvable_nlvr_reward = factory(_SolvableNLVRReward)


def _wrapped(recipe: Recipe, env: Any) -> Any:
    """What the recipe changes of the environments."""
    if recipe.nlvr_reward:
        env = _solvable_nlvr_reward(env)
    return stop_forcing_v0(env, mode="mask") if recipe.stop_forcing else env


@contextmanager
def _interrupts_ignored() -> Generator[None, None, None]:
    """New processes inherit that Ctrl-C does not interrupt them."""
    if current_thread() is not main_thread():  # which alone may say how signals are handled
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
