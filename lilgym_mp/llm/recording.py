"""Recordings of text agents' episodes, with the answers before each action."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from lilgym_mp.actions import named
from lilgym_mp.evaluation.comparison import EvaluationPlan, Result, training_statements
from lilgym_mp.evaluation.decisions import AgentAnswer, Decision, PolicyOutput, decisions, one_hot
from lilgym_mp.evaluation.policies import NamedPolicy, Policy
from lilgym_mp.evaluation.recording import Recorder
from lilgym_mp.evaluation.runs import Episode as EvaluatedEpisode
from lilgym_mp.evaluation.runs import summarise
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.llm.player import Episode, Player, Turn
from lilgym_mp.rules import Dynamics
from lilgym_mp.task import Task


def recording_name(agent: str) -> NamedPolicy:
    """The name under which the agent's recordings are saved."""
    return NamedPolicy(f"text {agent}", _no_policy, "unknown training data", mask=False)


def _no_policy(settings: Settings) -> Policy:
    raise ValueError("text agents are played by lilgym-mp llm")


def write_recording(
    directory: Path, player: Player, agent: str, episodes: Sequence[Episode], seed: int, *, judges: bool
) -> Path:
    """Writes a recording into the directory, as `lilgym-mp evaluate --record` does; returns the file.

    `judges`: record the expert's optimal actions in each step. Raises OutputError.
    """
    settings = player.settings
    plan = EvaluationPlan(settings, player.split, seed, record_decisions=True)
    seen = training_statements(settings)
    tasks, dynamics = player.tasks, player.dynamics
    played = [to_evaluated_episode(episode, tasks.by_id(episode.task), dynamics) for episode in episodes]
    seconds = sum(turn.seconds for episode in episodes for turn in episode.turns)
    result = Result(recording_name(agent), plan, summarise(played, seen), played, seconds)
    return Recorder(settings, player.split, seen, judges_decisions=judges).write(directory, result)


def to_evaluated_episode(episode: Episode, task: Task, dynamics: Dynamics) -> EvaluatedEpisode:
    """The episode in the evaluations' format; each decision has probability 1 and includes the preceding answers."""
    indices = tuple(dynamics.appearance.encode(named(action)) for action in episode.actions)
    state, kept, invalid = dynamics.start(task), list[Decision](), None
    for index, answers in zip(indices, _answers(episode.turns), strict=True):
        legal = dynamics.legal_mask(state)[np.newaxis]
        output = PolicyOutput(one_hot(np.array([index]), legal.shape[1]))
        (decision,) = decisions(output, legal, dynamics.appearance)
        kept.append(replace(decision, answers=answers))
        moved = dynamics.step(state, dynamics.appearance.decode(index))
        state, invalid = moved.state, moved.invalid
    return EvaluatedEpisode(
        task.id,
        task.statement,
        task.target,
        episode.outcome,
        episode.reward,
        indices,
        None if invalid is None else str(invalid),
        decisions=tuple(kept),
    )


def _answers(turns: Sequence[Turn]) -> Iterator[tuple[AgentAnswer, ...]]:
    """The answers for each action; the last one chose it."""
    ends = [0, *(index + 1 for index, turn in enumerate(turns) if turn.action is not None)]
    for first, end in pairwise(ends):
        yield tuple(AgentAnswer.truncated(turn.answer, understood=turn.understood) for turn in turns[first:end])
