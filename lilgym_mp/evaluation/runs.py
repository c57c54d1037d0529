"""Evaluates policies on every task of a split, exactly once per pass, many episodes at a time.

`play_episodes` is the one loop over the episodes of batches, `play_steps` that over the steps of a single environment.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from lilgym_mp.envs.batched import BatchedEnv, checked_actions
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation.episodes import Episode
from lilgym_mp.evaluation.policies import Choose, Observations, Policy, as_policy
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import Action
from lilgym_mp.scene.arrays import AnyDict, BoolArray, Int64Array, Rng

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
        settings: The environment, such as `EnvConfig("TowerScratch")`.
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
    rng: Rng,
    *,
    record_decisions: bool = False,
    on_episode: Callable[[Episode], object] = lambda episode: None,
) -> list[Episode]:
    """One episode of each task, in order. `envs`: without autoreset, as `EnvConfig.make_batch` makes them.

    Raises ValueError for a task that they cannot play.
    """
    told: dict[int, list[tuple[float | None, Decision | None]]] = defaultdict(list)  # at each step, by episode

    def choose(observations: AnyDict, playing: Int64Array) -> Int64Array:
        active = np.flatnonzero(playing != IDLE)
        env_ids = active.tolist()
        states = envs.states() if policy.needs_states else []
        inputs = Observations(
            observations["image"][active],
            tuple(observations["statement"][env_id] for env_id in env_ids),
            observations["target"][active],
            envs.steps[active],
            playing[active],
            [states[env_id] for env_id in env_ids] if states else (),
        )
        legal = envs.action_masks()[active] if policy.needs_masks else np.zeros((len(active), 0), bool)
        actions = np.zeros(len(playing), np.int64)
        actions[active] = checked_actions(policy(inputs, legal, rng), len(active))
        made: Sequence[Decision | None] = [None] * len(active)
        stops: Sequence[float | None] = [None] * len(active)
        if record_decisions and (output := policy.output(legal, actions[active])) is not None:
            from lilgym_mp.evaluation.decisions import decisions

            made = decisions(output, envs.action_masks()[active], envs.dynamics.appearance)
        if policy.stop_probabilities is not None:
            stops = [round(stop, 6) for stop in policy.stop_probabilities.tolist()]
        for episode, stop, decision in zip(playing[active].tolist(), stops, made, strict=True):
            told[episode].append((stop, decision))
        return actions

    found: dict[int, Episode] = {}
    inner = TakenActions(envs)
    for index, episode in play_episodes(inner, inner, tasks, choose):
        stops, judged = zip(*told.pop(index), strict=True)
        known = {"stop_probabilities": stops, "decisions": judged}
        found[index] = replace(episode, **{name: each for name, each in known.items() if None not in each})
        on_episode(found[index])
    return [found[index] for index in range(len(tasks))]


class TakenActions(VectorWrapper):  # pyright: ignore[reportMissingTypeArgument]
    """Remembers the actions that the wrappers around it pass to the batch, and what the batch returns."""

    taken: Any  # (N,)
    ended: BoolArray  # (N,)
    infos: AnyDict

    def step(self, actions: Any) -> Any:
        self.taken = np.array(actions)
        *_, terminated, truncated, self.infos = played = super().step(actions)
        self.ended = terminated | truncated
        return played


def play_episodes(
    inner: TakenActions,
    envs: VectorEnv[Any, Any, Any],
    tasks: Sequence[str | Task],
    choose: Callable[[Any, Int64Array], Any],
) -> Iterator[tuple[int, Episode]]:
    """Yields an episode of each task with the task's index, as it ends; its environment then begins the next one.

    Args:
        inner: The batch, without autoreset.
        envs: The same with any wrappers around it.
        tasks: The tasks.
        choose: A function of observations, and of the index of the task that each environment plays, or IDLE (N,), that
            returns N actions.
    """
    base: Any = inner.unwrapped
    assert base.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    playing = np.arange(base.num_envs)
    playing[len(tasks) :] = IDLE
    next_index = base.num_envs
    taken: list[list[Action]] = [[] for _ in range(base.num_envs)]

    def begun() -> list[str | Task]:
        return [tasks[max(index, 0)] for index in playing.tolist()]  # an idle environment begins any task

    observations, _ = envs.reset(seed=0, options={"task": begun()})
    while (playing != IDLE).any():
        observations, *_ = envs.step(choose(observations, playing))
        for actions, action in zip(taken, inner.taken.tolist(), strict=True):
            actions.append(base.dynamics.appearance.decode(action))
        if not inner.ended.any():
            continue
        reasons = inner.infos.get("invalid_reason", [None] * base.num_envs)
        for env_id in np.flatnonzero(inner.ended).tolist():
            if (index := int(playing[env_id])) != IDLE:
                task = tasks[index]
                played = task if isinstance(task, Task) else base.tasks.by_id(task)
                ending = inner.infos["outcome"][env_id], base.dynamics
                yield index, Episode.of(played, taken[env_id], *ending, invalid_reason=reasons[env_id])
                playing[env_id] = next_index if next_index < len(tasks) else IDLE
                next_index += 1
            taken[env_id] = []
        observations, _ = envs.reset(options={"reset_mask": inner.ended, "task": begun()})


class Step(NamedTuple):
    """What a single environment returns for an action."""

    observation: Any
    reward: SupportsFloat
    terminated: bool
    truncated: bool
    info: AnyDict


def play_steps(
    env: gym.Env[Any, Any], begun: tuple[Any, AnyDict], choose: Callable[[Any, AnyDict], Any]
) -> Iterator[Step]:
    """Plays the episode that `env` has just begun to its end, or until there is no action.

    Args:
        env: A single environment with any wrappers.
        begun: The observation and the info that `reset` returned.
        choose: A function of an observation and its info that returns an action, or None.
    """
    observation, info = begun
    ended = False
    while not ended and (action := choose(observation, info)) is not None:
        step = Step(*env.step(action))
        observation, _, terminated, truncated, info = step
        ended = terminated or truncated
        yield step
