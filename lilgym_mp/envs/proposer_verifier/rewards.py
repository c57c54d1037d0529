"""Rewards: each agent's is a weighted sum of named terms."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from lilgym_mp.choices import choose
from lilgym_mp.envs.proposer_verifier.types import AGENTS, Intent, Judgement, Role

AgentRewards = str | Mapping[str, float]  # a term, or weights by term
Rewards = str | Mapping[str, AgentRewards]  # a name in PRESETS, or rewards by agent


@dataclass(frozen=True, slots=True)
class Costs:
    """The costs of errors in the term "correctness"."""

    false_accept: float
    false_reject: float


class RewardInput(NamedTuple):
    """What the reward terms of a turn depend on."""

    mdp_reward: float  # 0 in turns that use up no round
    judgement: Judgement | None
    intent: Intent
    costs: Costs


Term = Callable[[RewardInput], float]


def _mdp(turn: RewardInput) -> float:
    """The MDP's reward."""
    return turn.mdp_reward


def _correctness(turn: RewardInput) -> float:
    """+1 for a right judgement that ends the episode, minus its cost for a wrong one.

    A right rejection that does not end the episode earns nothing: otherwise repeating a false claim would pay.
    """
    judgement = turn.judgement
    if judgement is None:
        return 0.0
    if judgement.accepted == judgement.holds:
        return float(judgement.final)
    return -turn.costs.false_accept if judgement.accepted else -turn.costs.false_reject


def _brier(turn: RewardInput) -> float:
    """Minus the squared difference between the stated probability and the truth, 0 or 1."""
    judgement = turn.judgement
    return -((judgement.probability - judgement.holds) ** 2) if judgement else 0.0


def _log(turn: RewardInput) -> float:
    """The natural logarithm of the probability given to the truth."""
    judgement = turn.judgement
    if judgement is None:
        return 0.0
    return math.log(judgement.probability if judgement.holds else 1 - judgement.probability)


def _helpful(turn: RewardInput) -> float:
    """+1 when the verifier accepts a true claim."""
    judgement = turn.judgement
    return float(judgement is not None and judgement.accepted and judgement.holds)


def _sneaky(turn: RewardInput) -> float:
    """+1 when the verifier accepts a false claim."""
    judgement = turn.judgement
    return float(judgement is not None and judgement.accepted and not judgement.holds)


def _hidden(turn: RewardInput) -> float:
    """`_helpful` or `_sneaky`, by the intent drawn at reset."""
    return _sneaky(turn) if turn.intent is Intent.SNEAKY else _helpful(turn)


TERMS: Mapping[str, Term] = {
    "mdp": _mdp,
    "correctness": _correctness,
    "brier": _brier,
    "log": _log,
    "helpful": _helpful,
    "sneaky": _sneaky,
    "hidden": _hidden,
}
SCORING_RULES = ("brier", "log")  # proper scoring rules for a stated probability

PRESETS: Mapping[str, tuple[str, str]] = {  # terms by Role
    "common": ("mdp", "mdp"),
    "correctness": ("mdp", "correctness"),
    "helpful": ("helpful", "correctness"),
    "sneaky": ("sneaky", "correctness"),
    "hidden": ("hidden", "correctness"),
    "brier": ("hidden", "brier"),
    "log": ("hidden", "log"),
}


@dataclass(frozen=True, slots=True)
class RewardScheme:
    """Weights of the terms, by Role."""

    weights: tuple[Mapping[str, float], Mapping[str, float]]
    costs: Costs

    def __call__(self, mdp_reward: float, judgement: Judgement | None, intent: Intent) -> tuple[float, float]:
        """Both agents' rewards of a turn, by Role."""
        turn = RewardInput(mdp_reward, judgement, intent, self.costs)
        proposer, verifier = (
            sum((weight * TERMS[term](turn) for term, weight in terms.items()), 0.0) for terms in self.weights
        )
        return proposer, verifier

    def uses(self, term: str, role: Role) -> bool:
        return term in self.weights[role]

    @property
    def draws_intent(self) -> bool:
        return any(self.uses("hidden", role) for role in Role)


def make_reward_scheme(rewards: Rewards, costs: Costs, *, has_probabilities: bool) -> RewardScheme:
    """Raises ValueError naming the choices for unknown names, and for scoring rules without probabilities."""
    if isinstance(rewards, str):
        proposer, verifier = choose("rewards", rewards, PRESETS)
    else:
        if set(rewards) != set(AGENTS):
            raise ValueError(
                f"rewards must name {' and '.join(AGENTS)}, not {', '.join(map(str, rewards)) or 'no agent'}"
            )
        proposer, verifier = (rewards[agent] for agent in AGENTS)
    scheme = RewardScheme((_weights(proposer), _weights(verifier)), costs)
    for rule in SCORING_RULES:
        if not has_probabilities and any(scheme.uses(rule, role) for role in Role):
            raise ValueError(f'reward {rule!r} scores a probability: it needs protocol="audit" and verdict_bins')
    return scheme


def _weights(terms: AgentRewards) -> Mapping[str, float]:
    weights = {terms: 1.0} if isinstance(terms, str) else dict(terms)
    for term, weight in weights.items():
        choose("reward", term, TERMS)
        if isinstance(weight, bool) or not isinstance(weight, int | float) or not math.isfinite(weight):
            raise ValueError(f"the weight of reward {term!r} must be a finite number, not {weight!r}")
    return weights
