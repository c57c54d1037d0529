"""A game of proposer and verifier: settings, actions, and the pure step from state to state."""

from __future__ import annotations

import operator
from dataclasses import dataclass, field
from functools import partial
from typing import SupportsIndex

import numpy as np

from lilgym_mp.actions import ActionError, describe
from lilgym_mp.arrays import BOOLEANS, BoolArray, Int8Array
from lilgym_mp.envs.proposer_verifier.protocols import GameProtocol
from lilgym_mp.envs.proposer_verifier.rewards import RewardScheme
from lilgym_mp.envs.proposer_verifier.states import (
    AGENTS,
    NO_CHOICE,
    NOBODY_MOVES,
    PROPOSER,
    SILENCE,
    STOP_ACTION,
    VERIFIER,
    VERIFIER_MOVES,
    Conditions,
    GameState,
    GameStep,
    Intent,
    Judgement,
    MDPMove,
    PastTurn,
    Proposal,
    Role,
    TurnDecision,
    TurnInput,
)
from lilgym_mp.rules import State, Transition
from lilgym_mp.task import Task
from lilgym_mp.tuples import new_tuple

INT8 = np.dtype(np.int8)
WAITING = "wait"
NOTHING, WAIT, _, STOP = MDPMove  # reading a member off its enum costs ten times as much, in every step
EDIT = int(Proposal.EDIT)


Pair = tuple[float, float]  # by Role


class DecisionTable:
    """Every decision of the protocol and every reward, computed once when the game is made.

    One game looks them up; `game_arrays` indexes them for many games at once.
    """

    decisions: tuple[TurnDecision, ...]
    # Index of the decision, by: whether the verifier answers, Proposal, answer, whether the exchanges are spent. The
    # last proposal and the last answer stand for none, so that the index NO_CHOICE finds them.
    indices: list[list[list[list[int]]]]
    # Both agents' rewards, by: index of the decision, index of the MDP's StepResult, whether the claim is true, Intent.
    rewards: list[list[list[list[Pair]]]]
    nothing_played: int  # stands for the index of a StepResult where the MDP takes no step
    truth_matters: list[bool]  # by index of the decision: whether its rewards depend on whether the claim is true

    def __init__(self, protocol: GameProtocol, conditions: Conditions, rewards: RewardScheme) -> None:
        found: dict[TurnDecision, int] = {}

        def index(turn_input: TurnInput) -> int:
            return found.setdefault(protocol.decide(conditions, turn_input), len(found))

        answers = (*range(len(protocol.answers(conditions))), None)
        turns = (False,) if protocol.simultaneous else (False, True)
        self.indices = [
            [
                [[index(TurnInput(turn, kind, answer, spent)) for spent in (False, True)] for answer in answers]
                for kind in Proposal
            ]
            for turn in turns
        ]
        self.decisions = tuple(found)
        results = conditions.dynamics.step_results
        self.nothing_played = len(results)
        mdp_rewards = [*(result.reward for result in results), 0.0]
        self.rewards = [
            [
                [
                    [rewards(reward, _judgement(decision, holds=holds), intent) for intent in Intent]
                    for holds in (False, True)
                ]
                for reward in mdp_rewards
            ]
            for decision in self.decisions
        ]
        self.truth_matters = [any(false != true for false, true in pairs) for pairs in self.rewards]


def _judgement(decision: TurnDecision, *, holds: bool) -> Judgement | None:
    return None if decision.probability is None else Judgement(decision.probability, decision.final, holds)


class TurnError(ValueError):
    """An agent acted out of turn, did not act in its turn, or acted after the end."""


@dataclass(frozen=True, slots=True)
class Game:
    """The rules of one game, as pure functions of states.

    An agent's action is choice x (message_size + 1) + word. The proposer's choices are the numbered actions of the
    MDP, the verifier's the answers of the protocol; where agents take turns, a last choice, "wait", is the
    only legal one of the agent whose turn it is not. Word 0 is silence.
    """

    protocol: GameProtocol
    conditions: Conditions
    rewards: RewardScheme
    message_sizes: tuple[int, int]  # words beside silence, by Role
    message_cost: float  # to the sender, for each word but silence
    history_length: int  # turns kept in the state
    homogeneous: bool  # both agents' action spaces are as large as the larger; what is beyond one's own is illegal
    decision_table: DecisionTable = field(init=False, repr=False)
    choices: tuple[range, range] = field(init=False)  # in an agent's turn, by Role; "wait" comes after them
    action_counts: tuple[int, int] = field(init=False)  # by Role
    wait_actions: tuple[int | None, int | None] = field(init=False)  # by Role; None where agents move at once
    waiting_masks: tuple[Int8Array, Int8Array] = field(init=False, repr=False)  # of who must wait, by Role
    answering_mask: Int8Array = field(init=False, repr=False)  # the verifier's in its turn
    takes_turns: bool = field(init=False)  # whether the agents do, rather than move at once
    _speaks: bool = field(init=False, repr=False)  # whether any agent has words
    _proposes_as_mdp: bool = field(init=False, repr=False)  # whether the proposer's actions are just the MDP's

    def __post_init__(self) -> None:
        appearance, ending = self.conditions.dynamics.appearance, self.conditions.ending
        first = STOP_ACTION if ending.proposer_may_stop else STOP_ACTION + 1
        choices = (range(first, appearance.action_count), range(len(self.protocol.answers(self.conditions))))
        takes_turns = not self.protocol.simultaneous
        proposer, verifier = (
            (own.stop + takes_turns) * (size + 1) for own, size in zip(choices, self.message_sizes, strict=True)
        )
        largest = max(proposer, verifier)
        derive = partial(object.__setattr__, self)
        derive("decision_table", DecisionTable(self.protocol, self.conditions, self.rewards))
        derive("choices", choices)
        derive("action_counts", (largest, largest) if self.homogeneous else (proposer, verifier))
        derive("wait_actions", tuple(self.action(role, choices[role].stop) if takes_turns else None for role in Role))
        derive("waiting_masks", tuple(self._waiting_mask(role) for role in Role))
        derive("answering_mask", self._answering_mask())
        derive("takes_turns", takes_turns)
        derive("_speaks", any(self.message_sizes))
        as_mdp = self.action_counts[PROPOSER] == appearance.action_count and ending.proposer_may_stop
        derive("_proposes_as_mdp", as_mdp)

    def _waiting_mask(self, role: Role) -> Int8Array:
        mask = np.zeros(self.action_counts[role], np.int8)
        wait = self.wait_actions[role]
        if wait is not None:
            mask[wait] = 1
        mask.flags.writeable = False
        return mask

    def _answering_mask(self) -> Int8Array:
        mask = np.zeros(self.action_counts[VERIFIER], np.int8)
        mask[: self.action(VERIFIER, self.choices[VERIFIER].stop)] = 1
        mask.flags.writeable = False
        return mask

    def start(self, task: Task, intent: Intent = Intent.HELPFUL) -> GameState:
        return GameState(self.conditions.dynamics.start(task), self.protocol.first, intent)

    def play(
        self, state: GameState, proposer: SupportsIndex | None = None, verifier: SupportsIndex | None = None
    ) -> GameStep:
        """What the actions of the agents whose turn it is make of `state`; None for the other.

        An illegal choice is no mistake: it counts as having chosen nothing (`protocols`). Raises TurnError for an
        agent that acts out of turn or fails to act, ActionError for a number out of range.
        """
        mdp, movers, intent, asked, rejections, words, _ = state
        if not movers:
            raise TurnError("the game is over: no agent may act before a new one starts")
        proposal, proposer_word, proposer_errs = self._read(movers, PROPOSER, proposer)
        answer, verifier_word, verifier_errs = self._read(movers, VERIFIER, verifier)
        if asked is None:
            asked = proposal
        table = self.decision_table
        kind = EDIT if asked > STOP_ACTION else asked
        index = table.indices[movers[0]][kind][answer][rejections >= self.conditions.exchanges]
        decision = table.decisions[index]
        mdp_move, asks, rejects, _, _ = decision
        if mdp_move is NOTHING:
            played, after, result, terminated, truncated = None, mdp, table.nothing_played, False, False
            rejections += rejects
        else:
            played = self._step_mdp(mdp, mdp_move, asked)
            after, (result, _, _, terminated, truncated, _), _ = played
            rejections = 0
        holds = table.truth_matters[index] and mdp.task.solved_by(mdp.scene)
        rewards = table.rewards[index][result][holds][intent]
        if self._speaks:
            rewards = self._charged(rewards, proposer_word, verifier_word)
            words = (
                words[0] if proposer_word is None else proposer_word,
                words[1] if verifier_word is None else verifier_word,
            )
        next_movers = NOBODY_MOVES if terminated or truncated else VERIFIER_MOVES if asks else self.protocol.first
        history = self._remembered(state, proposal, answer, words) if self.history_length else ()
        following = new_tuple(
            GameState, (after, next_movers, intent, asked if asks else None, rejections, words, history)
        )
        illegal = (proposer_errs, verifier_errs)
        return new_tuple(GameStep, (following, rewards, terminated, truncated, played, illegal, decision, mdp))

    def _read(self, movers: tuple[Role, ...], role: Role, action: SupportsIndex | None) -> tuple[int, int | None, bool]:
        """An action's choice, or NO_CHOICE; its word, None when it is not the agent's turn; whether it is illegal."""
        if role not in movers:
            if action is not None:
                raise TurnError(f"{AGENTS[role]} acted out of turn: it is the turn of {AGENTS[role.other]}")
            return NO_CHOICE, None, False
        if action is None:
            raise TurnError(f"it is the turn of {AGENTS[role]}: it must act")
        choices = self.choices[role]
        if type(action) is int and action in choices and not self._speaks:  # then there is nothing to check or divide
            return action, SILENCE, False
        choice, word = divmod(self.checked(role, action), self.message_sizes[role] + 1)
        if choice in choices:
            return choice, word, False
        return NO_CHOICE, SILENCE, True

    def _step_mdp(self, mdp: State, mdp_move: MDPMove, proposal: int) -> Transition:
        """What the MDP makes of a turn that spends a round."""
        dynamics = self.conditions.dynamics
        if mdp_move is WAIT:
            return dynamics.wait(mdp)
        return dynamics.step(mdp, dynamics.appearance.decode(STOP_ACTION if mdp_move is STOP else proposal))

    def _charged(
        self, rewards: tuple[float, float], proposer_word: int | None, verifier_word: int | None
    ) -> tuple[float, float]:
        """The rewards less the cost of what was said."""
        proposer, verifier = rewards
        return (
            proposer - self.message_cost if proposer_word else proposer,
            verifier - self.message_cost if verifier_word else verifier,
        )

    def _remembered(self, state: GameState, proposal: int, answer: int, words: tuple[int, int]) -> tuple[PastTurn, ...]:
        return (*state.history, PastTurn(proposal, answer, words))[-self.history_length :]

    def checked(self, role: Role, action: SupportsIndex) -> int:
        """`action` as an int. Raises ActionError when it is none of the action space of `role`."""
        count = self.action_counts[role]
        try:
            index = -1 if isinstance(action, BOOLEANS) else operator.index(action)
        except TypeError:
            raise ActionError(
                f"an action of {AGENTS[role]} must be a whole number 0 .. {count - 1}, not {action!r}"
            ) from None
        if not 0 <= index < count:
            raise ActionError(f"action {action!r} of {AGENTS[role]} is out of range; choose from 0 .. {count - 1}")
        return index

    def legal_mask(self, state: GameState, role: Role) -> Int8Array:
        """(actions,) a new array: 1 for each legal action of `role`. At least one always is."""
        if self.takes_turns and role not in state.movers:
            return self.waiting_masks[role].copy()
        if role is VERIFIER:
            return self.answering_mask.copy()
        legal = self.conditions.dynamics.legal_mask(state.mdp)
        return legal.view(INT8) if self._proposes_as_mdp else self.proposer_masks(legal)

    def proposer_masks(self, legal: BoolArray) -> Int8Array:
        """(..., actions) of proposers in their turn, from `legal`, the MDP's own (..., choices), which is used up."""
        if not self.conditions.ending.proposer_may_stop:
            legal[..., STOP_ACTION] = False
        count, choices = self.action_counts[PROPOSER], legal.shape[-1]
        if choices == count:
            return legal.view(INT8)
        masks = np.zeros((*legal.shape[:-1], count), INT8)
        spoken = self.message_sizes[PROPOSER] + 1
        masks[..., : choices * spoken] = legal if spoken == 1 else legal.repeat(spoken, axis=-1)
        return masks

    def waits(self, role: Role, action: SupportsIndex) -> bool:
        """Whether an agent whose turn it is not does what it must: "wait". Raises ActionError as `checked` does."""
        wait = self.wait_actions[role]
        return (type(action) is int and action == wait) or self.checked(role, action) == wait

    def describe(self, role: Role, action: SupportsIndex) -> str:
        """An action as people write it, such as "ADD(LEFT, BLUE)", "accept" or "reject, word 2"."""
        choice, word = divmod(self.checked(role, action), self.message_sizes[role] + 1)
        if choice >= self.choices[role].stop:
            name = WAITING
        elif role is PROPOSER:
            name = describe(self.conditions.dynamics.appearance.decode(choice))
        else:
            name = self.protocol.answers(self.conditions)[choice]
        return f"{name}, word {word}" if word else name

    def action(self, role: Role, choice: int, word: int = SILENCE) -> int:
        """The number of the action that makes `choice` and says `word`."""
        return choice * (self.message_sizes[role] + 1) + word
