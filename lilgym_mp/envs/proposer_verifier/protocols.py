"""The four protocols: who moves when, and what the choices of a turn do to the MDP.

Each is a pure function of its config and the turn. An illegal choice counts as no choice: the proposer uses up the
round, the verifier rejects, continues or gives the lowest verdict. `game.DecisionTable` tabulates all decisions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from lilgym_mp.envs.proposer_verifier.types import (
    BOTH_MOVE,
    ENDINGS,
    PROPOSER_MOVES,
    MDPMove,
    ProposalType,
    ProtocolConfig,
    Role,
    TurnDecision,
    TurnInput,
)

REJECT, ACCEPT, STOP = 0, 1, 2  # indices of the verifier's answers; in "joint", 0 continues and 1 stops

DecisionRule = Callable[[ProtocolConfig, TurnInput], TurnDecision]


@dataclass(frozen=True, slots=True)
class GameProtocol:
    """The rules of one protocol."""

    name: str
    endings: tuple[str, ...]  # valid names in ENDINGS, the default first
    first_movers: tuple[Role, ...]  # the agents to move when no proposal is pending
    answers: Callable[[ProtocolConfig], tuple[str, ...]]  # names of the verifier's choices, all legal in its turn
    decide: DecisionRule
    message_sizes: tuple[int, int] = (0, 0)  # default number of messages besides silence, by Role
    takes_bins: bool = False  # whether the verifier may state a probability

    @property
    def turn_based(self) -> bool:
        """Whether the agents move in turn rather than simultaneously."""
        return len(self.first_movers) == 1


def _veto(config: ProtocolConfig, turn: TurnInput) -> TurnDecision:
    """The verifier accepts or rejects each action; a rejection uses up the round."""
    if not turn.is_answer:
        return _submit(config, turn)
    if turn.answer in (ACCEPT, STOP):
        return _accept(turn)
    return TurnDecision(MDPMove.WAIT, probability=_claim_probability(turn, accepted=False))


def _critique(config: ProtocolConfig, turn: TurnInput) -> TurnDecision:
    """As veto, but a rejection is free; after `exchanges` of them in a round the next proposal needs no answer."""
    if not turn.is_answer:
        return TurnDecision(_mdp_move(turn)) if turn.exchanges_spent else _submit(config, turn)
    if turn.answer in (ACCEPT, STOP):
        return _accept(turn)
    return TurnDecision(MDPMove.NOTHING, rejects=True, probability=_claim_probability(turn, accepted=False))


def _submit(config: ProtocolConfig, turn: TurnInput) -> TurnDecision:
    """The verifier must answer the proposal, unless there is none or it is a STOP that needs no consent."""
    ends_alone = turn.proposal is ProposalType.STOP and config.ending.by_proposer
    if ends_alone or turn.proposal is ProposalType.NONE:
        return TurnDecision(_mdp_move(turn))
    return TurnDecision(MDPMove.NOTHING, needs_answer=True)


def _accept(turn: TurnInput) -> TurnDecision:
    """Plays the proposal; the answer STOP ends the episode instead."""
    if turn.answer == STOP:
        return TurnDecision(MDPMove.STOP, probability=1.0, final=True)
    return TurnDecision(
        _mdp_move(turn),
        probability=_claim_probability(turn, accepted=True),
        final=turn.proposal is ProposalType.STOP,
    )


def _claim_probability(turn: TurnInput, *, accepted: bool) -> float | None:
    """The stated probability of the claim; None unless STOP is proposed, since only that is a claim."""
    return float(accepted) if turn.proposal is ProposalType.STOP else None


_MOVES = {ProposalType.NONE: MDPMove.WAIT, ProposalType.STOP: MDPMove.STOP, ProposalType.EDIT: MDPMove.PROPOSAL}


def _mdp_move(turn: TurnInput) -> MDPMove:
    """What playing the proposal does to the MDP."""
    return _MOVES[turn.proposal]


def _joint(config: ProtocolConfig, turn: TurnInput) -> TurnDecision:
    """Both choose simultaneously; a stop is judged on the scene before the edit. A STOP that does not end the episode
    uses up the round."""
    ending = config.ending
    claims, stops = turn.proposal is ProposalType.STOP, turn.answer == ACCEPT
    ends = (claims and ending.by_proposer) or (stops and ending.by_verifier) or (claims and stops)
    mdp_move = MDPMove.STOP if ends else MDPMove.WAIT if claims else _mdp_move(turn)
    if ending.by_verifier or claims:
        return TurnDecision(mdp_move, probability=float(stops), final=ends)
    return TurnDecision(mdp_move)


def _audit(config: ProtocolConfig, turn: TurnInput) -> TurnDecision:
    """The proposer plays alone; its STOP is a claim, and the verifier's verdict on it ends the episode."""
    if turn.is_answer:
        probability = verdict_probability(config.verdict_bins, turn.answer or 0)
        return TurnDecision(MDPMove.STOP, probability=probability, final=True)
    if turn.proposal is ProposalType.STOP:
        return TurnDecision(MDPMove.NOTHING, needs_answer=True)
    return TurnDecision(_mdp_move(turn))


def verdict_probability(bins: int | None, verdict: int) -> float:
    """The midpoint of the verdict's bin among `bins` equal ones; 0 or 1 without bins."""
    return float(verdict) if bins is None else (verdict + 0.5) / bins


def _proposal_answers(config: ProtocolConfig) -> tuple[str, ...]:
    return ("reject", "accept", "stop") if config.ending.by_verifier else ("reject", "accept")


def _joint_answers(config: ProtocolConfig) -> tuple[str, ...]:
    return ("continue", "stop")


def _verdicts(config: ProtocolConfig) -> tuple[str, ...]:
    bins = config.verdict_bins
    if bins is None:
        return ("does not hold", "holds")
    return tuple(f"holds with probability {verdict_probability(bins, verdict):.3g}" for verdict in range(bins))


PROTOCOLS: Mapping[str, GameProtocol] = {
    protocol.name: protocol
    for protocol in (
        GameProtocol("veto", tuple(ENDINGS), PROPOSER_MOVES, _proposal_answers, _veto),
        GameProtocol("joint", ("verifier", "either", "agreement"), BOTH_MOVE, _joint_answers, _joint),
        GameProtocol("audit", ("proposer",), PROPOSER_MOVES, _verdicts, _audit, takes_bins=True),
        GameProtocol("critique", tuple(ENDINGS), PROPOSER_MOVES, _proposal_answers, _critique, message_sizes=(0, 4)),
    )
}
