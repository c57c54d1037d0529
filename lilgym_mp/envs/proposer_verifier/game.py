"""A game of proposer and verifier: settings, actions, and the pure step from state to state."""

from __future__ import annotations

import operator
from dataclasses import dataclass, field
from typing import SupportsIndex

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.actions import ActionError, describe
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
    Conditions,
    GameState,
    GameStep,
    Intent,
    PastTurn,
    Role,
)
from lilgym_mp.task import Task

Int8Array = NDArray[np.int8]
WAIT = "wait"


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
    choices: tuple[range, range] = field(init=False)  # in an agent's turn, by Role; "wait" comes after them
    action_counts: tuple[int, int] = field(init=False)  # by Role
    _waiting: tuple[Int8Array, Int8Array] = field(init=False, repr=False)  # masks of who must wait, by Role
    _answering: Int8Array = field(init=False, repr=False)  # the verifier's mask in its turn

    def __post_init__(self) -> None:
        appearance, ending = self.conditions.dynamics.appearance, self.conditions.ending
        first = STOP_ACTION if ending.proposer_may_stop else STOP_ACTION + 1
        choices = (range(first, appearance.action_count), range(len(self.protocol.answers(self.conditions))))
        proposer, verifier = (
            (own.stop + (not self.protocol.simultaneous)) * (size + 1)
            for own, size in zip(choices, self.message_sizes, strict=True)
        )
        largest = max(proposer, verifier)
        object.__setattr__(self, "choices", choices)
        object.__setattr__(self, "action_counts", (largest, largest) if self.homogeneous else (proposer, verifier))
        object.__setattr__(self, "_waiting", tuple(self._waiting_mask(role) for role in Role))
        answering = np.zeros(self.action_counts[VERIFIER], np.int8)
        answering[: self.action(VERIFIER, choices[VERIFIER].stop)] = 1
        object.__setattr__(self, "_answering", answering)

    def _waiting_mask(self, role: Role) -> Int8Array:
        mask = np.zeros(self.action_counts[role], np.int8)
        wait = self.wait_action(role)
        if wait is not None:
            mask[wait] = 1
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
        if not state.movers:
            raise TurnError("the game is over: no agent may act before a new one starts")
        proposal, proposer_word, proposer_illegal = self._read(state, PROPOSER, proposer)
        answer, verifier_word, verifier_illegal = self._read(state, VERIFIER, verifier)
        ruling = self.protocol.decide(self.conditions, state, proposal, answer)
        played = ruling.played
        terminated = played is not None and played.verdict.terminated
        truncated = played is not None and played.verdict.truncated
        words = (
            state.words[0] if proposer_word is None else proposer_word,
            state.words[1] if verifier_word is None else verifier_word,
        )
        after = GameState(
            state.mdp if played is None else played.state,
            NOBODY_MOVES if terminated or truncated else ruling.movers,
            state.intent,
            ruling.proposal,
            ruling.rejections,
            words,
            self._remembered(state, proposal, answer, words) if self.history_length else (),
        )
        rewards = self.rewards(played, ruling.judgement, state.intent)
        if proposer_word or verifier_word:
            rewards = self._charged(rewards, (proposer_word, verifier_word))
        illegal = (proposer_illegal, verifier_illegal)
        return GameStep(after, rewards, terminated, truncated, played, ruling.judgement, illegal)

    def _read(self, state: GameState, role: Role, action: SupportsIndex | None) -> tuple[int | None, int | None, bool]:
        """An action's choice, None when illegal; its word, None when it is not the agent's turn; if it is illegal."""
        if role not in state.movers:
            if action is not None:
                raise TurnError(f"{AGENTS[role]} acted out of turn: it is the turn of {AGENTS[role.other]}")
            return None, None, False
        if action is None:
            raise TurnError(f"it is the turn of {AGENTS[role]}: it must act")
        choice, word = divmod(self.checked(role, action), self.message_sizes[role] + 1)
        if choice in self.choices[role]:
            return choice, word, False
        return None, SILENCE, True

    def _remembered(
        self, state: GameState, proposal: int | None, answer: int | None, words: tuple[int, int]
    ) -> tuple[PastTurn, ...]:
        past = PastTurn(NO_CHOICE if proposal is None else proposal, NO_CHOICE if answer is None else answer, words)
        return (*state.history, past)[-self.history_length :]

    def _charged(self, rewards: tuple[float, float], words: tuple[int | None, int | None]) -> tuple[float, float]:
        """The rewards less the cost of what was said."""
        proposer, verifier = (
            reward - self.message_cost if word else reward for reward, word in zip(rewards, words, strict=True)
        )
        return proposer, verifier

    def checked(self, role: Role, action: SupportsIndex) -> int:
        """`action` as an int. Raises ActionError when it is none of the action space of `role`."""
        count = self.action_counts[role]
        try:
            index = operator.index(action)
        except TypeError:
            raise ActionError(
                f"an action of {AGENTS[role]} must be a whole number 0 .. {count - 1}, not {action!r}"
            ) from None
        if not 0 <= index < count or isinstance(action, bool):
            raise ActionError(f"action {action!r} of {AGENTS[role]} is out of range; choose from 0 .. {count - 1}")
        return index

    def wait_action(self, role: Role) -> int | None:
        """The action "wait"; None where agents move at once."""
        if self.protocol.simultaneous:
            return None
        return self.action(role, self.choices[role].stop)

    def legal_mask(self, state: GameState, role: Role) -> Int8Array:
        """(actions,) a new array: 1 for each legal action of `role`. At least one always is."""
        if role not in state.movers and not self.protocol.simultaneous:
            return self._waiting[role].copy()
        if role is VERIFIER:
            return self._answering.copy()
        legal = self.conditions.dynamics.legal_mask(state.mdp)
        if not self.conditions.ending.proposer_may_stop:
            legal[STOP_ACTION] = False
        if len(legal) == self.action_counts[role]:
            return legal.view(np.int8)
        mask = np.zeros(self.action_counts[role], np.int8)
        size = self.message_sizes[role] + 1
        mask[: len(legal) * size] = legal if size == 1 else legal.repeat(size)
        return mask

    def describe(self, role: Role, action: SupportsIndex) -> str:
        """An action as people write it, such as "ADD(LEFT, BLUE)", "accept" or "reject, word 2"."""
        choice, word = divmod(self.checked(role, action), self.message_sizes[role] + 1)
        if choice >= self.choices[role].stop:
            name = WAIT
        elif role is PROPOSER:
            name = describe(self.conditions.dynamics.appearance.decode(choice))
        else:
            name = self.protocol.answers(self.conditions)[choice]
        return f"{name}, word {word}" if word else name

    def action(self, role: Role, choice: int, word: int = SILENCE) -> int:
        """The number of the action that makes `choice` and says `word`."""
        return choice * (self.message_sizes[role] + 1) + word
