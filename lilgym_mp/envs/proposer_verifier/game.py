"""The rules of one game: actions, their names and masks, and a table of all decisions and rewards; and its tasks."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import SupportsIndex

import numpy as np

from lilgym_mp.corpus import TaskSet, Vocabulary
from lilgym_mp.corpus.statement_arrays import default_length, training_tasks
from lilgym_mp.envs.observation import item_capacity
from lilgym_mp.envs.proposer_verifier.protocols import (
    AGENTS,
    PROPOSER,
    PROTOCOLS,
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
from lilgym_mp.envs.proposer_verifier.rewards import (
    Costs,
    Intent,
    RewardFunction,
    checked_rewards,
    judgement_in,
    make_rewards,
)
from lilgym_mp.envs.proposer_verifier.settings import GameSettings
from lilgym_mp.envs.rules import Dynamics
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

    def __init__(self, protocol: GameProtocol, config: ProtocolConfig, rewards: RewardFunction) -> None:
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
            both = rewards(mdp_rewards[result], judgement, Intent(intent))
            self.rewards[:, index, result, holds, intent] = checked_rewards(both)
        self.needs_truth = (self.rewards[..., 0, :] != self.rewards[..., 1, :]).any(axis=(0, 2, 3))


def _frozen_mask(size: int, legal: Iterable[int]) -> Int8Array:
    mask = np.zeros(size, np.int8)
    mask[list(legal)] = 1
    mask.flags.writeable = False
    return mask


@dataclass(frozen=True)
class SpaceSizes:
    """The sizes of the parts of observations, for the statements and starts of these tasks."""

    tasks: TaskSet
    dynamics: Dynamics

    @cached_property
    def vocabulary(self) -> Vocabulary:
        """The words of the corpus's train split, whatever the split in play."""
        return Vocabulary.from_statements(task.statement for task in self._training_tasks)

    @cached_property
    def statement_length(self) -> int:
        """Number of token ids per statement, as in `TokenizedStatement`; the longest statement of the split fits."""
        return default_length(task.statement for tasks in (self.tasks, self._training_tasks) for task in tasks)

    @cached_property
    def _training_tasks(self) -> TaskSet:
        return training_tasks(self.tasks)

    @cached_property
    def item_capacity(self) -> int:
        """The most items a box can have."""
        return item_capacity(self.tasks, self.dynamics)

    @cached_property
    def max_statement_bytes(self) -> int:
        """UTF-8 length of the longest statement."""
        return max(len(task.statement.encode()) for task in self.tasks)


class Game:
    """One game: its rules, tasks and views; `game_arrays.GameArrays` plays it.

    An agent's action is choice x (message_size + 1) + message. The proposer's choices are the actions of the MDP, the
    verifier's the answers of the protocol. In turn-based protocols there is one more choice, "wait", the only legal
    one out of turn. Message 0 is silence. Homogeneous action spaces both have the size of the larger one; the surplus
    actions are illegal. Pairs and lists are indexed by role.
    """

    def __init__(self, settings: GameSettings) -> None:
        """Raises ValueError naming the value and the choices, CorpusError for unusable tasks."""
        self.views = settings.views_by_role()
        self.config = settings.protocol_config()
        settings.check()
        self.settings = settings
        self.protocol = PROTOCOLS[settings.protocol]
        self.message_sizes = settings.message_sizes()  # number of messages besides silence
        self.reveals_truth = settings.reveal_truth  # in infos
        self.history_length = max(view.history for view in self.views)  # turns kept
        costs = Costs(settings.false_accept_cost, settings.false_reject_cost)
        rewards, self.draws_intent = make_rewards(settings.rewards, costs)
        self.decision_table = DecisionTable(self.protocol, self.config, rewards)
        self._make_actions()
        self.tasks = settings.tasks()
        self.sizes = SpaceSizes(self.tasks, self.config.dynamics)

    def with_tasks(self, tasks: TaskSet, *, keep_spaces: bool = False) -> Game:
        """The game with other tasks; `keep_spaces`: whether observation spaces stay the same, and must fit these tasks.

        Raises ValueError for tasks of another appearance.
        """
        own, given = self.tasks.provenance.appearance, tasks.provenance.appearance
        if own != given:
            raise ValueError(f"the game is played on {own}; tasks of {given} do not fit it")
        other = copy(self)
        other.tasks = tasks
        if not keep_spaces:
            other.sizes = SpaceSizes(tasks, self.config.dynamics)
        return other

    def revealing_truth(self) -> Game:
        """The game with the truth in infos."""
        other = copy(self)
        other.reveals_truth = True
        return other

    def sample_task_index(self, rng: np.random.Generator) -> int:
        """The index of the next episode's task, uniformly drawn."""
        return int(rng.integers(len(self.tasks)))

    def sample_intent(self, rng: np.random.Generator) -> Intent:
        """The next episode's intent; uses `rng` only if intents are drawn."""
        if self.draws_intent and rng.random() < self.settings.deceptive_share:
            return Intent.DECEPTIVE
        return Intent.HELPFUL

    def _make_actions(self) -> None:
        """Numbers the actions, and makes the masks that do not depend on the scene."""
        dynamics, ending, table = self.config.dynamics, self.config.ending, self.decision_table
        self.turn_based = self.protocol.turn_based
        # Legal in an agent's turn; "wait" follows them.
        edits_and_stop = range(
            STOP_ACTION if ending.proposer_may_stop else STOP_ACTION + 1, dynamics.appearance.action_count
        )
        self.choices = (edits_and_stop, range(len(self.protocol.answers(self.config))))
        stops = [self.encode_action(role, self.choices[role].stop) for role in Role]
        counts = [self.encode_action(role, self.choices[role].stop + self.turn_based) for role in Role]
        proposer, verifier = [max(counts)] * 2 if self.settings.homogeneous else counts
        self.action_counts = (proposer, verifier)
        self.wait_actions = [stop if self.turn_based else None for stop in stops]
        self.wait_masks = [  # out of turn
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
