"""The core of the game: actions, masks, and the pure step function."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple, SupportsIndex

import numpy as np

from lilgym_mp.actions import checked_index, describe
from lilgym_mp.arrays import BoolArray, Int8Array
from lilgym_mp.envs.proposer_verifier.protocols import (
    AGENTS,
    NO_CHOICE,
    NOBODY_MOVES,
    PROPOSER,
    STOP_ACTION,
    VERIFIER,
    VERIFIER_MOVES,
    GameProtocol,
    MDPMove,
    ProposalType,
    ProtocolConfig,
    Role,
    TurnDecision,
    TurnInput,
)
from lilgym_mp.envs.proposer_verifier.rewards import Intent, Judgement, RewardScheme, judgement_in
from lilgym_mp.rules import State, Transition
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task
from lilgym_mp.tuples import new_tuple

SILENCE = 0  # the empty message
INT8 = np.dtype(np.int8)
WAIT_NAME = "wait"
NOTHING, WAIT, PROPOSAL, STOP = MDPMove  # module constants: faster to read than enum members
EDIT = int(ProposalType.EDIT)

Pair = tuple[float, float]  # by Role


class TurnError(ValueError):
    """An agent acted out of turn, did not act in its turn, or acted after the end."""


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
    refused: int | None = None  # index of the action refused last; None once an action has been played
    rejections: int = 0  # in this round
    messages: tuple[int, int] = (SILENCE, SILENCE)  # the last of each agent, by Role
    history: tuple[PastTurn, ...] = ()  # the last turns, oldest first


class GameStep(NamedTuple):
    """The result of one turn. Pairs are by Role."""

    state: GameState
    rewards: Pair
    terminated: bool
    truncated: bool
    transition: Transition | None  # of the MDP; None if it took no step
    illegal: tuple[bool, bool]  # whose choice was illegal, so counted as no choice
    decision: TurnDecision
    mdp_before: State  # the judged scene is that of this state

    @property
    def judgement(self) -> Judgement | None:
        """The verifier's judgement of a claim in this turn, if any."""
        if self.decision.probability is None:
            return None
        return judgement_in(self.decision, holds=self.mdp_before.task.solved_by(self.mdp_before.scene))


class DecisionTable:
    """Lookup table of every decision of the protocol and every reward, computed once per game.

    `Game.step` reads one entry; `game_arrays` indexes it for many games at once.
    """

    decisions: tuple[TurnDecision, ...]
    # Index of the decision, by: is_answer, ProposalType, answer, exchanges_spent (the fields of TurnInput). The last
    # proposal type and the last answer mean no choice, so that NO_CHOICE (-1) indexes them.
    indices: list[list[list[list[int]]]]
    # Both agents' rewards, by: index of the decision, index of the MDP's StepResult, whether the claim holds, Intent.
    rewards: list[list[list[list[Pair]]]]
    no_mdp_step: int  # index used for the StepResult if the MDP takes no step
    needs_truth: list[bool]  # by index of the decision: whether its rewards depend on whether the claim holds

    def __init__(self, protocol: GameProtocol, config: ProtocolConfig, rewards: RewardScheme) -> None:
        found: dict[TurnDecision, int] = {}

        def index(turn_input: TurnInput) -> int:
            return found.setdefault(protocol.decide(config, turn_input), len(found))

        answers = (*range(len(protocol.answers(config))), None)
        turns = (False, True) if protocol.turn_based else (False,)
        self.indices = [
            [
                [[index(TurnInput(turn, proposal, answer, spent)) for spent in (False, True)] for answer in answers]
                for proposal in ProposalType
            ]
            for turn in turns
        ]
        self.decisions = tuple(found)
        results = config.dynamics.step_results
        self.no_mdp_step = len(results)
        mdp_rewards = [*(result.reward for result in results), 0.0]
        self.rewards = [
            [
                [
                    [rewards(reward, judgement_in(decision, holds=holds), intent) for intent in Intent]
                    for holds in (False, True)
                ]
                for reward in mdp_rewards
            ]
            for decision in self.decisions
        ]
        self.needs_truth = [any(false != true for false, true in pairs) for pairs in self.rewards]


def _frozen_mask(size: int, legal: Iterable[int]) -> Int8Array:
    mask = np.zeros(size, np.int8)
    mask[list(legal)] = 1
    mask.flags.writeable = False
    return mask


@dataclass(eq=False, repr=False)
class Game:
    """The rules of one game, as pure functions of states.

    An agent's action is choice x (message_size + 1) + message. The proposer's choices are the actions of the MDP, the
    verifier's the answers of the protocol. In turn-based protocols there is one more choice, "wait", the only legal
    one out of turn. Message 0 is silence.
    """

    protocol: GameProtocol
    config: ProtocolConfig
    rewards: RewardScheme
    message_sizes: tuple[int, int]  # number of messages besides silence, by Role
    message_cost: float  # to the sender, for each message but silence
    history_length: int  # turns kept in the state
    homogeneous: bool  # both action spaces have the size of the larger one; the surplus actions are illegal

    def __post_init__(self) -> None:
        dynamics, ending = self.config.dynamics, self.config.ending
        self.turn_based = self.protocol.turn_based
        self.decision_table = DecisionTable(self.protocol, self.config, self.rewards)
        # Legal in an agent's turn, by Role; "wait" follows them.
        edits_and_stop = range(
            STOP_ACTION if ending.proposer_may_stop else STOP_ACTION + 1, dynamics.appearance.action_count
        )
        self.choices = (edits_and_stop, range(len(self.protocol.answers(self.config))))
        stops = [self.encode_action(role, self.choices[role].stop) for role in Role]
        counts = [self.encode_action(role, self.choices[role].stop + self.turn_based) for role in Role]
        proposer, verifier = [max(counts)] * 2 if self.homogeneous else counts
        self.action_counts = (proposer, verifier)  # by Role
        self.wait_actions = [stop if self.turn_based else None for stop in stops]  # by Role
        self.wait_masks = [  # out of turn, by Role
            _frozen_mask(count, [] if wait is None else [wait])
            for count, wait in zip(self.action_counts, self.wait_actions, strict=True)
        ]
        self.answer_mask = _frozen_mask(verifier, range(stops[VERIFIER]))  # the verifier's in its turn
        self._has_messages = any(self.message_sizes)
        # Whether a proposal can be refused and the episode go on.
        self.has_refusals = self.turn_based and any(
            self.decision_table.decisions[index].mdp_move < PROPOSAL
            for answers in self.decision_table.indices[True]
            for indices in answers
            for index in indices
        )
        self._proposer_mask_is_mdp = proposer == dynamics.appearance.action_count and ending.proposer_may_stop

    def start(self, task: Task, intent: Intent = Intent.HELPFUL) -> GameState:
        return GameState(self.config.dynamics.start(task), self.protocol.first_movers, intent)

    def step(
        self, state: GameState, proposer: SupportsIndex | None = None, verifier: SupportsIndex | None = None
    ) -> GameStep:
        """Applies the actions of the agents to move; None for an agent out of turn.

        An illegal choice counts as no choice (`protocols`). Raises TurnError if an agent acts out of turn or fails to
        act, ActionError for an action outside the action space.
        """
        mdp, movers, intent, proposal, refused, rejections, messages, _ = state
        if not movers:
            raise TurnError("the game is over; start a new one")
        choice, proposer_message, proposer_illegal = self._decode_action(movers, PROPOSER, proposer)
        answer, verifier_message, verifier_illegal = self._decode_action(movers, VERIFIER, verifier)
        if proposal is None:
            proposal = choice
        table = self.decision_table
        proposal_type = EDIT if proposal > STOP_ACTION else proposal
        index = table.indices[movers[0]][proposal_type][answer][rejections >= self.config.exchanges]
        decision = table.decisions[index]
        mdp_move, needs_answer, _, _ = decision
        if mdp_move is NOTHING:
            transition, after, result, terminated, truncated = None, mdp, table.no_mdp_step, False, False
            rejections += not needs_answer
        else:
            transition = self._step_mdp(mdp, mdp_move, proposal)
            after, (result, _, _, terminated, truncated, _), _ = transition
            rejections = 0
        if mdp_move >= PROPOSAL:
            refused = None
        elif movers == VERIFIER_MOVES:
            refused = proposal
        holds = table.needs_truth[index] and mdp.task.solved_by(mdp.scene)
        rewards = table.rewards[index][result][holds][intent]
        if self._has_messages:
            cost = self.message_cost
            rewards = (rewards[0] - cost * bool(proposer_message), rewards[1] - cost * bool(verifier_message))
            messages = (
                messages[0] if proposer_message is None else proposer_message,
                messages[1] if verifier_message is None else verifier_message,
            )
        if terminated or truncated:
            next_movers = NOBODY_MOVES
        else:
            next_movers = VERIFIER_MOVES if needs_answer else self.protocol.first_movers
        history = ()
        if self.history_length:
            history = (*state.history, PastTurn(choice, answer, messages))[-self.history_length :]
        pending = proposal if needs_answer else None
        next_state = new_tuple(GameState, (after, next_movers, intent, pending, refused, rejections, messages, history))
        illegal = (proposer_illegal, verifier_illegal)
        return new_tuple(GameStep, (next_state, rewards, terminated, truncated, transition, illegal, decision, mdp))

    def proposed_scene(self, state: GameState) -> Scene:
        """The scene after the pending proposal; the current one if there is none, or it is STOP or invalid."""
        mdp, proposal = state.mdp, state.proposal
        if proposal is None or proposal == STOP_ACTION:
            return mdp.scene
        dynamics = self.config.dynamics
        return dynamics.step(mdp._replace(steps=0), dynamics.appearance.decode(proposal)).state.scene

    def _decode_action(
        self, movers: tuple[Role, ...], role: Role, action: SupportsIndex | None
    ) -> tuple[int, int | None, bool]:
        """The choice, or NO_CHOICE; the message, None out of turn; whether the choice is illegal."""
        if role not in movers:
            if action is not None:
                raise TurnError(f"{AGENTS[role]} acted out of turn: it is the turn of {AGENTS[role.other]}")
            return NO_CHOICE, None, False
        if action is None:
            raise TurnError(f"it is the turn of {AGENTS[role]}: it must act")
        choices = self.choices[role]
        if type(action) is int and action in choices and not self._has_messages:  # fast path
            return action, SILENCE, False
        choice, message = divmod(self.checked_action(role, action), self.message_sizes[role] + 1)
        if choice in choices:
            return choice, message, False
        return NO_CHOICE, SILENCE, True

    def _step_mdp(self, mdp: State, mdp_move: MDPMove, proposal: int) -> Transition:
        """The MDP's transition in a turn that uses up a round."""
        dynamics = self.config.dynamics
        if mdp_move is WAIT:
            return dynamics.wait(mdp)
        return dynamics.step(mdp, dynamics.appearance.decode(STOP_ACTION if mdp_move is STOP else proposal))

    def checked_action(self, role: Role, action: SupportsIndex) -> int:
        """`action` as an int. Raises ActionError if it is not in the action space of `role`."""
        return checked_index(action, self.action_counts[role], AGENTS[role])

    def legal_mask(self, state: GameState, role: Role) -> Int8Array:
        """(actions,) a new array: 1 for each legal action of `role`; there is always at least one."""
        if self.turn_based and role not in state.movers:
            return self.wait_masks[role].copy()
        if role is VERIFIER:
            return self.answer_mask.copy()
        legal = self.config.dynamics.legal_mask(state.mdp)
        return legal.view(INT8) if self._proposer_mask_is_mdp else self.proposer_masks(legal)

    def proposer_masks(self, legal: BoolArray) -> Int8Array:
        """(..., actions) masks of proposers in their turn from the MDP's (..., choices), which may be overwritten."""
        if not self.config.ending.proposer_may_stop:
            legal[..., STOP_ACTION] = False
        count, choices = self.action_counts[PROPOSER], legal.shape[-1]
        if choices == count:
            return legal.view(INT8)
        masks = np.zeros((*legal.shape[:-1], count), INT8)
        messages = self.message_sizes[PROPOSER] + 1
        masks[..., : choices * messages] = legal if messages == 1 else legal.repeat(messages, axis=-1)
        return masks

    def is_wait(self, role: Role, action: SupportsIndex) -> bool:
        """Whether `action` is "wait". Raises ActionError as `checked_action`."""
        wait = self.wait_actions[role]
        return (type(action) is int and action == wait) or self.checked_action(role, action) == wait

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
