"""Recorded episodes of agents that read and write, with what each answered before its actions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from lilgym_mp.actions import named
from lilgym_mp.evaluation.comparison import EvaluationPlan, make_result, training_statements
from lilgym_mp.evaluation.decisions import AgentAnswer, Decision, PolicyOutput, decisions, one_hot
from lilgym_mp.evaluation.named_policies import NamedPolicy
from lilgym_mp.evaluation.policies import Policy
from lilgym_mp.evaluation.recording import Recorder
from lilgym_mp.evaluation.runs import Episode as EvaluatedEpisode
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.llm.player import Episode, Player, Turn
from lilgym_mp.rules import Dynamics
from lilgym_mp.task import Task


def recording_name(agent: str) -> NamedPolicy:
    """How recordings of the agent of that name are called."""
    return NamedPolicy(f"text {agent}", _plays_through_text, "whatever the agent learnt from", mask=False)


def _plays_through_text(settings: Settings) -> Policy:
    raise ValueError("an agent that reads and writes is played by lilgym-mp llm")


def write_recording(
    directory: Path, player: Player, agent: str, episodes: Sequence[Episode], seed: int, *, judges: bool
) -> Path:
    """Writes a file of episodes into the directory, as `lilgym-mp evaluate --record` does; gives the file.

    `judges`: asks the expert in each step. Raises OutputError.
    """
    settings = player.settings
    plan = EvaluationPlan(settings, player.split, seed, record_decisions=True)
    seen = training_statements(settings)
    tasks, dynamics = player.tasks, player.dynamics
    played = [evaluated(episode, tasks.by_id(episode.task), dynamics) for episode in episodes]
    seconds = sum(turn.seconds for episode in episodes for turn in episode.turns)
    result = make_result(recording_name(agent), plan, played, seen, cpu_seconds=seconds, mask=False)
    return Recorder(settings, player.split, seen, judges_decisions=judges).write(directory, result)


def evaluated(episode: Episode, task: Task, dynamics: Dynamics) -> EvaluatedEpisode:
    """The episode as evaluations have it: each action was certain, and its decision keeps the answers before it."""
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
    """Those before each action: the last one was acted upon."""
    ends = [0, *(place + 1 for place, turn in enumerate(turns) if turn.action is not None)]
    for first, end in pairwise(ends):
        yield tuple(AgentAnswer.truncated(turn.answer, understood=turn.understood) for turn in turns[first:end])
