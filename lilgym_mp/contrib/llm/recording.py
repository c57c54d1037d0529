"""Recordings of text agents' episodes, with the answers before each action."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from lilgym_mp.contrib.llm.agents import ExpertAgent, LanguageAgent, RandomAgent
from lilgym_mp.contrib.llm.player import Player
from lilgym_mp.contrib.llm.summary import Episode, Turn
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.evaluation.comparison import EvaluationPlan, Result, training_statements
from lilgym_mp.evaluation.decisions import AgentAnswer, Decision, PolicyOutput, decisions, one_hot
from lilgym_mp.evaluation.policies import BUILT_IN_POLICIES, GREEDY, NO_SUPERVISION, SAMPLED, NamedPolicy, Policy
from lilgym_mp.evaluation.recording import Recorder
from lilgym_mp.evaluation.runs import Episode as EvaluatedEpisode
from lilgym_mp.evaluation.runs import summarise
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import named

# Options of an agent's constructor that recordings keep. Others are left out, as they could be keys.
RECORDED_OPTIONS = (
    *("model", "directory", "temperature", "top_p", "seed", "reasoning_effort"),
    *("max_tokens", "max_completion_tokens", "max_new_tokens"),
)
SUPERVISION = {RandomAgent: NO_SUPERVISION, ExpertAgent: BUILT_IN_POLICIES["expert"].supervision}


def recording_name(agent: str, options: Mapping[str, Any]) -> NamedPolicy:
    """The name under which the agent's recordings are saved, which includes its model if `options` have one."""
    return NamedPolicy(" ".join(["text", agent, *_model(options)]), _no_policy, mask=False)


def _model(options: Mapping[str, Any]) -> list[str]:
    return [str(options[name]) for name in ("model", "directory") if name in options][:1]


def _recorded_options(agent: LanguageAgent, options: Mapping[str, Any]) -> dict[str, Any]:
    """Those of RECORDED_OPTIONS in `options`, or else with a default in the agent's constructor."""
    parameters = inspect.signature(type(agent)).parameters
    values = {**{name: parameter.default for name, parameter in parameters.items()}, **options}
    return {name: values[name] for name in RECORDED_OPTIONS if isinstance(values.get(name), str | int | float)}


def _named(player: Player, agent: str, options: Mapping[str, Any]) -> NamedPolicy:
    """The agent with what tells its recordings from others."""
    kept = _recorded_options(player.agent, options)
    temperature = kept.get("temperature", 0)
    samples = type(player.agent) is RandomAgent or (isinstance(temperature, int | float) and temperature > 0)
    of_model = "".join(f" (model {name})" for name in _model(kept))
    shown = {name: getattr(player, name) for name in ("scene", "legal_actions", "retries", "history")}
    details = {
        "label": f"text {agent}",
        "actions": SAMPLED if samples else GREEDY,
        "recipe": {"agent": agent, **kept, **shown},
    }
    supervision = SUPERVISION.get(type(player.agent), f"unknown training data{of_model}")
    return replace(recording_name(agent, options), supervision=supervision, details=details)


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
    tasks, dynamics = player.tasks, player.dynamics
    played = [to_evaluated_episode(episode, tasks.by_id(episode.task), dynamics) for episode in episodes]
    seconds = sum(turn.seconds for episode in episodes for turn in episode.turns)
    mask = type(player.agent) is RandomAgent  # the only agent whose choice is limited to legal actions
    named = _named(player, agent, options or {})
    result = Result(named, plan, summarise(played, seen), played, seconds, mask)
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
