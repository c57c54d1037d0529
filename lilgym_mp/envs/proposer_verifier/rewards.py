"""Rewards: each agent's is a weighted sum of named terms."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from functools import partial
from typing import NamedTuple

from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, TurnDecision
from lilgym_mp.scene.choices import choose, register


class Intent(IntEnum):
    """The proposer's goal; drawn at reset when its reward is hidden."""

    HELPFUL = 0
    DECEPTIVE = 1


class Judgement(NamedTuple):
    """The verifier's answer to the claim that the statement has the target value in the scene."""

    accepted: bool
    final: bool  # whether it ends the episode
    holds: bool  # whether the claim is true


def judgement_in(decision: TurnDecision, *, holds: bool) -> Judgement | None:
    """The judgement in a turn, if there is one; `holds`: whether the claim is true."""
    return None if decision.accepted is None else Judgement(decision.accepted, decision.final, holds)


AgentRewards = str | Mapping[str, float]  # a term, or weights by term
# Both agents' rewards of a turn, indexed by role, from the MDP's reward (0 without a step), judgement and intent. It is
# called once for each possible turn, so it must depend on its arguments alone.
RewardFunction = Callable[[float, Judgement | None, Intent], tuple[float, float]]
Rewards = str | Mapping[str, AgentRewards] | RewardFunction  # a name in PRESETS, rewards by agent, or a function


Term = Callable[[Judgement, Intent], float]


def _correctness(judgement: Judgement, intent: Intent) -> float:
    """+1 for a correct judgement that ends the episode, -1 for a wrong one.

    A correct rejection that does not end the episode earns nothing: otherwise repeating a false claim would pay.
    """
    return float(judgement.final) if judgement.accepted == judgement.holds else -1.0


def _hidden(judgement: Judgement, intent: Intent) -> float:
    """+1 if a claim that suits the intent is accepted: a true one if helpful, a false one if deceptive."""
    return float(judgement.accepted and judgement.holds == (intent is Intent.HELPFUL))


def _if_judged(term: Term, mdp_reward: float, judgement: Judgement | None, intent: Intent) -> float:
    return 0.0 if judgement is None else term(judgement, intent)


PROGRESS = "progress"
TERMS: dict[str, Callable[[float, Judgement | None, Intent], float]] = {
    "mdp": lambda mdp_reward, judgement, intent: mdp_reward,
    "mdp_if_helpful": lambda mdp_reward, judgement, intent: mdp_reward if intent is Intent.HELPFUL else 0.0,
    "correctness": partial(_if_judged, _correctness),
    "hidden": partial(_if_judged, _hidden),
    PROGRESS: lambda mdp_reward, judgement, intent: 0.0,  # the games add it: it depends on scenes
}

# Without the MDP's reward, a proposer with hidden intent earns nothing until a verifier that has learned nothing
# accepts its claims, and both give up.
HIDDEN_REWARDS: AgentRewards = {"hidden": 1.0, "mdp_if_helpful": 0.2}
PRESETS: Mapping[str, Mapping[str, AgentRewards]] = {  # by agent
    "common": dict.fromkeys(AGENTS, "mdp"),
    "correctness": {AGENTS[0]: "mdp", AGENTS[1]: "correctness"},
    "hidden": {AGENTS[0]: HIDDEN_REWARDS, AGENTS[1]: "correctness"},
}


def progress_weights(rewards: Rewards) -> tuple[float, float]:
    """Both agents' weights of the term `progress`: by how much a turn has shortened the way to the goal."""
    if isinstance(rewards, str):
        rewards = PRESETS.get(rewards, {})
    if callable(rewards):
        return 0.0, 0.0
    proposer, verifier = (_weights(rewards.get(agent, {})).get(PROGRESS, 0.0) for agent in AGENTS)
    return proposer, verifier


def make_rewards(rewards: Rewards) -> tuple[RewardFunction, bool]:
    """Both agents' rewards, and whether intents are drawn at reset; otherwise the proposer is helpful in every episode.

    Raises ValueError naming the choices for unknown names.
    """
    if callable(rewards):
        return rewards, False
    if isinstance(rewards, str):
        rewards = choose("rewards", rewards, PRESETS)
    if not isinstance(rewards, Mapping):
        raise ValueError(f"rewards must be a preset, a mapping by agent or a function, not {rewards!r}")
    if set(rewards) != set(AGENTS):
        named = ", ".join(map(str, rewards)) or "no agent"
        raise ValueError(f"rewards must name {' and '.join(AGENTS)}, not {named}")
    weights = [_weights(rewards[agent]) for agent in AGENTS]
    return partial(_weighted_sums, weights), any("hidden" in terms for terms in weights)


def checked_rewards(returned: object) -> tuple[float, float]:
    """What a reward function returned. Raises ValueError unless it is the two agents' rewards."""
    try:
        proposer, verifier = returned  # pyright: ignore[reportGeneralTypeIssues]
    except (TypeError, ValueError):
        message = f"rewards must return the two rewards of {' and '.join(AGENTS)}, not {returned!r}"
        raise ValueError(message) from None
    return checked_number("the proposer's reward", proposer), checked_number("the verifier's reward", verifier)


def _weighted_sums(
    weights: Sequence[Mapping[str, float]], mdp_reward: float, judgement: Judgement | None, intent: Intent
) -> tuple[float, float]:
    proposer, verifier = (
        sum((weight * TERMS[term](mdp_reward, judgement, intent) for term, weight in terms.items()), 0.0)
        for terms in weights
    )
    return proposer, verifier


def register_reward_term(name: str, term: Term) -> None:
    """Adds a term that rewards mappings may name: a pure function of a judgement and the intent.

    Raises ValueError for a name that is taken.
    """
    register("reward", name, partial(_if_judged, term), TERMS)


def _weights(terms: AgentRewards) -> Mapping[str, float]:
    weights = {terms: 1.0} if isinstance(terms, str) else dict(terms)
    for term, weight in weights.items():
        choose("reward", term, TERMS)
        checked_number(f"the weight of reward {term!r}", weight)
    return weights


def checked_number(name: str, value: object) -> float:
    """Raises ValueError unless `value` is a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number, not {value!r}")
    return float(value)
