"""What a turn is worth to each agent: weighted sums of named terms."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from lilgym_mp.choices import choose
from lilgym_mp.envs.proposer_verifier.states import AGENTS, Intent, Judgement, Role

AgentRewards = str | Mapping[str, float]  # a term, or terms with their weights
Rewards = str | Mapping[str, AgentRewards]  # a name of PRESETS, or both agents' own


@dataclass(frozen=True, slots=True)
class Costs:
    """What the term "correctness" charges for an error."""

    false_accept: float
    false_reject: float


class Event(NamedTuple):
    """What a turn's worth depends on."""

    reward: float  # the MDP's; 0 in turns that spend no round
    judgement: Judgement | None
    intent: Intent
    costs: Costs


Term = Callable[[Event], float]


def _mdp(event: Event) -> float:
    """The MDP's own reward, in turns that spend a round."""
    return event.reward


def _correctness(event: Event) -> float:
    """+1 for a right judgement that ends the episode, minus its cost for a wrong one.

    A right rejection after which play goes on is worth nothing: otherwise repeating a false claim would pay.
    """
    judgement = event.judgement
    if judgement is None:
        return 0.0
    if judgement.accepted == judgement.holds:
        return float(judgement.final)
    return -event.costs.false_accept if judgement.accepted else -event.costs.false_reject


def _brier(event: Event) -> float:
    """Minus the squared difference between the stated probability and the truth, 0 or 1."""
    judgement = event.judgement
    return -((judgement.probability - judgement.holds) ** 2) if judgement else 0.0


def _log(event: Event) -> float:
    """The natural logarithm of the probability stated for what is true."""
    judgement = event.judgement
    if judgement is None:
        return 0.0
    return math.log(judgement.probability if judgement.holds else 1 - judgement.probability)


def _helpful(event: Event) -> float:
    """+1 when the verifier accepts a true claim."""
    judgement = event.judgement
    return float(judgement is not None and judgement.accepted and judgement.holds)


def _sneaky(event: Event) -> float:
    """+1 when the verifier accepts a false claim."""
    judgement = event.judgement
    return float(judgement is not None and judgement.accepted and not judgement.holds)


def _hidden(event: Event) -> float:
    """As helpful or as sneaky, whichever was drawn at reset."""
    return _sneaky(event) if event.intent is Intent.SNEAKY else _helpful(event)


TERMS: Mapping[str, Term] = {
    "mdp": _mdp,
    "correctness": _correctness,
    "brier": _brier,
    "log": _log,
    "helpful": _helpful,
    "sneaky": _sneaky,
    "hidden": _hidden,
}
SCORES = ("brier", "log")  # proper scores of a stated probability

PRESETS: Mapping[str, tuple[str, str]] = {  # one term for each Role
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
    """Both agents' weighted terms, by Role."""

    weights: tuple[Mapping[str, float], Mapping[str, float]]
    costs: Costs

    def __call__(self, reward: float, judgement: Judgement | None, intent: Intent) -> tuple[float, float]:
        """Both agents' rewards, by Role, for a turn in which the MDP gave `reward`."""
        event = Event(reward, judgement, intent, self.costs)
        proposer, verifier = (
            sum((weight * TERMS[term](event) for term, weight in terms.items()), 0.0) for terms in self.weights
        )
        return proposer, verifier

    def uses(self, term: str, role: Role) -> bool:
        return term in self.weights[role]

    @property
    def draws_intent(self) -> bool:
        return any(self.uses("hidden", role) for role in Role)


def make_scheme(rewards: Rewards, costs: Costs, *, has_probabilities: bool) -> RewardScheme:
    """Raises ValueError naming the choices for unknown names, and for scores without probabilities."""
    if isinstance(rewards, str):
        proposer, verifier = choose("rewards", rewards, PRESETS)
    else:
        if set(rewards) != set(AGENTS):
            raise ValueError(
                f"rewards must name {' and '.join(AGENTS)}, not {', '.join(map(str, rewards)) or 'nobody'}"
            )
        proposer, verifier = (rewards[agent] for agent in AGENTS)
    scheme = RewardScheme((_weights(proposer), _weights(verifier)), costs)
    for score in SCORES:
        if not has_probabilities and any(scheme.uses(score, role) for role in Role):
            raise ValueError(f'reward {score!r} scores a probability: it needs protocol="audit" and verdict_bins')
    return scheme


def _weights(terms: AgentRewards) -> Mapping[str, float]:
    weights = {terms: 1.0} if isinstance(terms, str) else dict(terms)
    for term, weight in weights.items():
        choose("reward", term, TERMS)
        if isinstance(weight, bool) or not isinstance(weight, int | float) or not math.isfinite(weight):
            raise ValueError(f"the weight of reward {term!r} must be a finite number, not {weight!r}")
    return weights
