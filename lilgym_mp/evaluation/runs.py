"""A policy on every task of a split, exactly once a pass, many episodes side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.appearances import Appearance
from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.evaluation.decisions import Decision, decisions
from lilgym_mp.evaluation.policies import Observations, Policy, output_of
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.rules import State

BATCH_SIZE = 64  # episodes side by side
IDLE = -1  # in place of an episode's index, where an environment has nothing left to play


class Episode(NamedTuple):
    """What a policy made of one task."""

    task_id: str
    statement: str
    target: bool
    outcome: str
    reward: float  # the sum over the episode
    actions: tuple[int, ...]
    invalid_reason: str | None = None
    stop_probabilities: tuple[float, ...] | None = None  # before each action, of a policy that tells them
    decisions: tuple[Decision, ...] | None = None  # before each action, where they are recorded and the policy tells

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
    task_ids: Sequence[str] | None = None,
    record_decisions: bool = False,
    on_episode: Callable[[Episode], object] = lambda episode: None,
) -> list[Episode]:
    """One episode for each task of the split, or of `task_ids` in it, and pass: in that order, pass after pass.

    The same arguments give the same episodes when the policy is a function of its arguments; `batch_size` is one
    of them, as episodes side by side share the random numbers. `record_decisions`: keep what the policy went by in each
    step, if it tells (`Policy.output`). `on_episode` hears of each as it ends.
    Raises ValueError for settings or a split that do not exist, or fewer than one pass.
    """
    if passes < 1 or batch_size < 1:
        raise ValueError(f"passes and batch_size must be at least 1, not {passes} and {batch_size}")
    task_ids = tuple(settings.make(split).evaluation_tasks() if task_ids is None else task_ids) * passes
    envs = settings.make_batch(split, min(batch_size, len(task_ids)))
    episodes: list[Episode | None] = [None] * len(task_ids)
    recorder = _DecisionRecorder(policy, envs) if record_decisions else None
    for index, episode in _played(policy, envs, task_ids, np.random.default_rng(seed), recorder):
        on_episode(episode)
        episodes[index] = episode
    return [episode for episode in episodes if episode is not None]


class _DecisionRecorder:
    """The decisions of the episodes under way."""

    def __init__(self, policy: Policy, envs: BatchedEnv) -> None:
        self._policy, self._envs = policy, envs
        self._kept: list[list[Decision]] = [[] for _ in range(envs.num_envs)]

    def record(self, active: np.ndarray, legal: np.ndarray, chosen: np.ndarray) -> None:
        """Of the policy's latest call, for the environments `active`; `legal` is the mask that it was shown."""
        output = output_of(self._policy, legal, chosen)
        if output is None:
            return
        exact = legal if getattr(self._policy, "needs_masks", True) else self._envs.action_masks()[active]
        for place, decision in zip(active.tolist(), decisions(output, exact, self._appearance), strict=True):
            self._kept[place].append(decision)

    @property
    def _appearance(self) -> Appearance:
        return self._envs.dynamics.appearance

    def taken(self, place: int) -> tuple[Decision, ...] | None:
        """Those of the episode that ended there; None where the policy told nothing."""
        kept, self._kept[place] = self._kept[place], []
        return tuple(kept) or None


def _played(
    policy: Policy,
    envs: BatchedEnv,
    task_ids: Sequence[str],
    rng: np.random.Generator,
    recorder: _DecisionRecorder | None,
) -> Iterator[tuple[int, Episode]]:
    """Every episode with its index, as they end: an environment that is free begins the next one."""
    assert envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    count = envs.num_envs
    playing = np.arange(count)  # index of the episode in each environment
    next_index = count
    actions: list[list[int]] = [[] for _ in range(count)]
    rewards = np.zeros(count)
    stops: list[list[float]] = [[] for _ in range(count)]
    observations, _ = envs.reset(seed=0, options={"task": task_ids[:count]})
    while (active := np.flatnonzero(playing != IDLE)).size:
        chosen = np.zeros(count, np.int64)
        seen, legal = _seen(policy, envs, observations, active, playing)
        chosen[active] = policy(seen, legal, rng, *_states(policy, envs, active))
        if recorder is not None:
            recorder.record(active, legal, chosen[active])
        told: Sequence[float] | None = getattr(policy, "stop_probabilities", None)
        for place, probability in zip(active.tolist(), () if told is None else told, strict=told is not None):
            stops[place].append(round(float(probability), 6))
        observations, reward, terminated, truncated, infos = envs.step(chosen)
        rewards += reward
        for place in active.tolist():
            actions[place].append(int(chosen[place]))
        ended = terminated | truncated
        if not ended.any():
            continue
        for place in np.flatnonzero(ended & (playing != IDLE)).tolist():
            episode = _episode(envs, place, infos, float(rewards[place]), actions[place])
            kept = None if recorder is None else recorder.taken(place)
            yield (
                int(playing[place]),
                episode._replace(stop_probabilities=tuple(stops[place]) or None, decisions=kept),
            )
            playing[place] = next_index if next_index < len(task_ids) else IDLE
            next_index += 1
        tasks = [task_ids[index] if index != IDLE else task_ids[0] for index in playing.tolist()]
        observations, _ = envs.reset(options={"reset_mask": ended, "task": tasks})
        for place in np.flatnonzero(ended).tolist():
            actions[place], stops[place], rewards[place] = [], [], 0.0


def _seen(
    policy: Policy, envs: BatchedEnv, observations: dict[str, Any], active: np.ndarray, playing: np.ndarray
) -> tuple[Observations, np.ndarray]:
    """What the policy sees of the environments that play, and their masks if it wants them."""
    statements = observations["statement"]
    seen = Observations(
        observations["image"][active],
        tuple([statements[place] for place in active.tolist()]),
        observations["target"][active],
        envs.steps[active],
        playing[active],
    )
    needs_masks = getattr(policy, "needs_masks", True)
    return seen, envs.action_masks()[active] if needs_masks else np.zeros((len(active), 0), np.bool_)


def _states(policy: Policy, envs: BatchedEnv, active: np.ndarray) -> tuple[list[State], ...]:
    """The states that play, as a further argument, for a policy that asks for them."""
    if not getattr(policy, "needs_states", False):
        return ()
    states = envs.states()
    return ([states[place] for place in active.tolist()],)


def _episode(envs: BatchedEnv, place: int, infos: dict[str, Any], reward: float, actions: Sequence[int]) -> Episode:
    task = envs.tasks[int(envs.task_numbers[place])]
    reasons = infos.get("invalid_reason")
    return Episode(
        task.id,
        task.statement,
        task.target,
        infos["outcome"][place],
        round(reward, 6),
        tuple(actions),
        None if reasons is None else reasons[place],
    )
