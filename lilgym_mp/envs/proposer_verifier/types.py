"""The immutable types of the game: roles, endings, states, judgements, and the inputs and outputs of a protocol."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from lilgym_mp.rules import Dynamics, State, Transition

AGENTS = ("proposer_0", "verifier_0")  # by Role
SILENCE = 0  # the empty message
NO_CHOICE = -1  # sentinel for a missing or illegal choice
ACCEPTANCE_THRESHOLD = 0.5  # a stated probability above it accepts the claim
STOP_ACTION = 0  # index of the MDP's STOP (`appearances.Appearance`)


class Role(IntEnum):
    PROPOSER = 0
    VERIFIER = 1

    @property
    def other(self) -> Role:
        return Role(1 - self)


PROPOSER, VERIFIER = Role  # module constants: reading Role.PROPOSER takes ten times as long, in every step


class Intent(IntEnum):
    """The proposer's goal; drawn at reset when its reward is hidden."""

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
    by_agreement: bool  # the proposer, if the verifier accepts

    @property
    def proposer_may_stop(self) -> bool:
        """Whether STOP is among the proposer's choices."""
        return self.by_proposer or self.by_agreement


ENDINGS: Mapping[str, Ending] = {
    "agreement": Ending(by_proposer=False, by_verifier=False, by_agreement=True),
    "proposer": Ending(by_proposer=True, by_verifier=False, by_agreement=False),
    "verifier": Ending(by_proposer=False, by_verifier=True, by_agreement=False),
    "either": Ending(by_proposer=True, by_verifier=True, by_agreement=False),
}


class Judgement(NamedTuple):
    """The verifier's answer to the claim that the statement has the target value in the scene."""

    probability: float  # that the claim holds, as stated by the verifier; 0 or 1 for a plain rejection or acceptance
    final: bool  # whether it ends the episode
    holds: bool  # whether the claim is true

    @property
    def accepted(self) -> bool:
        """Whether the stated probability counts as acceptance."""
        return self.probability > ACCEPTANCE_THRESHOLD


class PastTurn(NamedTuple):
    """A turn in the history."""

    proposal: int  # or NO_CHOICE
    answer: int  # or NO_CHOICE
    messages: tuple[int, int]  # the last of each agent, by Role


class GameState(NamedTuple):
    """The state of a game. `mdp.steps` counts the rounds."""

    mdp: State
    movers: tuple[Role, ...]  # the agents to act; empty after the end
    intent: Intent
    proposal: int | None = None  # index of the proposed action that awaits the verifier's answer
    rejections: int = 0  # in this round
    messages: tuple[int, int] = (SILENCE, SILENCE)  # the last of each agent, by Role
    history: tuple[PastTurn, ...] = ()  # the last turns, oldest first


@dataclass(frozen=True, slots=True)
class ProtocolConfig:
    """The settings that a protocol's decisions depend on."""

    dynamics: Dynamics
    ending: Ending
    verdict_bins: int | None  # audit: None for a verdict without probability
    exchanges: int  # critique: rejections in a round before the next proposal needs no answer


class ProposalType(IntEnum):
    """What is proposed. STOP and EDIT are min(action index, 1)."""

    STOP = STOP_ACTION  # the claim that the statement has the target value
    EDIT = 1
    NONE = 2


class MDPMove(IntEnum):
    """What a turn does to the MDP. All but NOTHING use up a round."""

    NOTHING = 0
    WAIT = 1  # a step that leaves the scene unchanged
    PROPOSAL = 2
    STOP = 3


class TurnInput(NamedTuple):
    """What a protocol decides on, besides its ProtocolConfig."""

    is_answer: bool  # whether it is the verifier's turn; always False in simultaneous protocols
    proposal: ProposalType  # the proposer's choice; in the verifier's turn, the pending proposal
    answer: int | None  # the verifier's choice; None if illegal or in the proposer's turn
    exchanges_spent: bool  # whether this round has had all the rejections allowed


class TurnDecision(NamedTuple):
    """A protocol's decision on a turn."""

    mdp_move: MDPMove
    needs_answer: bool = False  # whether the verifier moves next, to answer the proposal
    rejects: bool = False  # whether it adds a rejection to the round
    probability: float | None = None  # `Judgement.probability`; None if the verifier judged no claim
    final: bool = False  # `Judgement.final`


class GameStep(NamedTuple):
    """The result of one turn. Pairs are by Role."""

    state: GameState
    rewards: tuple[float, float]
    terminated: bool
    truncated: bool
    transition: Transition | None  # of the MDP; None if it took no step
    illegal: tuple[bool, bool]  # whose choice was illegal, so counted as no choice
    decision: TurnDecision
    mdp_before: State  # the judged scene is that of this state

    @property
    def judgement(self) -> Judgement | None:
        """The verifier's judgement of a claim in this turn, if any."""
        decision, state = self.decision, self.mdp_before
        if decision.probability is None:
            return None
        return Judgement(decision.probability, decision.final, state.task.solved_by(state.scene))
