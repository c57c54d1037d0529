"""Recordings of text agents' episodes, with the answers before each action."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from lilgym_mp.contrib.llm.agents import ExpertAgent, RandomAgent
from lilgym_mp.contrib.llm.player import Player
from lilgym_mp.contrib.llm.summary import Episode
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.decisions import AgentAnswer, Decision, PolicyOutput, decisions, one_hot
from lilgym_mp.evaluation.episodes import Episode as EvaluatedEpisode
from lilgym_mp.evaluation.policies import BUILT_IN_POLICIES, GREEDY, NO_SUPERVISION, SAMPLED, NamedPolicy, Policy
from lilgym_mp.evaluation.recording import Recorder
from lilgym_mp.evaluation.runs import EvaluationPlan, Result, summarise, training_statements
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import named

# Options of an agent's constructor that recordings keep. Others are left out, as they could be keys.
RECORDED_OPTIONS = (
    *("model", "directory", "temperature", "top_p", "seed", "reasoning_effort"),
    *("max_tokens", "max_completion_tokens", "max_new_tokens"),
)
SUPERVISION = {RandomAgent: NO_SUPERVISION, ExpertAgent: BUILT_IN_POLICIES["expert"].supervision}


def named_policy(player: Player, agent: str, options: Mapping[str, Any]) -> NamedPolicy:
    """The agent with what tells its recordings from others: its model and RECORDED_OPTIONS.

    `options`: of the agent's constructor, whose defaults apply to the others.
    """
    defaults = {name: each.default for name, each in inspect.signature(type(player.agent)).parameters.items()}
    values = {**defaults, **options}
    kept = {name: values[name] for name in RECORDED_OPTIONS if isinstance(values.get(name), str | int | float)}
    model = [str(kept[name]) for name in ("model", "directory") if name in kept][:1]
    temperature = kept.get("temperature", 0)
    samples = type(player.agent) is RandomAgent or (isinstance(temperature, int | float) and temperature > 0)
    shown = {name: getattr(player, name) for name in ("scene", "legal_actions", "retries", "history")}
    unknown = "".join(["unknown training data", *(f" (model {name})" for name in model)])
    return NamedPolicy(
        " ".join(["text", agent, *model]),
        _no_policy,
        mask=type(player.agent) is RandomAgent,  # the only agent whose choice is limited to legal actions
        supervision=SUPERVISION.get(type(player.agent), unknown),
        details={
            "label": f"text {agent}",
            "actions": SAMPLED if samples else GREEDY,
            "recipe": {"agent": agent, **kept, **shown},
        },
    )


def _no_policy(settings: Settings) -> Policy:
    raise ValueError("text agents are played by lilgym-mp llm play")


def write_recording(
    directory: Path,
    player: Player,
    agent: str,
    episodes: Sequence[Episode],
    seed: int,
    *,
    judges: bool,
    options: Mapping[str, Any] | None = None,
) -> Path:
    """Writes a recording into the directory, as `lilgym-mp evaluate --record` does; returns the file.

    `judges`: record the expert's optimal actions in each step. `options`: arguments of the agent's constructor, of
    which RECORDED_OPTIONS are kept. Raises OutputError.
    """
    settings = player.settings
    plan = EvaluationPlan(settings, player.split, seed, record_decisions=True)
    seen = training_statements(settings)
    played = [_evaluated(episode, player.tasks.by_id(episode.task), player.dynamics) for episode in episodes]
    seconds = sum(turn.seconds for episode in episodes for turn in episode.turns)
    named = named_policy(player, agent, options or {})
    result = Result(named, plan, summarise(played, seen), played, seconds, bool(named.mask))
    return Recorder(settings, player.split, seen, judges_decisions=judges).write(directory, result)


def _evaluated(episode: Episode, task: Task, dynamics: Dynamics) -> EvaluatedEpisode:
    """The episode in the evaluations' format; each decision has probability 1 and includes the preceding answers."""
    appearance = dynamics.appearance
    state, kept, invalid = dynamics.start(task), list[Decision](), None
    actions = list(map(named, episode.actions))
    ends = [0, *(index + 1 for index, turn in enumerate(episode.turns) if turn.action is not None)]
    for action, (first, end) in zip(actions, pairwise(ends), strict=True):
        legal = dynamics.legal_mask(state)[np.newaxis]
        output = PolicyOutput(one_hot(np.array([appearance.encode(action)]), legal.shape[1]))
        (decision,) = decisions(output, legal, appearance)
        turns = episode.turns[first:end]  # the last one chose the action
        answers = tuple(AgentAnswer.truncated(turn.answer, understood=turn.understood) for turn in turns)
        kept.append(replace(decision, answers=answers))
        moved = dynamics.step(state, action)
        state, invalid = moved.state, moved.invalid
    reason = None if invalid is None else str(invalid)
    return EvaluatedEpisode.of(task, actions, episode.outcome, dynamics, invalid_reason=reason, decisions=tuple(kept))
