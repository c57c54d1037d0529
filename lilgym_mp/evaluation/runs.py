"""Runs a policy on every task of a split, exactly once per pass, many episodes at a time; accuracy and statistics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.corpus.tokens import statement_form
from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.envs.rules import Dynamics, Outcome, State
from lilgym_mp.evaluation.decisions import Decision, decisions
from lilgym_mp.evaluation.policies import Choose, Observations, Policy, as_policy
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import Action, Stop

FINAL_OUTCOMES = tuple(str(outcome) for outcome in Outcome if outcome is not Outcome.CONTINUES)
BATCH_SIZE = 64  # environments
IDLE = -1  # sentinel for an episode index: the environment has no episode left to play


class Episode(NamedTuple):
    """An episode of a policy on one task."""

    task_id: str
    statement: str
    target: bool
    outcome: str
    reward: float  # total
    actions: tuple[int, ...]
    invalid_reason: str | None = None
    stop_probabilities: tuple[float, ...] | None = None  # before each action, if the policy provides them
    decisions: tuple[Decision, ...] | None = None  # before each action, if recorded and the policy provides its output

    @property
    def is_success(self) -> bool:
        return self.outcome == "success"


def evaluate(
    policy: Policy | Choose,
    settings: Settings,
    split: str,
    *,
    seed: int = 0,
    passes: int = 1,
    batch_size: int = BATCH_SIZE,
    task_ids: Sequence[str] | None = None,
    record_decisions: bool = False,
    on_episode: Callable[[Episode], object] = lambda episode: None,
) -> list[Episode]:
    """One episode per pass and task of the split, or of `task_ids`; in that order, pass after pass.

    The same arguments give the same episodes if the policy is a pure function. That includes `batch_size`, as the
    episodes of a batch share the random numbers. `record_decisions`: store the policy's output at each step, if it
    has one. `on_episode` is called with each episode as it ends.
    Raises ValueError for invalid settings or split, or fewer than one pass.
    """
    if passes < 1 or batch_size < 1:
        raise ValueError(f"passes and batch_size must be at least 1, not {passes} and {batch_size}")
    task_ids = tuple(settings.make(split).evaluation_tasks() if task_ids is None else task_ids) * passes
    envs = settings.make_batch(split, min(batch_size, len(task_ids)))
    episodes: list[Episode | None] = [None] * len(task_ids)
    policy = as_policy(policy)
    for index, episode in _play(policy, envs, task_ids, np.random.default_rng(seed), record_decisions=record_decisions):
        on_episode(episode)
        episodes[index] = episode
    return [episode for episode in episodes if episode is not None]


def _play(
    policy: Policy, envs: BatchedEnv, task_ids: Sequence[str], rng: np.random.Generator, *, record_decisions: bool
) -> Iterator[tuple[int, Episode]]:
    """Yields each episode with its index as it ends; its environment then begins the next one."""
    assert envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    count = envs.num_envs
    playing = np.arange(count)  # index of the episode in each environment
    next_index = count
    actions: list[list[int]] = [[] for _ in range(count)]
    rewards = np.zeros(count)
    stops: list[list[float]] = [[] for _ in range(count)]
    recorded: list[list[Decision]] = [[] for _ in range(count)]
    observations, _ = envs.reset(seed=0, options={"task": task_ids[:count]})
    while (active := np.flatnonzero(playing != IDLE)).size:
        chosen = np.zeros(count, np.int64)
        inputs = _observations(policy, envs, observations, active, playing)
        legal = envs.action_masks()[active] if policy.needs_masks else np.zeros((len(active), 0), np.bool_)
        chosen[active] = policy(inputs, legal, rng)
        if record_decisions and (output := policy.output(legal, chosen[active])) is not None:
            made = decisions(output, envs.action_masks()[active], envs.dynamics.appearance)
            for env_index, decision in zip(active.tolist(), made, strict=True):
                recorded[env_index].append(decision)
        stop = policy.stop_probabilities
        for env_index, probability in zip(active.tolist(), () if stop is None else stop, strict=stop is not None):
            stops[env_index].append(round(float(probability), 6))
        observations, reward, terminated, truncated, infos = envs.step(chosen)
        rewards += reward
        for env_index in active.tolist():
            actions[env_index].append(int(chosen[env_index]))
        ended = terminated | truncated
        if not ended.any():
            continue
        for env_index in np.flatnonzero(ended & (playing != IDLE)).tolist():
            episode = _episode(envs, env_index, infos, float(rewards[env_index]), actions[env_index])
            judgements = tuple(stops[env_index]) or None, tuple(recorded[env_index]) or None
            yield int(playing[env_index]), episode._replace(stop_probabilities=judgements[0], decisions=judgements[1])
            playing[env_index] = next_index if next_index < len(task_ids) else IDLE
            next_index += 1
        tasks = [task_ids[index] if index != IDLE else task_ids[0] for index in playing.tolist()]
        observations, _ = envs.reset(options={"reset_mask": ended, "task": tasks})
        for env_index in np.flatnonzero(ended).tolist():
            actions[env_index], stops[env_index], recorded[env_index], rewards[env_index] = [], [], [], 0.0


def _observations(
    policy: Policy, envs: BatchedEnv, observations: dict[str, Any], active: np.ndarray, playing: np.ndarray
) -> Observations:
    """What the policy observes in the active environments: states only if it needs them."""
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


def _episode(envs: BatchedEnv, env_index: int, infos: dict[str, Any], reward: float, actions: Sequence[int]) -> Episode:
    task = envs.tasks[int(envs.task_indices[env_index])]
    reasons = infos.get("invalid_reason")
    return Episode(
        task.id,
        task.statement,
        task.target,
        infos["outcome"][env_index],
        round(reward, 6),
        tuple(actions),
        None if reasons is None else reasons[env_index],
    )


def scenes(dynamics: Dynamics, start: Scene, actions: Sequence[Action]) -> list[Scene]:
    """The start scene and the scene after each action; STOP and invalid actions do not change it."""
    visited = [start]
    for action in actions:
        if isinstance(action, Stop):
            visited.append(visited[-1])
        else:
            visited.append(dynamics.appearance.apply(visited[-1], action, dynamics.rules.placement).scene)
    return visited


@dataclass(frozen=True, slots=True)
class SuccessCount:
    """Number of episodes, and of successes among them."""

    episodes: int
    successes: int

    @property
    def accuracy(self) -> float | None:
        """Task-completion accuracy, None if there are no episodes."""
        return self.successes / self.episodes if self.episodes else None

    @classmethod
    def of(cls, episodes: Collection[Episode]) -> SuccessCount:
        return cls(len(episodes), sum(episode.is_success for episode in episodes))


@dataclass(frozen=True, slots=True)
class Summary:
    """Statistics of a policy on a split."""

    all: SuccessCount
    seen: SuccessCount  # statements that occur verbatim in the training tasks
    unseen: SuccessCount
    seen_forms: SuccessCount  # statements that share a form with a training statement
    unseen_forms: SuccessCount
    mean_reward: float
    mean_length: float  # mean number of actions
    outcomes: dict[str, float]  # fraction of all episodes by final outcome

    @property
    def accuracy(self) -> float:
        return self.all.successes / self.all.episodes


def summarise(episodes: Sequence[Episode], training_statements: Collection[str]) -> Summary:
    """Without training statements, no episode counts as seen or unseen. Raises ValueError if there are no episodes."""
    if not episodes:
        raise ValueError("cannot summarise zero episodes")
    forms = set(map(statement_form, training_statements))
    outcomes = Counter(episode.outcome for episode in episodes)

    def count(is_counted: Callable[[Episode], bool]) -> SuccessCount:
        return SuccessCount.of([episode for episode in episodes if is_counted(episode)])

    return Summary(
        all=SuccessCount.of(episodes),
        seen=count(lambda episode: episode.statement in training_statements),
        unseen=count(lambda episode: bool(forms) and episode.statement not in training_statements),
        seen_forms=count(lambda episode: statement_form(episode.statement) in forms),
        unseen_forms=count(lambda episode: bool(forms) and statement_form(episode.statement) not in forms),
        mean_reward=sum(episode.reward for episode in episodes) / len(episodes),
        mean_length=sum(len(episode.actions) for episode in episodes) / len(episodes),
        outcomes={outcome: outcomes[outcome] / len(episodes) for outcome in FINAL_OUTCOMES},
    )
