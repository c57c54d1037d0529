"""The four protocols: who moves when, and what the choices of a turn do to the MDP underneath.

Each is a pure function of the conditions and the turn. An illegal choice counts as having chosen nothing: a proposer
who proposes nothing spends the round; a verifier who answers nothing has accepted, stopped and believed nothing.
`decision_table` works the decisions out for every case there is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from lilgym_mp.envs.proposer_verifier.states import (
    BOTH_MOVE,
    PROPOSER_MOVES,
    Conditions,
    MDPMove,
    Proposal,
    Role,
    TurnDecision,
    TurnInput,
)

REJECT, ACCEPT, STOP = 0, 1, 2  # places among the verifier's answers; in "joint", 0 continues and 1 stops

DecisionRule = Callable[[Conditions, TurnInput], TurnDecision]


@dataclass(frozen=True, slots=True)
class GameProtocol:
    """How a game is played."""

    name: str
    endings: tuple[str, ...]  # names in ENDINGS that make sense here; the first is the default
    first: tuple[Role, ...]  # who moves first, and whenever no proposal awaits an answer
    answers: Callable[[Conditions], tuple[str, ...]]  # the verifier's choices, all legal when it is its turn
    decide: DecisionRule
    message_sizes: tuple[int, int] = (0, 0)  # default number of words, by Role
    takes_bins: bool = False  # whether the verifier may state a probability

    @property
    def simultaneous(self) -> bool:
        return len(self.first) > 1


def _veto(conditions: Conditions, turn: TurnInput) -> TurnDecision:
    """The verifier accepts or rejects each action; a rejection spends the round."""
    if not turn.is_answer:
        return _proposed(conditions, turn)
    if turn.answer in (ACCEPT, STOP):
        return _accepted(turn)
    return TurnDecision(MDPMove.WAIT, probability=_of_claim(turn, accepted=False))


def _critique(conditions: Conditions, turn: TurnInput) -> TurnDecision:
    """As veto, but a rejection is free; after `exchanges` of them in a round the next proposal counts unasked."""
    if not turn.is_answer:
        return TurnDecision(_move_of(turn)) if turn.exchanges_are_spent else _proposed(conditions, turn)
    if turn.answer in (ACCEPT, STOP):
        return _accepted(turn)
    return TurnDecision(MDPMove.NOTHING, rejects=True, probability=_of_claim(turn, accepted=False))


def _proposed(conditions: Conditions, turn: TurnInput) -> TurnDecision:
    """The proposal is laid before the verifier, unless there is none or it ends the episode by itself."""
    ends_alone = turn.proposal is Proposal.STOP and conditions.ending.by_proposer
    if ends_alone or turn.proposal is Proposal.NONE:
        return TurnDecision(_move_of(turn))
    return TurnDecision(MDPMove.NOTHING, asks=True)


def _accepted(turn: TurnInput) -> TurnDecision:
    """The proposal counts; with the answer STOP the verifier ends the episode in its place."""
    if turn.answer == STOP:
        return TurnDecision(MDPMove.STOP, probability=1.0, final=True)
    return TurnDecision(
        _move_of(turn),
        probability=_of_claim(turn, accepted=True),
        final=turn.proposal is Proposal.STOP,
    )


def _of_claim(turn: TurnInput, *, accepted: bool) -> float | None:
    """The probability that the answer states. Only a proposed STOP claims something."""
    return float(accepted) if turn.proposal is Proposal.STOP else None


_MOVES = {Proposal.NONE: MDPMove.WAIT, Proposal.STOP: MDPMove.STOP, Proposal.EDIT: MDPMove.PROPOSAL}


def _move_of(turn: TurnInput) -> MDPMove:
    """The proposal, or a step that leaves the scene where there is none."""
    return _MOVES[turn.proposal]


def _joint(conditions: Conditions, turn: TurnInput) -> TurnDecision:
    """Both choose at once; a stop is judged on the scene before the edit. A STOP that does not end spends the round."""
    ending = conditions.ending
    claims, stops = turn.proposal is Proposal.STOP, turn.answer == ACCEPT
    ends = (claims and ending.by_proposer) or (stops and ending.by_verifier) or (claims and stops)
    mdp_move = MDPMove.STOP if ends else MDPMove.WAIT if claims else _move_of(turn)
    if ending.by_verifier or claims:
        return TurnDecision(mdp_move, probability=float(stops), final=ends)
    return TurnDecision(mdp_move)


def _audit(conditions: Conditions, turn: TurnInput) -> TurnDecision:
    """The proposer plays alone; its STOP is a claim, which the verifier's verdict ends the episode with."""
    if turn.is_answer:
        probability = verdict_probability(conditions.verdict_bins, turn.answer or 0)
        return TurnDecision(MDPMove.STOP, probability=probability, final=True)
    if turn.proposal is Proposal.STOP:
        return TurnDecision(MDPMove.NOTHING, asks=True)
    return TurnDecision(_move_of(turn))


def verdict_probability(bins: int | None, verdict: int) -> float:
    """The middle of the verdict's bin among `bins` equal ones; for a plain verdict (None) 0 or 1."""
    return float(verdict) if bins is None else (verdict + 0.5) / bins


def _answers_to_proposals(conditions: Conditions) -> tuple[str, ...]:
    return ("reject", "accept", "stop") if conditions.ending.by_verifier else ("reject", "accept")


def _answers_at_once(conditions: Conditions) -> tuple[str, ...]:
    return ("continue", "stop")


def _verdicts(conditions: Conditions) -> tuple[str, ...]:
    bins = conditions.verdict_bins
    if bins is None:
        return ("does not hold", "holds")
    return tuple(f"holds with probability {verdict_probability(bins, verdict):.3g}" for verdict in range(bins))


PROTOCOLS: Mapping[str, GameProtocol] = {
    protocol.name: protocol
    for protocol in (
        GameProtocol(
            "veto", ("agreement", "proposer", "verifier", "either"), PROPOSER_MOVES, _answers_to_proposals, _veto
        ),
        GameProtocol("joint", ("verifier", "either", "agreement"), BOTH_MOVE, _answers_at_once, _joint),
        GameProtocol("audit", ("proposer",), PROPOSER_MOVES, _verdicts, _audit, takes_bins=True),
        GameProtocol(
            "critique",
            ("agreement", "proposer", "verifier", "either"),
            PROPOSER_MOVES,
            _answers_to_proposals,
            _critique,
            message_sizes=(0, 4),
        ),
    )
}
