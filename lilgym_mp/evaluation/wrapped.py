"""Evaluates a policy of one's own, from any library, behind the wrappers that it was trained with."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.masks import action_masks
from lilgym_mp.evaluation.policies import NamedPolicy, random_legal
from lilgym_mp.evaluation.recording import Recorder
from lilgym_mp.evaluation.results import EvaluationPlan, Result, summarise, training_statements
from lilgym_mp.evaluation.runs import TakenActions, play_episodes
from lilgym_mp.scene.arrays import BoolArray


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
        settings: The environment, such as `EnvConfig("TowerScratch")`.
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
    batch: Any = {"num_envs": min(num_envs, len(tasks)), "autoreset_mode": AutoresetMode.DISABLED}
    inner = TakenActions(gym.make_vec(settings.id, **batch, **observed, **settings.arguments(split)))
    envs = wrap(inner)
    began = time.process_time()
    found = dict(play_episodes(inner, envs, tasks.ids, lambda seen, playing: choose(seen, action_masks(envs))))
    seconds = time.process_time() - began
    episodes = [found[index] for index in range(len(tasks))]
    seen = training_statements(settings)
    named = NamedPolicy(name, lambda settings: random_legal, "unknown")
    result = Result(named, EvaluationPlan(settings, split), summarise(episodes, seen), episodes, seconds)
    if record is not None:
        Recorder(settings, split, seen).write(Path(record), result)
    return result
