"""The protocols: who moves when, and what the choices of a turn do to the MDP.

Each is a pure function of the turn. An illegal choice counts as no choice: the proposer uses up the round, the verifier
rejects or continues. `game.DecisionTable` tabulates all decisions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from lilgym_mp.scene.choices import choose, register

AGENTS = ("proposer_0", "verifier_0")  # indexed by role
NO_CHOICE = -1  # sentinel for a missing or illegal choice
STOP_ACTION = 0  # index of the MDP's STOP (`appearances.Appearance`)
# Indices of the verifier's answers; in "joint", 0 continues and 1 stops
REJECT = 0
ACCEPT = 1


class Role(IntEnum):
    """The two agents of the game; the values index arrays by agent."""

    PROPOSER = 0
    VERIFIER = 1

    @property
    def other(self) -> Role:
        """The partner's role."""
        return Role(1 - self)

    @classmethod
    def of(cls, given: Role | str) -> Role:
        """The role itself, or that of a name such as "proposer" or "proposer_0". Raises ValueError with the choices."""
        if isinstance(given, cls):
            return given
        names = {role.name.lower(): role for role in cls}
        return choose("role", given.removesuffix("_0") if isinstance(given, str) else given, names)


PROPOSER, VERIFIER = Role  # module constants: reading Role.PROPOSER takes ten times as long, in every step


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
    """A protocol's input."""

    is_answer: bool  # whether it is the verifier's turn; always False in simultaneous protocols
    proposal: ProposalType  # the proposer's choice; in the verifier's turn, the pending proposal
    answer: int | None  # the verifier's choice; None if illegal or in the proposer's turn
    exchanges_spent: bool  # whether this round has had all the rejections allowed


class TurnDecision(NamedTuple):
    """A protocol's decision on a turn."""

    mdp_move: MDPMove
    needs_answer: bool = False  # whether the verifier moves next, to answer the proposal
    accepted: bool | None = None  # `Judgement.accepted`; None if the verifier judged no claim
    final: bool = False  # `Judgement.final`


@dataclass(frozen=True, slots=True)
class GameProtocol:
    """The rules of one protocol."""

    name: str
    summary: str  # one sentence for people who choose a protocol
    answers: tuple[str, ...]  # names of the verifier's choices, all legal in its turn
    decide: Callable[[TurnInput], TurnDecision]
    message_sizes: tuple[int, int] = (0, 0)  # default number of messages besides silence, indexed by role
    turn_based: bool = True  # the proposer moves, then the verifier if it is to answer; False: both simultaneously
    proposer_may_stop: bool = True  # whether STOP is among the proposer's choices


_MOVES = {ProposalType.NONE: MDPMove.WAIT, ProposalType.STOP: MDPMove.STOP, ProposalType.EDIT: MDPMove.PROPOSAL}


def _critique(turn: TurnInput) -> TurnDecision:
    """As veto, but a rejection is free; after `exchanges` of them in a round the next proposal needs no answer."""
    if turn.exchanges_spent and not turn.is_answer:
        return TurnDecision(_MOVES[turn.proposal])
    return _veto(turn, rejection=MDPMove.NOTHING)


def _veto(turn: TurnInput, rejection: MDPMove = MDPMove.WAIT) -> TurnDecision:
    """The verifier must answer a proposal; a rejection uses up the round. Only the proposal STOP is a claim."""
    if not turn.is_answer:
        if turn.proposal is ProposalType.NONE:
            return TurnDecision(MDPMove.WAIT)
        return TurnDecision(MDPMove.NOTHING, needs_answer=True)
    claims = turn.proposal is ProposalType.STOP
    accepts = turn.answer == ACCEPT
    mdp_move = _MOVES[turn.proposal] if accepts else rejection
    return TurnDecision(mdp_move, accepted=accepts if claims else None, final=accepts and claims)


def _joint(turn: TurnInput) -> TurnDecision:
    """Both choose simultaneously; the verifier judges the scene before the edit, and alone may stop."""
    stops = turn.answer == ACCEPT
    return TurnDecision(MDPMove.STOP if stops else _MOVES[turn.proposal], accepted=stops, final=stops)


def _audit(turn: TurnInput) -> TurnDecision:
    """The proposer plays alone; its STOP is a claim, and the verifier's verdict on it ends the episode."""
    if turn.is_answer:
        return TurnDecision(MDPMove.STOP, accepted=turn.answer == ACCEPT, final=True)
    if turn.proposal is ProposalType.STOP:
        return TurnDecision(MDPMove.NOTHING, needs_answer=True)
    return TurnDecision(_MOVES[turn.proposal])


PROTOCOLS = {
    protocol.name: protocol
    for protocol in (
        GameProtocol(
            "veto",
            "The verifier accepts or rejects each proposal; a rejection uses up the round.",
            ("reject", "accept"),
            _veto,
        ),
        GameProtocol(
            "joint",
            "Both choose simultaneously; the verifier decides whether to stop.",
            ("continue", "stop"),
            _joint,
            turn_based=False,
            proposer_may_stop=False,
        ),
        GameProtocol(
            "audit",
            "The proposer edits alone; its STOP is a claim, which the verifier judges, ending the game.",
            ("does not hold", "holds"),
            _audit,
        ),
        GameProtocol(
            "critique",
            "As veto, but a number of rejections are free, and the verifier may send a message with one.",
            ("reject", "accept"),
            _critique,
            message_sizes=(0, 4),
        ),
    )
}


def register_protocol(protocol: GameProtocol) -> None:
    """Adds a protocol to the game. Raises ValueError for a name that is taken."""
    register("protocol", protocol.name, protocol, PROTOCOLS)
