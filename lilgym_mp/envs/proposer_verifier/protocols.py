"""The four protocols: who moves when, and what the choices of a turn do to the MDP underneath.

Each is a pure function of the conditions, the state and the choices: the proposer's, a number of an action of
the MDP, and the verifier's, the place of its answer in `answers`. None stands for an agent whose turn it is not, and
for an illegal choice: it counts as having chosen nothing. A proposer who proposes nothing spends the round; a
verifier who answers nothing has accepted, stopped and believed nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from lilgym_mp.envs.proposer_verifier.states import (
    BOTH_MOVE,
    PROPOSER_MOVES,
    STOP_ACTION,
    VERIFIER_MOVES,
    Conditions,
    GameState,
    Judgement,
    Role,
    Ruling,
)
from lilgym_mp.rules import Transition

REJECT, ACCEPT, STOP = 0, 1, 2  # places among the verifier's answers; in "joint", 0 continues and 1 stops

Decision = Callable[[Conditions, GameState, int | None, int | None], Ruling]


@dataclass(frozen=True, slots=True)
class GameProtocol:
    """How a game is played."""

    name: str
    endings: tuple[str, ...]  # names in ENDINGS that make sense here; the first is the default
    first: tuple[Role, ...]  # who moves first
    answers: Callable[[Conditions], tuple[str, ...]]  # the verifier's choices, all legal when it is its turn
    decide: Decision
    message_sizes: tuple[int, int] = (0, 0)  # default number of words, by Role
    takes_bins: bool = False  # whether the verifier may state a probability

    @property
    def simultaneous(self) -> bool:
        return len(self.first) > 1


def _veto(conditions: Conditions, state: GameState, proposal: int | None, answer: int | None) -> Ruling:
    """The verifier accepts or rejects each action; a rejection spends the round."""
    if state.movers == PROPOSER_MOVES:
        return _proposed(conditions, state, proposal)
    if answer in (ACCEPT, STOP):
        return _accepted(conditions, state, answer)
    judgement = _judged_claim(state, accepted=False)
    return Ruling(conditions.dynamics.wait(state.mdp), PROPOSER_MOVES, judgement=judgement)


def _critique(conditions: Conditions, state: GameState, proposal: int | None, answer: int | None) -> Ruling:
    """As veto, but a rejection is free; after `exchanges` of them in a round the next proposal counts unasked."""
    if state.movers == PROPOSER_MOVES:
        if state.rejections >= conditions.exchanges:
            return Ruling(_counted(conditions, state, proposal), PROPOSER_MOVES)
        return _proposed(conditions, state, proposal)
    if answer in (ACCEPT, STOP):
        return _accepted(conditions, state, answer)
    judgement = _judged_claim(state, accepted=False)
    return Ruling(None, PROPOSER_MOVES, rejections=state.rejections + 1, judgement=judgement)


def _proposed(conditions: Conditions, state: GameState, proposal: int | None) -> Ruling:
    """The proposal is laid before the verifier, unless there is none or it ends the episode by itself."""
    if proposal is None or (proposal == STOP_ACTION and conditions.ending.by_proposer):
        return Ruling(_counted(conditions, state, proposal), PROPOSER_MOVES)
    return Ruling(None, VERIFIER_MOVES, proposal, state.rejections)


def _accepted(conditions: Conditions, state: GameState, answer: int) -> Ruling:
    """The proposal counts; with the answer STOP the verifier ends the episode in its place."""
    stops = answer == STOP
    played = _counted(conditions, state, STOP_ACTION if stops else state.proposal)
    judgement = Judgement(state.mdp, 1.0, final=True) if stops else _judged_claim(state, accepted=True)
    return Ruling(played, PROPOSER_MOVES, judgement=judgement)


def _judged_claim(state: GameState, *, accepted: bool) -> Judgement | None:
    """Only a proposed STOP claims something."""
    return Judgement(state.mdp, float(accepted), final=accepted) if state.proposal == STOP_ACTION else None


def _counted(conditions: Conditions, state: GameState, action: int | None) -> Transition:
    """What the MDP makes of an action, or of none."""
    dynamics = conditions.dynamics
    if action is None:
        return dynamics.wait(state.mdp)
    return dynamics.step(state.mdp, dynamics.appearance.decode(action))


def _joint(conditions: Conditions, state: GameState, proposal: int | None, answer: int | None) -> Ruling:
    """Both choose at once; a stop is judged on the scene before the edit. A STOP that does not end spends the round."""
    ending = conditions.ending
    claims, stops = proposal == STOP_ACTION, answer == ACCEPT
    ends = (claims and ending.by_proposer) or (stops and ending.by_verifier) or (claims and stops)
    judgement = None
    if ending.by_verifier or claims:
        judgement = Judgement(state.mdp, float(stops), final=ends)
    played = _counted(conditions, state, STOP_ACTION if ends else None if claims else proposal)
    return Ruling(played, BOTH_MOVE, judgement=judgement)


def _audit(conditions: Conditions, state: GameState, proposal: int | None, answer: int | None) -> Ruling:
    """The proposer plays alone; its STOP is a claim, which the verifier's verdict ends the episode with."""
    if state.movers == PROPOSER_MOVES:
        if proposal == STOP_ACTION:
            return Ruling(None, VERIFIER_MOVES, proposal)
        return Ruling(_counted(conditions, state, proposal), PROPOSER_MOVES)
    probability = verdict_probability(conditions.verdict_bins, answer or 0)
    judgement = Judgement(state.mdp, probability, final=True)
    return Ruling(_counted(conditions, state, STOP_ACTION), PROPOSER_MOVES, judgement=judgement)


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
