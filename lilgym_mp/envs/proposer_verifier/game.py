"""The rules of one game: actions, their names and masks, and a table of all decisions and rewards."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import SupportsIndex

import numpy as np

from lilgym_mp.envs.proposer_verifier.protocols import (
    AGENTS,
    PROPOSER,
    STOP_ACTION,
    VERIFIER,
    GameProtocol,
    MDPMove,
    ProposalType,
    ProtocolConfig,
    Role,
    TurnDecision,
    TurnInput,
)
from lilgym_mp.envs.proposer_verifier.rewards import Intent, RewardScheme, judgement_in
from lilgym_mp.scene.actions import checked_index, describe
from lilgym_mp.scene.arrays import BoolArray, Float64Array, Int8Array, Int64Array

SILENCE = 0  # the empty message
WAIT_NAME = "wait"


class TurnError(ValueError):
    """An agent did not act in its turn, or actions are not for exactly both agents."""


class DecisionTable:
    """Lookup table of every decision of the protocol and every reward, computed once per game."""

    decisions: tuple[TurnDecision, ...]
    # (turns, proposal types, answers, 2) index of the decision, by the fields of TurnInput. The last proposal type and
    # the last answer mean no choice, so that NO_CHOICE (-1) indexes them.
    indices: Int64Array
    # (2, decisions, results + 1, 2, 2) rewards, indexed by role, decision, the MDP's StepResult, whether the claim
    # holds, and Intent.
    rewards: Float64Array
    no_mdp_step: int  # index used for the StepResult if the MDP takes no step
    # By index of the decision:
    mdp_moves: Int64Array  # (decisions,)
    needs_answer: BoolArray  # (decisions,)
    probabilities: Float64Array  # (decisions,) NaN without a judgement
    needs_truth: BoolArray  # (decisions,) whether rewards depend on whether the claim holds

    def __init__(self, protocol: GameProtocol, config: ProtocolConfig, rewards: RewardScheme) -> None:
        found: dict[TurnDecision, int] = {}
        answers = (*range(len(protocol.answers(config))), None)
        turns = (False, True) if protocol.turn_based else (False,)
        self.indices = np.empty((len(turns), len(ProposalType), len(answers), 2), np.int64)
        for turn, kind, answer, spent in np.ndindex(self.indices.shape):
            turn_input = TurnInput(turns[turn], ProposalType(kind), answers[answer], bool(spent))
            decision = protocol.decide(config, turn_input)
            self.indices[turn, kind, answer, spent] = found.setdefault(decision, len(found))
        self.decisions = tuple(found)
        mdp_moves, needs_answer, probabilities, _ = zip(*self.decisions, strict=True)
        self.mdp_moves, self.needs_answer = np.array(mdp_moves, np.int64), np.array(needs_answer)
        self.probabilities = np.array(probabilities, np.float64)
        results = config.dynamics.step_results
        self.no_mdp_step = len(results)
        mdp_rewards = [*(result.reward for result in results), 0.0]
        self.rewards = np.empty((len(Role), len(found), len(mdp_rewards), 2, len(Intent)))
        for index, result, holds, intent in np.ndindex(self.rewards.shape[1:]):
            judgement = judgement_in(self.decisions[index], holds=bool(holds))
            self.rewards[:, index, result, holds, intent] = rewards(mdp_rewards[result], judgement, Intent(intent))
        self.needs_truth = (self.rewards[..., 0, :] != self.rewards[..., 1, :]).any(axis=(0, 2, 3))


def _frozen_mask(size: int, legal: Iterable[int]) -> Int8Array:
    mask = np.zeros(size, np.int8)
    mask[list(legal)] = 1
    mask.flags.writeable = False
    return mask


@dataclass(eq=False, repr=False)
class Game:
    """The rules of one game; `game_arrays.GameArrays` plays it.

    An agent's action is choice x (message_size + 1) + message. The proposer's choices are the actions of the MDP, the
    verifier's the answers of the protocol. In turn-based protocols there is one more choice, "wait", the only legal
    one out of turn. Message 0 is silence.
    """

    protocol: GameProtocol
    config: ProtocolConfig
    rewards: RewardScheme
    message_sizes: tuple[int, int]  # number of messages besides silence, indexed by role
    message_cost: float  # to the sender, for each message but silence
    history_length: int  # turns kept
    homogeneous: bool  # both action spaces have the size of the larger one; the surplus actions are illegal

    def __post_init__(self) -> None:
        dynamics, ending = self.config.dynamics, self.config.ending
        self.turn_based = self.protocol.turn_based
        self.decision_table = table = DecisionTable(self.protocol, self.config, self.rewards)
        # Legal in an agent's turn, indexed by role; "wait" follows them.
        edits_and_stop = range(
            STOP_ACTION if ending.proposer_may_stop else STOP_ACTION + 1, dynamics.appearance.action_count
        )
        self.choices = (edits_and_stop, range(len(self.protocol.answers(self.config))))
        stops = [self.encode_action(role, self.choices[role].stop) for role in Role]
        counts = [self.encode_action(role, self.choices[role].stop + self.turn_based) for role in Role]
        proposer, verifier = [max(counts)] * 2 if self.homogeneous else counts
        self.action_counts = (proposer, verifier)  # indexed by role
        self.wait_actions = [stop if self.turn_based else None for stop in stops]  # indexed by role
        self.wait_masks = [  # out of turn, indexed by role
            _frozen_mask(count, [] if wait is None else [wait])
            for count, wait in zip(self.action_counts, self.wait_actions, strict=True)
        ]
        self._stop = stops[PROPOSER]  # the proposer's actions from here on are illegal in its turn
        self._may_stop = ending.proposer_may_stop
        self.answer_mask = _frozen_mask(verifier, range(stops[VERIFIER]))  # the verifier's in its turn
        # Whether a rejection can cost no round.
        self.has_free_rejections = bool(((table.mdp_moves == MDPMove.NOTHING) & ~table.needs_answer).any())
        # Whether a proposal can be refused and the episode go on.
        self.has_refusals = self.turn_based and bool((table.mdp_moves[table.indices[1]] < MDPMove.PROPOSAL).any())

    def proposer_masks(self, legal: BoolArray) -> Int8Array:
        """(..., actions) masks of proposers in their turn, new arrays, from the MDP's (..., choices)."""
        messages, count = self.message_sizes[PROPOSER] + 1, self.action_counts[PROPOSER]
        if legal.shape[-1] == count:
            masks = legal.astype(np.int8)
        else:
            masks = np.zeros((*legal.shape[:-1], count), np.int8)
            masks[..., : self._stop] = legal if messages == 1 else legal.repeat(messages, axis=-1)
        if not self._may_stop:
            masks[..., :messages] = 0
        return masks

    def checked_action(self, role: Role, action: SupportsIndex) -> int:
        """`action` as an int. Raises ActionError if it is not in the action space of `role`."""
        if type(action) is int and 0 <= action < self.action_counts[role]:  # fast path
            return action
        return checked_index(action, self.action_counts[role], AGENTS[role])

    def describe(self, role: Role, action: SupportsIndex) -> str:
        """An action's name, such as "ADD(LEFT, BLUE)", "accept" or "reject, message 2"."""
        choice, message = divmod(self.checked_action(role, action), self.message_sizes[role] + 1)
        if choice >= self.choices[role].stop:
            name = WAIT_NAME
        elif role is PROPOSER:
            name = describe(self.config.dynamics.appearance.decode(choice))
        else:
            name = self.protocol.answers(self.config)[choice]
        return f"{name}, message {message}" if message else name

    def encode_action(self, role: Role, choice: int, message: int = SILENCE) -> int:
        """The index of the action that makes `choice` and sends `message`."""
        return choice * (self.message_sizes[role] + 1) + message
