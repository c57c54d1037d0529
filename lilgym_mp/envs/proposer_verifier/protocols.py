"""The protocols: who moves when, and what the choices of a turn do to the MDP.

Each is a pure function of its config and the turn. An illegal choice counts as no choice: the proposer uses up the
round, the verifier rejects, continues or gives the lowest verdict. `game.DecisionTable` tabulates all decisions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.scene.choices import register

AGENTS = ("proposer_0", "verifier_0")  # indexed by role
NO_CHOICE = -1  # sentinel for a missing or illegal choice
STOP_ACTION = 0  # index of the MDP's STOP (`appearances.Appearance`)
REJECT, ACCEPT, STOP = 0, 1, 2  # indices of the verifier's answers; in "joint", 0 continues and 1 stops


class Role(IntEnum):
    PROPOSER = 0
    VERIFIER = 1

    @property
    def other(self) -> Role:
        return Role(1 - self)


PROPOSER, VERIFIER = Role  # module constants: reading Role.PROPOSER takes ten times as long, in every step
PROPOSER_MOVES: tuple[Role, ...] = (PROPOSER,)
BOTH_MOVE: tuple[Role, ...] = (PROPOSER, VERIFIER)


@dataclass(frozen=True, slots=True)
class Ending:
    """Who may end the episode with a STOP."""

    by_proposer: bool = False  # the proposer alone; if neither may, the proposer with the verifier's consent
    by_verifier: bool = False  # the verifier alone

    @property
    def proposer_may_stop(self) -> bool:
        """Whether STOP is among the proposer's choices."""
        return self.by_proposer or not self.by_verifier


ENDINGS: Mapping[str, Ending] = {
    "agreement": Ending(),
    "proposer": Ending(by_proposer=True),
    "verifier": Ending(by_verifier=True),
    "either": Ending(by_proposer=True, by_verifier=True),
}


@dataclass(frozen=True, slots=True)
class ProtocolConfig:
    """The settings that a protocol's decisions depend on."""

    dynamics: Dynamics
    ending: Ending
    verdict_bins: int | None  # audit: None for a verdict without probability
    exchanges: int  # critique: rejections in a round before the next proposal needs no answer


class ProposalType(IntEnum):
    """The kind of a proposal. STOP and EDIT are min(action index, 1)."""

    STOP = STOP_ACTION  # the claim that the statement has the target value
    EDIT = 1
    NONE = 2


class MDPMove(IntEnum):
    """A turn's effect on the MDP. All but NOTHING use up a round."""

    NOTHING = 0  # the verifier is to answer the proposal, or has rejected it at no cost
    WAIT = 1  # a step that leaves the scene unchanged
    PROPOSAL = 2
    STOP = 3


class TurnInput(NamedTuple):
    """A protocol's input, besides its ProtocolConfig."""

    is_answer: bool  # whether it is the verifier's turn; always False in simultaneous protocols
    proposal: ProposalType  # the proposer's choice; in the verifier's turn, the pending proposal
    answer: int | None  # the verifier's choice; None if illegal or in the proposer's turn
    exchanges_spent: bool  # whether this round has had all the rejections allowed


class TurnDecision(NamedTuple):
    """A protocol's decision on a turn."""

    mdp_move: MDPMove
    needs_answer: bool = False  # whether the verifier moves next, to answer the proposal
    probability: float | None = None  # `Judgement.probability`; None if the verifier judged no claim
    final: bool = False  # `Judgement.final`


@dataclass(frozen=True, slots=True)
class GameProtocol:
    """The rules of one protocol."""

    name: str
    summary: str  # one sentence for people who choose a protocol
    endings: tuple[str, ...]  # valid names in ENDINGS, the default first
    first_movers: tuple[Role, ...]  # the agents to move when no proposal is pending
    answers: Callable[[ProtocolConfig], tuple[str, ...]]  # names of the verifier's choices, all legal in its turn
    decide: Callable[[ProtocolConfig, TurnInput], TurnDecision]
    message_sizes: tuple[int, int] = (0, 0)  # default number of messages besides silence, indexed by role
    takes_bins: bool = False  # whether the verifier may state a probability

    @property
    def turn_based(self) -> bool:
        """Whether the agents move in turn rather than simultaneously."""
        return len(self.first_movers) == 1


_MOVES = {ProposalType.NONE: MDPMove.WAIT, ProposalType.STOP: MDPMove.STOP, ProposalType.EDIT: MDPMove.PROPOSAL}


def _critique(config: ProtocolConfig, turn: TurnInput) -> TurnDecision:
    """As veto, but a rejection is free; after `exchanges` of them in a round the next proposal needs no answer."""
    if turn.exchanges_spent and not turn.is_answer:
        return TurnDecision(_MOVES[turn.proposal])
    return _veto(config, turn, rejection=MDPMove.NOTHING)


def _veto(config: ProtocolConfig, turn: TurnInput, rejection: MDPMove = MDPMove.WAIT) -> TurnDecision:
    """The verifier must answer a proposal, unless it is a STOP that needs no consent; a rejection uses up the round.

    Its answer STOP ends the episode. Only the proposal STOP is a claim.
    """
    claims = turn.proposal is ProposalType.STOP
    if not turn.is_answer:
        if turn.proposal is ProposalType.NONE or (claims and config.ending.by_proposer):
            return TurnDecision(_MOVES[turn.proposal])
        return TurnDecision(MDPMove.NOTHING, needs_answer=True)
    if turn.answer == STOP:
        return TurnDecision(MDPMove.STOP, probability=1.0, final=True)
    accepts = turn.answer == ACCEPT
    mdp_move = _MOVES[turn.proposal] if accepts else rejection
    return TurnDecision(mdp_move, probability=float(accepts) if claims else None, final=accepts and claims)


def _joint(config: ProtocolConfig, turn: TurnInput) -> TurnDecision:
    """Both choose simultaneously; a stop is judged on the scene before the edit. A STOP that does not end the episode
    uses up the round."""
    ending = config.ending
    claims, stops = turn.proposal is ProposalType.STOP, turn.answer == ACCEPT
    ends = (claims and ending.by_proposer) or (stops and ending.by_verifier) or (claims and stops)
    mdp_move = MDPMove.STOP if ends else MDPMove.WAIT if claims else _MOVES[turn.proposal]
    if ending.by_verifier or claims:
        return TurnDecision(mdp_move, probability=float(stops), final=ends)
    return TurnDecision(mdp_move)


def _audit(config: ProtocolConfig, turn: TurnInput) -> TurnDecision:
    """The proposer plays alone; its STOP is a claim, and the verifier's verdict on it ends the episode."""
    if turn.is_answer:
        probability = _verdict_probability(config.verdict_bins, turn.answer or 0)
        return TurnDecision(MDPMove.STOP, probability=probability, final=True)
    if turn.proposal is ProposalType.STOP:
        return TurnDecision(MDPMove.NOTHING, needs_answer=True)
    return TurnDecision(_MOVES[turn.proposal])


def _verdict_probability(bins: int | None, verdict: int) -> float:
    """The midpoint of the verdict's bin among `bins` equal ones; 0 or 1 without bins."""
    return float(verdict) if bins is None else (verdict + 0.5) / bins


def _consent_answers(config: ProtocolConfig) -> tuple[str, ...]:
    return ("reject", "accept", "stop") if config.ending.by_verifier else ("reject", "accept")


def _joint_answers(config: ProtocolConfig) -> tuple[str, ...]:
    return ("continue", "stop")


def _verdicts(config: ProtocolConfig) -> tuple[str, ...]:
    bins = config.verdict_bins
    if bins is None:
        return ("does not hold", "holds")
    return tuple(f"holds with probability {_verdict_probability(bins, verdict):.3g}" for verdict in range(bins))


PROTOCOLS: dict[str, GameProtocol] = {
    protocol.name: protocol
    for protocol in (
        GameProtocol(
            "veto",
            "The verifier accepts or rejects each proposal; a rejection uses up the round.",
            tuple(ENDINGS),
            PROPOSER_MOVES,
            _consent_answers,
            _veto,
        ),
        GameProtocol(
            "joint",
            "Both choose simultaneously; the verifier decides whether to stop.",
            ("verifier", "either", "agreement"),
            BOTH_MOVE,
            _joint_answers,
            _joint,
        ),
        GameProtocol(
            "audit",
            "The proposer edits alone; its STOP is a claim, which the verifier judges, ending the game.",
            ("proposer",),
            PROPOSER_MOVES,
            _verdicts,
            _audit,
            takes_bins=True,
        ),
        GameProtocol(
            "critique",
            "As veto, but a number of rejections are free, and the verifier may send a message with one.",
            tuple(ENDINGS),
            PROPOSER_MOVES,
            _consent_answers,
            _critique,
            message_sizes=(0, 4),
        ),
    )
}


def register_protocol(protocol: GameProtocol) -> None:
    """Adds a protocol to the game. Raises ValueError for a name that is taken."""
    register("protocol", protocol.name, protocol, PROTOCOLS)
