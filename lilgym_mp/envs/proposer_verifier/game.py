"""The rules of one game: actions, their names and masks, and a table of all decisions and rewards; and its tasks."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import NamedTuple, Self, SupportsIndex

import numpy as np

from lilgym_mp.corpus import TaskSet, Vocabulary
from lilgym_mp.corpus.statement_arrays import default_length, statements_of, training_tasks
from lilgym_mp.envs.observation import item_capacity
from lilgym_mp.envs.proposer_verifier.protocols import (
    AGENTS,
    NO_CHOICE,
    PROPOSER,
    PROTOCOLS,
    STOP_ACTION,
    VERIFIER,
    GameProtocol,
    MDPMove,
    ProposalType,
    Role,
    TurnDecision,
    TurnInput,
)
from lilgym_mp.envs.proposer_verifier.rewards import (
    Intent,
    RewardFunction,
    checked_rewards,
    judgement_in,
    make_rewards,
    progress_weights,
)
from lilgym_mp.envs.proposer_verifier.settings import GameSettings, View
from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.scene.actions import checked_index, describe
from lilgym_mp.scene.arrays import BoolArray, Int8Array, Rng

SILENCE = 0  # the empty message
WAIT_NAME = "wait"


class TurnError(ValueError):
    """An agent did not act in its turn, or actions are not for exactly both agents."""


class DecisionTable:
    """Lookup table of every decision of the protocol and every reward, computed once per game."""

    def __init__(self, protocol: GameProtocol, dynamics: Dynamics, rewards: RewardFunction) -> None:
        found: dict[TurnDecision, int] = {}
        answers = (*range(len(protocol.answers)), None)
        turns = (False, True) if protocol.turn_based else (False,)
        # (turns, proposal types, answers, 2) index of the decision, by the fields of TurnInput. The last proposal type
        # and the last answer mean no choice, so that NO_CHOICE (-1) indexes them.
        self.indices = np.empty((len(turns), len(ProposalType), len(answers), 2), np.int64)
        for turn, kind, answer, spent in np.ndindex(self.indices.shape):
            decision = protocol.decide(TurnInput(turns[turn], ProposalType(kind), answers[answer], bool(spent)))
            self.indices[turn, kind, answer, spent] = found.setdefault(decision, len(found))
        self.decisions = tuple(found)
        mdp_moves, needs_answer, accepted, _ = zip(*self.decisions, strict=True)
        # By index of the decision; verdicts: 1 accepts the claim, 0 rejects it, NO_CHOICE without a claim
        self.mdp_moves = np.array(mdp_moves, np.int64)
        self.needs_answer = np.array(needs_answer)
        self.verdicts = np.array([NO_CHOICE if accepts is None else accepts for accepts in accepted], np.int64)
        results = dynamics.step_results
        self.no_mdp_step = len(results)  # index used for the StepResult if the MDP takes no step
        mdp_rewards = [*(result.reward for result in results), 0.0]
        # (2, decisions, results + 1, 2, 2) indexed by role, decision, StepResult, whether the claim holds, and Intent
        self.rewards = np.empty((len(Role), len(found), len(mdp_rewards), 2, len(Intent)))
        for index, result, holds, intent in np.ndindex(self.rewards.shape[1:]):
            judgement = judgement_in(self.decisions[index], holds=bool(holds))
            both = rewards(mdp_rewards[result], judgement, Intent(intent))
            self.rewards[:, index, result, holds, intent] = checked_rewards(both)
        # (decisions,) whether rewards depend on whether the claim holds
        self.needs_truth = (self.rewards[..., 0, :] != self.rewards[..., 1, :]).any(axis=(0, 2, 3))


class SpaceSizes(NamedTuple):
    """The sizes of the parts of observations."""

    vocabulary: Vocabulary  # the words of the corpus's train split, whatever the split in play
    statement_length: int  # token ids per statement, as in `TokenizedStatement`; the longest of the split fits
    max_statement_bytes: int  # UTF-8 length of the longest statement
    item_capacity: int  # the most items a box can have

    @classmethod
    def of(cls, tasks: TaskSet, dynamics: Dynamics) -> Self:
        """The sizes for the statements and starts of these tasks."""
        training = statements_of(training_tasks(tasks))
        played = statements_of(tasks)
        longest = max(len(statement.encode()) for statement in played)
        vocabulary = Vocabulary.from_statements(training)
        length = default_length([*played, *training])
        return cls(vocabulary, length, longest, item_capacity(tasks, dynamics))


class Game:
    """One game: its rules, tasks and views; `game_arrays.GameArrays` plays it.

    An agent's action is choice x (message_size + 1) + message. The proposer's choices are the actions of the MDP, the
    verifier's the answers of the protocol. In turn-based protocols there is one more choice, "wait", the only legal
    one out of turn. Message 0 is silence. Homogeneous action spaces both have the size of the larger one; the surplus
    actions are illegal. Pairs and lists are indexed by role.
    """

    def __init__(self, settings: GameSettings) -> None:
        """Raises ValueError naming the value and the choices, CorpusError for unusable tasks."""
        settings.check()
        self.settings = settings
        self.protocol = PROTOCOLS[settings.protocol]
        self.dynamics = settings.dynamics()
        self.views = settings.views_by_role()
        self.message_sizes = settings.message_sizes()  # number of messages besides silence
        self.reveals_truth = settings.reveal_truth  # in infos
        self.history_length = max(view.history for view in self.views)  # turns kept
        rewards, self.draws_intent = make_rewards(settings.rewards)
        self.decision_table = DecisionTable(self.protocol, self.dynamics, rewards)
        self.progress_weights = np.array(progress_weights(settings.rewards))  # (2,) indexed by role
        self.goal_distance: Callable[[State], float] | None = None
        if self.progress_weights.any():
            from lilgym_mp.envs.proposer_verifier.progress import GoalDistance  # the solver takes time to import

            self.goal_distance = GoalDistance(self.dynamics)
        self._make_actions()
        self.tasks = settings.tasks()
        self.sizes = SpaceSizes.of(self.tasks, self.dynamics)

    def with_tasks(self, tasks: TaskSet, *, keep_spaces: bool = False) -> Game:
        """The game with other tasks; `keep_spaces`: whether observation spaces stay the same, and must fit these tasks.

        Raises ValueError for tasks of another appearance.
        """
        own = self.tasks.provenance.appearance
        given = tasks.provenance.appearance
        if own != given:
            raise ValueError(f"the game is played on {own}; tasks of {given} do not fit it")
        other = copy(self)
        other.tasks = tasks
        if not keep_spaces:
            other.sizes = SpaceSizes.of(tasks, self.dynamics)
        return other

    def revealing_truth(self) -> Game:
        """The game with the truth in infos."""
        other = copy(self)
        other.reveals_truth = True
        return other

    def showing_everything(self) -> Game:
        """The game with views that hide nothing."""
        other = copy(self)
        other.views = (View(history=self.history_length),) * 2
        return other

    def sample_task_index(self, rng: Rng) -> int:
        """The index of the next episode's task, uniformly drawn."""
        return int(rng.integers(len(self.tasks)))

    def sample_intent(self, rng: Rng) -> Intent:
        """The next episode's intent; uses `rng` only if intents are drawn."""
        if self.draws_intent and rng.random() < self.settings.deceptive_share:
            return Intent.DECEPTIVE
        return Intent.HELPFUL

    def _make_actions(self) -> None:
        """Numbers the actions, and makes the masks that do not depend on the scene."""
        table = self.decision_table
        self.turn_based = self.protocol.turn_based
        first = STOP_ACTION if self.protocol.proposer_may_stop else STOP_ACTION + 1
        # Legal in an agent's turn; "wait" follows them.
        self.choices = range(first, self.dynamics.appearance.action_count), range(len(self.protocol.answers))
        stops = [self.encode_action(role, self.choices[role].stop) for role in Role]
        counts = [self.encode_action(role, self.choices[role].stop + self.turn_based) for role in Role]
        proposer, verifier = [max(counts)] * 2 if self.settings.homogeneous else counts
        self.action_counts = (proposer, verifier)
        self.wait_actions = [stop if self.turn_based else None for stop in stops]
        self.wait_masks = [  # out of turn
            (np.arange(count) == wait).astype(np.int8)
            for count, wait in zip(self.action_counts, self.wait_actions, strict=True)
        ]
        self._stop = stops[PROPOSER]  # the proposer's actions from here on are illegal in its turn
        self.answer_mask = (np.arange(verifier) < stops[VERIFIER]).astype(np.int8)  # the verifier's in its turn
        # Whether a rejection can cost no round.
        self.has_free_rejections = bool(((table.mdp_moves == MDPMove.NOTHING) & ~table.needs_answer).any())
        # Whether a proposal can be refused and the episode go on.
        self.has_refusals = self.turn_based and bool((table.mdp_moves[table.indices[1]] < MDPMove.PROPOSAL).any())

    def proposer_masks(self, legal: BoolArray) -> Int8Array:
        """(..., actions) masks of proposers in their turn, new arrays, from the MDP's (..., choices)."""
        messages = self.message_sizes[PROPOSER] + 1
        count = self.action_counts[PROPOSER]
        if legal.shape[-1] == count:
            masks = legal.astype(np.int8)
        else:
            masks = np.zeros((*legal.shape[:-1], count), np.int8)
            masks[..., : self._stop] = legal if messages == 1 else legal.repeat(messages, axis=-1)
        if not self.protocol.proposer_may_stop:
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
            name = describe(self.dynamics.appearance.decode(choice))
        else:
            name = self.protocol.answers[choice]
        return f"{name}, message {message}" if message else name

    def encode_action(self, role: Role, choice: int, message: int = SILENCE) -> int:
        """The index of the action that makes `choice` and sends `message`."""
        return choice * (self.message_sizes[role] + 1) + message
