"""Evaluates a policy of one's own, from any library, behind the wrappers that it was trained with."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.masks import action_masks
from lilgym_mp.evaluation.episodes import Episode
from lilgym_mp.evaluation.policies import NamedPolicy, random_legal
from lilgym_mp.evaluation.recording import Recorder
from lilgym_mp.evaluation.results import EvaluationPlan, Result, summarise, training_statements
from lilgym_mp.scene.actions import Action
from lilgym_mp.scene.arrays import BoolArray


class _Actions(VectorWrapper):  # pyright: ignore[reportMissingTypeArgument]
    """Remembers the actions that the wrappers around it pass to the batch, and what the batch returns."""

    taken: Any  # (N,)
    ended: BoolArray  # (N,)
    infos: dict[str, Any]

    def step(self, actions: Any) -> Any:
        self.taken = np.array(actions)
        *_, terminated, truncated, self.infos = played = super().step(actions)
        self.ended = terminated | truncated
        return played


def evaluate_wrapped(
    choose: Callable[[Any, BoolArray], Any],
    settings: EnvConfig,
    split: str = "dev",
    *,
    wrap: Callable[[Any], Any] = lambda envs: envs,
    num_envs: int = 64,
    name: str = "own policy",
    record: Path | str | None = None,
    **observed: Any,
) -> Result:
    """Plays every task of a split once, whatever the wrappers do to observations, actions and rewards.

    Args:
        choose: A function of a batch of observations, as `wrap` leaves them, and of the legal actions (N, actions)
            bool, that returns N actions. `lambda seen, legal: model.predict(seen)[0]` is that of an SB3 model.
        settings: The environment, such as `Settings("TowerScratch")`.
        split: The split.
        wrap: Wraps the batch as for training.
        num_envs: Environments in the batch.
        name: The policy's name in results and reports.
        record: A directory for a recording of the episodes, which `lilgym-mp report` and the page /watch read.
        observed: Keywords of `gymnasium.make_vec` for observations: `observation="arrays"`, `vocabulary`, `length`.

    Returns:
        The result: `result.summary.accuracy`, the share of the tasks solved, and `result.episodes`, in file order.

    Raises:
        ValueError: For invalid settings or split, and as `step` for other actions.
    """
    tasks = settings.tasks(split)
    batch: Any = {"num_envs": min(num_envs, len(tasks)), "autoreset_mode": AutoresetMode.DISABLED, "evaluation": True}
    inner = _Actions(gym.make_vec(settings.id, **batch, **observed, **settings.arguments(split)))
    began = time.process_time()
    found = _play(choose, inner, wrap(inner))
    seconds = time.process_time() - began
    episodes = [found[task_id] for task_id in tasks.ids]
    seen = training_statements(settings)
    named = NamedPolicy(name, lambda settings: random_legal, "unknown")
    result = Result(named, EvaluationPlan(settings, split), summarise(episodes, seen), episodes, seconds)
    if record is not None:
        Recorder(settings, split, seen).write(Path(record), result)
    return result


def _play(
    choose: Callable[[Any, BoolArray], Any], inner: _Actions, envs: VectorEnv[Any, Any, Any]
) -> dict[str, Episode]:
    """The first episode of each task, by its id."""
    base: Any = inner.unwrapped
    appearance = base.dynamics.appearance
    taken: list[list[Action]] = [[] for _ in range(base.num_envs)]
    found: dict[str, Episode] = {}
    observations, _ = envs.reset(seed=0)
    while True:
        observations, *_ = envs.step(choose(observations, action_masks(envs)))
        for actions, index in zip(taken, inner.taken.tolist(), strict=True):
            actions.append(appearance.decode(index))
        infos = inner.infos
        for env_id in np.flatnonzero(inner.ended).tolist():
            task = base.tasks[int(base.task_indices[env_id])]
            invalid = infos["invalid_reason"][env_id] if "invalid_reason" in infos else None
            played_now = taken[env_id], infos["outcome"][env_id], base.dynamics
            found.setdefault(task.id, Episode.of(task, *played_now, invalid_reason=invalid))
            taken[env_id] = []
        if base.evaluation_finished:
            return found
        if inner.ended.any():
            observations, _ = envs.reset(options={"reset_mask": inner.ended})
