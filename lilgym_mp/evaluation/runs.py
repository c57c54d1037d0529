"""A policy on every task of a split, exactly once a pass."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.evaluation.policies import Observations, Policy
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.observation import Observation

BATCH_SIZE = 64  # episodes side by side


class Turn(NamedTuple):
    """An episode that is to be played."""

    pass_number: int
    task_number: int  # place in the split, in file order


class Episode(NamedTuple):
    """What a policy made of one task."""

    task_id: str
    statement: str
    target: bool
    outcome: str
    reward: float  # the sum over the episode
    actions: tuple[int, ...]

    @property
    def is_success(self) -> bool:
        return self.outcome == "success"


def evaluate(
    policy: Policy,
    settings: Settings,
    split: str,
    *,
    seed: int = 0,
    passes: int = 1,
    batch_size: int = BATCH_SIZE,
    on_episode: Callable[[Episode], object] = lambda episode: None,
) -> list[Episode]:
    """One episode for each task of the split and pass, in file order, pass after pass.

    The same arguments give the same episodes when the policy is a function of its arguments; `batch_size` is one
    of them, as episodes side by side share the random numbers. `on_episode` hears of each as it ends.
    Raises ValueError for settings or a split that do not exist, or fewer than one pass.
    """
    if passes < 1 or batch_size < 1:
        raise ValueError(f"passes and batch_size must be at least 1, not {passes} and {batch_size}")
    first = settings.make(split)
    tasks = first.evaluation_tasks()
    turns = (Turn(*numbers) for numbers in product(range(passes), range(len(tasks))))
    count = min(batch_size, passes * len(tasks))
    seats = [_Seat(first), *(_Seat(settings.make(split)) for _ in range(count - 1))]
    done = dict(_played(policy, seats, tasks, turns, np.random.default_rng(seed), on_episode))
    return [done[turn] for turn in sorted(done)]


class _Seat:
    """An environment and the episode in it."""

    def __init__(self, env: LilGymEnv) -> None:
        self.env = env
        self.turn = Turn(0, 0)
        self.observation: Observation
        self._actions: list[int] = []
        self._reward = 0.0

    def begin(self, turn: Turn, task_id: str) -> None:
        self.turn = turn
        self.observation, _ = self.env.reset(options={"task": task_id})
        self._actions = []
        self._reward = 0.0

    def act(self, action: int) -> Episode | None:
        """The episode, if this action ended it."""
        self.observation, reward, terminated, truncated, info = self.env.step(action)
        self._actions.append(action)
        self._reward += float(reward)
        if not (terminated or truncated):
            return None
        task = self.env.task
        return Episode(
            task.id, task.statement, task.target, info["outcome"], round(self._reward, 6), tuple(self._actions)
        )


def _played(
    policy: Policy,
    seats: list[_Seat],
    tasks: tuple[str, ...],
    turns: Iterator[Turn],
    rng: np.random.Generator,
    on_episode: Callable[[Episode], object],
) -> Iterator[tuple[Turn, Episode]]:
    """Every turn with its episode, as they end: a seat that is free takes the next turn."""
    free, taken = seats, list[_Seat]()
    while True:
        for seat, turn in zip(free, turns, strict=False):
            seat.begin(turn, tasks[turn.task_number])
            taken.append(seat)
        if not taken:
            return
        free = []
        legal = np.stack([seat.env.action_masks() for seat in taken])
        actions = policy(Observations.of([seat.observation for seat in taken]), legal, rng)
        for seat, action in zip(taken, actions.tolist(), strict=True):
            episode = seat.act(action)
            if episode is not None:
                free.append(seat)
                on_episode(episode)
                yield seat.turn, episode
        taken = [seat for seat in taken if seat not in free]
