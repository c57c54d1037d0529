"""What a game of proposer and verifier is made of: immutable states, judgements, and what a protocol decides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from lilgym_mp.rules import Dynamics, State, Transition

AGENTS = ("proposer_0", "verifier_0")  # by Role
SILENCE = 0  # the word that says nothing
NO_CHOICE = -1  # in what is remembered of a turn
ACCEPTS_ABOVE = 0.5  # a verifier that states a higher probability of a claim accepts it
STOP_ACTION = 0  # the MDP's STOP among its numbered actions (`appearances.Appearance`)


class Role(IntEnum):
    PROPOSER = 0
    VERIFIER = 1

    @property
    def other(self) -> Role:
        return Role(1 - self)


PROPOSER, VERIFIER = Role  # reading a member off its enum costs ten times as much, in every step


class Intent(IntEnum):
    """What a proposer is out for; drawn at reset when its reward is hidden."""

    HELPFUL = 0
    SNEAKY = 1


PROPOSER_MOVES: tuple[Role, ...] = (PROPOSER,)
VERIFIER_MOVES: tuple[Role, ...] = (VERIFIER,)
BOTH_MOVE: tuple[Role, ...] = (PROPOSER, VERIFIER)
NOBODY_MOVES: tuple[Role, ...] = ()


@dataclass(frozen=True, slots=True)
class Ending:
    """Who may end the episode with a STOP."""

    by_proposer: bool  # the proposer alone
    by_verifier: bool  # the verifier alone
    together: bool  # the proposer, when the verifier accepts

    @property
    def proposer_may_stop(self) -> bool:
        """Whether STOP is among the proposer's choices."""
        return self.by_proposer or self.together


ENDINGS: Mapping[str, Ending] = {
    "agreement": Ending(by_proposer=False, by_verifier=False, together=True),
    "proposer": Ending(by_proposer=True, by_verifier=False, together=False),
    "verifier": Ending(by_proposer=False, by_verifier=True, together=False),
    "either": Ending(by_proposer=True, by_verifier=True, together=False),
}


class Judgement(NamedTuple):
    """The verifier's answer to the claim that the statement has the target value in the scene."""

    probability: float  # that the claim holds, as the verifier states it; 0 or 1 where it just accepts or rejects
    final: bool  # whether the episode ends with it
    holds: bool  # whether the claim is true

    @property
    def accepted(self) -> bool:
        """Whether a verifier that states this probability accepts the claim."""
        return self.probability > ACCEPTS_ABOVE


class PastTurn(NamedTuple):
    """What history keeps of a turn."""

    proposal: int  # NO_CHOICE where there was none
    answer: int
    words: tuple[int, int]  # the last of each, by Role


class GameState(NamedTuple):
    """The state of a game. `mdp.steps` counts the rounds spent."""

    mdp: State
    movers: tuple[Role, ...]  # whose turn it is; empty after the end
    intent: Intent
    proposal: int | None = None  # number of the action that the verifier is asked about
    rejections: int = 0  # in this round
    words: tuple[int, int] = (SILENCE, SILENCE)  # the last of each, by Role
    history: tuple[PastTurn, ...] = ()  # the last turns, oldest first


@dataclass(frozen=True, slots=True)
class Conditions:
    """What holds throughout a game, beside its protocol."""

    dynamics: Dynamics
    ending: Ending
    verdict_bins: int | None  # audit: None for a plain verdict
    exchanges: int  # critique: rejections before a proposal counts unasked


class Proposal(IntEnum):
    """What the verifier is asked about, or would be; numbered as the actions of the MDP are as far as possible."""

    STOP = STOP_ACTION  # the claim that the statement has the target value
    EDIT = 1  # any edit
    NONE = 2


class MDPMove(IntEnum):
    """What a turn has the MDP do. All but NOTHING spend a round."""

    NOTHING = 0
    WAIT = 1  # a step that leaves the scene
    PROPOSAL = 2
    STOP = 3


class TurnInput(NamedTuple):
    """All that a protocol's decision depends on beside the conditions."""

    is_answer: bool  # whether it is the verifier's turn, where agents take turns
    proposal: Proposal  # the proposer's choice, or in the verifier's turn the one that awaits an answer
    answer: int | None  # the verifier's choice; None for an illegal one, and in the proposer's turn
    exchanges_are_spent: bool  # whether a further rejection in this round would be one too many


class TurnDecision(NamedTuple):
    """What a protocol decides in a turn."""

    mdp_move: MDPMove
    asks: bool = False  # whether the verifier is asked about the proposal: the next turn is its own
    rejects: bool = False  # whether the round has one rejection more
    probability: float | None = None  # the judgement's, where the verifier has judged a claim
    final: bool = False  # the judgement's


class GameStep(NamedTuple):
    """What a turn made of a state. Pairs are by Role."""

    state: GameState
    rewards: tuple[float, float]
    terminated: bool
    truncated: bool
    played: Transition | None
    illegal: tuple[bool, bool]  # whose choice was not legal, and so counted as none
    decision: TurnDecision
    before: State  # the MDP's, whose scene is judged where anything is

    @property
    def judgement(self) -> Judgement | None:
        """The verifier's answer to a claim in this turn; None where it answered none."""
        decision, state = self.decision, self.before
        if decision.probability is None:
            return None
        return Judgement(decision.probability, decision.final, state.task.solved_by(state.scene))
