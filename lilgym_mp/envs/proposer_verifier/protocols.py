"""The four protocols: who moves when, and what the choices of a turn do to the MDP underneath.

Each is a pure function of the conditions and the case. An illegal choice counts as having chosen nothing: a proposer
who proposes nothing spends the round; a verifier who answers nothing has accepted, stopped and believed nothing.
`rulebook` works the decisions out for every case there is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from lilgym_mp.envs.proposer_verifier.states import (
    BOTH_MOVE,
    PROPOSER_MOVES,
    Case,
    Conditions,
    Counted,
    Proposal,
    Role,
    Ruling,
)

REJECT, ACCEPT, STOP = 0, 1, 2  # places among the verifier's answers; in "joint", 0 continues and 1 stops

Decision = Callable[[Conditions, Case], Ruling]


@dataclass(frozen=True, slots=True)
class GameProtocol:
    """How a game is played."""

    name: str
    endings: tuple[str, ...]  # names in ENDINGS that make sense here; the first is the default
    first: tuple[Role, ...]  # who moves first, and whenever no proposal awaits an answer
    answers: Callable[[Conditions], tuple[str, ...]]  # the verifier's choices, all legal when it is its turn
    decide: Decision
    message_sizes: tuple[int, int] = (0, 0)  # default number of words, by Role
    takes_bins: bool = False  # whether the verifier may state a probability

    @property
    def simultaneous(self) -> bool:
        return len(self.first) > 1


def _veto(conditions: Conditions, case: Case) -> Ruling:
    """The verifier accepts or rejects each action; a rejection spends the round."""
    if not case.is_answer:
        return _proposed(conditions, case)
    if case.answer in (ACCEPT, STOP):
        return _accepted(case)
    return Ruling(Counted.WAIT, probability=_of_claim(case, accepted=False))


def _critique(conditions: Conditions, case: Case) -> Ruling:
    """As veto, but a rejection is free; after `exchanges` of them in a round the next proposal counts unasked."""
    if not case.is_answer:
        return Ruling(_counted(case)) if case.exchanges_are_spent else _proposed(conditions, case)
    if case.answer in (ACCEPT, STOP):
        return _accepted(case)
    return Ruling(Counted.NOTHING, rejects=True, probability=_of_claim(case, accepted=False))


def _proposed(conditions: Conditions, case: Case) -> Ruling:
    """The proposal is laid before the verifier, unless there is none or it ends the episode by itself."""
    ends_alone = case.proposal is Proposal.STOP and conditions.ending.by_proposer
    if ends_alone or case.proposal is Proposal.NONE:
        return Ruling(_counted(case))
    return Ruling(Counted.NOTHING, asks=True)


def _accepted(case: Case) -> Ruling:
    """The proposal counts; with the answer STOP the verifier ends the episode in its place."""
    if case.answer == STOP:
        return Ruling(Counted.STOP, probability=1.0, final=True)
    return Ruling(_counted(case), probability=_of_claim(case, accepted=True), final=case.proposal is Proposal.STOP)


def _of_claim(case: Case, *, accepted: bool) -> float | None:
    """The probability that the answer states. Only a proposed STOP claims something."""
    return float(accepted) if case.proposal is Proposal.STOP else None


_COUNTED = {Proposal.NONE: Counted.WAIT, Proposal.STOP: Counted.STOP, Proposal.EDIT: Counted.PROPOSAL}


def _counted(case: Case) -> Counted:
    """The proposal, or a step that leaves the scene where there is none."""
    return _COUNTED[case.proposal]


def _joint(conditions: Conditions, case: Case) -> Ruling:
    """Both choose at once; a stop is judged on the scene before the edit. A STOP that does not end spends the round."""
    ending = conditions.ending
    claims, stops = case.proposal is Proposal.STOP, case.answer == ACCEPT
    ends = (claims and ending.by_proposer) or (stops and ending.by_verifier) or (claims and stops)
    counted = Counted.STOP if ends else Counted.WAIT if claims else _counted(case)
    if ending.by_verifier or claims:
        return Ruling(counted, probability=float(stops), final=ends)
    return Ruling(counted)


def _audit(conditions: Conditions, case: Case) -> Ruling:
    """The proposer plays alone; its STOP is a claim, which the verifier's verdict ends the episode with."""
    if case.is_answer:
        probability = verdict_probability(conditions.verdict_bins, case.answer or 0)
        return Ruling(Counted.STOP, probability=probability, final=True)
    if case.proposal is Proposal.STOP:
        return Ruling(Counted.NOTHING, asks=True)
    return Ruling(_counted(case))


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
