"""Evaluates policies on every task of a split, exactly once per pass, many episodes at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.envs.batched import BatchedEnv, checked_actions
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.rules import State
from lilgym_mp.evaluation.episodes import Episode
from lilgym_mp.evaluation.policies import Choose, Observations, Policy, as_policy
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import Action

if TYPE_CHECKING:
    from lilgym_mp.evaluation.decisions import Decision

BATCH_SIZE = 64  # environments
IDLE = -1  # sentinel for an episode index: the environment has no episode left to play


def evaluate(
    policy: Policy | Choose,
    settings: EnvConfig,
    split: str,
    *,
    seed: int = 0,
    passes: int = 1,
    batch_size: int = BATCH_SIZE,
    task_ids: Sequence[str] | None = None,
    record_decisions: bool = False,
    on_episode: Callable[[Episode], object] = lambda episode: None,
) -> list[Episode]:
    """Plays each task of the split, or of `task_ids`, in that order, pass after pass.

    The same arguments give the same episodes if the policy is a pure function. That includes `batch_size`, as the
    episodes of a batch share the random numbers.

    Args:
        policy: The policy, or a function with its arguments.
        settings: The environment, such as `Settings("TowerScratch")`.
        split: The split: "train", "dev", "test" or another one of the corpus.
        seed: Seed of the random numbers that the policy gets.
        passes: How often each task is played.
        batch_size: The most environments that are stepped together.
        task_ids: Tasks to play, by default all of the split.
        record_decisions: Store the policy's output at each step, if it has one.
        on_episode: Called with each episode as it ends.

    Returns:
        One episode per pass and task.

    Raises:
        ValueError: For invalid settings or split, or fewer than one pass, and as `step` for other actions.
    """
    if passes < 1 or batch_size < 1:
        raise ValueError(f"passes and batch_size must be at least 1, not {passes} and {batch_size}")
    task_ids = tuple(settings.tasks(split).ids if task_ids is None else task_ids) * passes
    envs = settings.make_batch(split, min(batch_size, len(task_ids)))
    rng = np.random.default_rng(seed)
    return play_tasks(as_policy(policy), envs, task_ids, rng, record_decisions=record_decisions, on_episode=on_episode)


def play_tasks(
    policy: Policy,
    envs: BatchedEnv,
    tasks: Sequence[str | Task],
    rng: np.random.Generator,
    *,
    record_decisions: bool = False,
    on_episode: Callable[[Episode], object] = lambda episode: None,
) -> list[Episode]:
    """One episode of each task, in order. `envs`: without autoreset, as `Settings.make_batch` makes them.

    Raises ValueError for a task that they cannot play.
    """
    episodes: list[Episode | None] = [None] * len(tasks)
    for index, episode in _play(policy, envs, tasks, rng, record_decisions=record_decisions):
        on_episode(episode)
        episodes[index] = episode
    return [episode for episode in episodes if episode is not None]


def _play(
    policy: Policy, envs: BatchedEnv, tasks: Sequence[str | Task], rng: np.random.Generator, *, record_decisions: bool
) -> Iterator[tuple[int, Episode]]:
    """Yields each episode with its index as it ends; its environment then begins the next one."""
    assert envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    count = envs.num_envs
    playing = np.arange(count)  # index of the episode in each environment
    playing[len(tasks) :] = IDLE
    next_index = count
    taken: list[list[tuple[Action, float | None, Decision | None]]] = [[] for _ in range(count)]
    observations, _ = envs.reset(seed=0, options={"task": [tasks[max(index, 0)] for index in playing.tolist()]})
    while (active := np.flatnonzero(playing != IDLE)).size:
        chosen = np.zeros(count, np.int64)
        made: Sequence[Decision | None] = [None] * len(active)
        inputs = _observations(policy, envs, observations, active, playing)
        legal = envs.action_masks()[active] if policy.needs_masks else np.zeros((len(active), 0), np.bool_)
        chosen[active] = checked_actions(policy(inputs, legal, rng), len(active))
        if record_decisions and (output := policy.output(legal, chosen[active])) is not None:
            from lilgym_mp.evaluation.decisions import decisions

            made = decisions(output, envs.action_masks()[active], envs.dynamics.appearance)
        stops = [None] * len(active) if policy.stop_probabilities is None else policy.stop_probabilities.tolist()
        observations, _, terminated, truncated, infos = envs.step(chosen)
        for env_index, stop, decision in zip(active.tolist(), stops, made, strict=True):
            action = envs.dynamics.appearance.decode(int(chosen[env_index]))
            taken[env_index].append((action, None if stop is None else round(stop, 6), decision))
        ended = terminated | truncated
        if not ended.any():
            continue
        for env_index in np.flatnonzero(ended & (playing != IDLE)).tolist():
            actions, stops, judged = zip(*taken[env_index], strict=True)
            played = tasks[int(playing[env_index])]
            episode = Episode.of(
                played if isinstance(played, Task) else envs.tasks.by_id(played),
                actions,
                infos["outcome"][env_index],
                envs.dynamics,
                invalid_reason=None if "invalid_reason" not in infos else infos["invalid_reason"][env_index],
                stop_probabilities=None if None in stops else stops,
                decisions=None if None in judged else judged,
            )
            yield int(playing[env_index]), episode
            playing[env_index] = next_index if next_index < len(tasks) else IDLE
            next_index += 1
        begun = [tasks[max(index, 0)] for index in playing.tolist()]  # an idle environment begins any task
        observations, _ = envs.reset(options={"reset_mask": ended, "task": begun})
        for env_index in np.flatnonzero(ended).tolist():
            taken[env_index] = []


def _observations(
    policy: Policy, envs: BatchedEnv, observations: dict[str, Any], active: np.ndarray, playing: np.ndarray
) -> Observations:
    """Selects the observations of the active environments, with states only if the policy needs them."""
    states: Sequence[State] = ()
    if policy.needs_states:
        found = envs.states()
        states = [found[env_index] for env_index in active.tolist()]
    return Observations(
        observations["image"][active],
        tuple([observations["statement"][env_index] for env_index in active.tolist()]),
        observations["target"][active],
        envs.steps[active],
        playing[active],
        states,
    )
