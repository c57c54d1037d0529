"""Workloads: fixed episodes for each configuration, so that all players do the same work.

Environment i has the seed i, and thus the same tasks and actions in every player: random legal edits, then STOP.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.arrays import Int64Array
from lilgym_mp.evaluation.settings import Settings

SPLIT = "train"
STOP = 0  # index of the action
IGNORED = -1  # sentinel: the action after the end of an episode, which autoreset ignores
EPISODE_ACTIONS = 11  # edits and a STOP
ACTIONS = 4_400  # actions of a workload, over all environments
MIN_EPISODES = 4  # episodes per environment


class Episode(NamedTuple):
    """A task and the actions taken in it."""

    task: str
    actions: tuple[int, ...]  # legal edits, then STOP


class Script(NamedTuple):
    """The episodes of one environment. The first is shorter, by a different length in each environment."""

    seed: int
    episodes: tuple[Episode, ...]


class Trace(NamedTuple):
    """The scripts of N environments as batched actions."""

    rows: list[Int64Array]  # (N,) each
    actions: int  # total number, without those ignored by autoreset


class Workload:
    """The environments of one configuration and their scripts."""

    def __init__(self, configuration: str, corpus: str = "builtin", *, actions: int = ACTIONS) -> None:
        """`actions`: length, for all environments together.

        Raises ValueError naming the choices, CorpusError (a ValueError) for an unusable corpus.
        """
        self.settings = settings = Settings(configuration, corpus)
        self.configuration, self.appearance, self.start = configuration, settings.appearance, settings.start
        self.environment_id, self.arguments = settings.id, settings.arguments(SPLIT)  # of every kind of environment
        self.recorder = settings.make(SPLIT)
        self._actions = actions
        self._script = cache(self._recorded)

    def make(self) -> gym.Env[Any, Any]:
        """One environment, made as usual."""
        return gym.make(self.environment_id, **self.arguments)

    def scripts(self, num_envs: int) -> list[Script]:
        """The scripts of N environments."""
        episodes = max(MIN_EPISODES, self._actions // EPISODE_ACTIONS // num_envs)
        return [self._script(seed, episodes) for seed in range(num_envs)]

    def _recorded(self, seed: int, count: int) -> Script:
        env, rng = self.recorder, np.random.default_rng(seed)
        episodes: list[Episode] = []
        env.reset(seed=seed)
        for index in range(count):
            length = EPISODE_ACTIONS if index else 1 + seed % EPISODE_ACTIONS
            task, edits = env.task.id, self._edits(length - 1, rng)
            episodes.append(Episode(task, (*edits, STOP)))
            env.reset()
        return Script(seed, tuple(episodes))

    def _edits(self, count: int, rng: np.random.Generator) -> list[int]:
        actions: list[int] = []
        for _ in range(count):
            legal = np.flatnonzero(self.recorder.action_masks())
            actions.append(int(legal[rng.integers(1, len(legal))]))  # the first is STOP
            self.recorder.step(actions[-1])
        return actions


def vector_trace(scripts: Sequence[Script], autoreset: AutoresetMode) -> Trace:
    """The batched actions that play the scripts, up to the end of the shortest."""
    begins = [IGNORED] if autoreset is AutoresetMode.NEXT_STEP else []
    columns = [[a for episode in script.episodes for a in (*episode.actions, *begins)] for script in scripts]
    length = min(map(len, columns))
    table = np.array([column[:length] for column in columns], np.int64).T
    is_ignored = table == IGNORED
    return Trace([row.copy() for row in np.where(is_ignored, STOP, table)], int((~is_ignored).sum()))
