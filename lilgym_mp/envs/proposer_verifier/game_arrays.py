"""Many games at once: `Game.play` over arrays, on top of a core that steps as many MDPs.

The protocol's decisions and the rewards are read from the game's `DecisionTable`; this module has no rules of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.arrays import BoolArray, Float64Array, Int8Array, Int16Array, Int64Array, UInt8Array
from lilgym_mp.envs.buffers import INVALID_REASONS, NO_REASON, Buffers, buffer_specs
from lilgym_mp.envs.cores import make_core
from lilgym_mp.envs.proposer_verifier.game import EDIT
from lilgym_mp.envs.proposer_verifier.states import (
    NO_CHOICE,
    PROPOSER,
    SILENCE,
    STOP_ACTION,
    VERIFIER,
    Judgement,
    MDPMove,
    PastTurn,
    Role,
)
from lilgym_mp.envs.proposer_verifier.views import GameSetup
from lilgym_mp.envs.single import end_info
from lilgym_mp.rules import State, Transition

Info = dict[str, Any]
NOTHING, WAIT, PROPOSAL, STOP = map(int, MDPMove)  # plain numbers for arrays, as in `envs.buffers`


class GameArrays:
    """The states of N games by number, and what the last turn made of them."""

    moves: BoolArray  # (2, N) whose turn it is, by Role
    intents: Int64Array  # (N,)
    proposals: Int64Array  # (N,) that await an answer, or NO_CHOICE
    words: Int64Array  # (2, N) the last of each, by Role
    history: Int64Array  # (N, turns, 4) proposals, answers and both words, newest last; NO_CHOICE before the first
    rewards: Float64Array  # (2, N) of the last turn
    terminated: BoolArray  # (N,) by the last turn
    truncated: BoolArray  # (N,) by the last turn

    def __init__(self, setup: GameSetup, num_games: int) -> None:
        self._game = game = setup.game
        self._dynamics = dynamics = game.conditions.dynamics
        actions, capacity = dynamics.appearance.action_count, setup.item_capacity
        forms = buffer_specs(num_games, setup.image_size, actions, capacity, AutoresetMode.DISABLED)
        self._buffers = Buffers.new(forms)
        self._core = make_core(dynamics, setup.tasks, self._buffers, setup.image_size)
        self._tables = _Tables.of(setup)
        self._no_answers = np.zeros(num_games, np.int64)
        self._rejections = np.zeros(num_games, np.int64)
        self._illegal = np.zeros((len(Role), num_games), np.bool_)  # whose choice was in the last turn, by Role
        self._decisions = np.zeros(num_games, np.int64)  # the last turn's
        self._holds = np.zeros(num_games, np.int64)  # whether what it judged was true, where that matters
        self._ends: dict[tuple[int, int], Info] = {}  # by verdict and reason
        self._has_masks = self._has_items = False  # whether those in the buffers are of the present scenes
        self._first = np.array([[role in game.protocol.first] for role in Role])  # (2, 1) who moves first
        self.moves = np.zeros((len(Role), num_games), np.bool_)
        self.intents = np.zeros(num_games, np.int64)
        self.proposals = np.full(num_games, NO_CHOICE)
        self.rewards = np.zeros((len(Role), num_games))
        self.terminated, self.truncated = np.zeros((2, num_games), np.bool_)
        self.words = np.full((len(Role), num_games), SILENCE)
        self.history = np.full((num_games, game.history_length, len(PastTurn._fields) + 1), NO_CHOICE)

    def start(self, indices: Int64Array, tasks: Int64Array, intents: Int64Array) -> None:
        """Begins games (k,) of tasks (k,) by number."""
        self._core.start(indices, tasks)
        self._has_masks = self._has_items = False
        self._rejections[indices] = 0
        self.moves[:, indices] = self._first
        self.intents[indices] = intents
        self.proposals[indices] = NO_CHOICE
        self.words[:, indices] = SILENCE
        self.history[indices] = NO_CHOICE

    def play(self, proposers: Int64Array, verifiers: Int64Array) -> None:
        """One turn of every game. Actions (N,) of both agents; those of an agent whose turn it is not are ignored."""
        game, tables = self._game, self._tables
        proposal, proposer_word = self._read(PROPOSER, proposers)
        answer, verifier_word = self._read(VERIFIER, verifiers)
        asked, is_answer = proposal, self._no_answers
        if game.takes_turns:
            is_answer = self.moves[VERIFIER].astype(np.int64)
            asked = np.where(is_answer, self.proposals, proposal)
        exchanges_are_spent = (self._rejections >= game.conditions.exchanges).astype(np.int64)
        decision = tables.indices[is_answer, np.minimum(asked, EDIT), answer, exchanges_are_spent]
        self._decisions = decision
        self._holds = self._truths(decision)
        mdp_move, asks = tables.mdp_move[decision], tables.asks[decision]
        verdict = self._step_mdps(mdp_move, asked)
        self.rewards = tables.rewards[:, decision, verdict, self._holds, self.intents]
        self.terminated, self.truncated = tables.terminated[verdict], tables.truncated[verdict]
        self._rejections = np.where(mdp_move == NOTHING, self._rejections + tables.rejects[decision], 0)
        going_on = ~(self.terminated | self.truncated)
        if game.takes_turns:
            self.proposals = np.where(asks, asked, NO_CHOICE)
            self.moves = np.array([going_on & ~asks, asks])
        else:
            self.moves = np.array([going_on, going_on])
        for role, word in ((PROPOSER, proposer_word), (VERIFIER, verifier_word)):
            if word is not None:
                self.rewards[role] -= game.message_cost * (word > SILENCE)
        if game.history_length:
            self.history[:, :-1] = self.history[:, 1:]
            self.history[:, -1] = np.stack([proposal, answer, *self.words], axis=1)

    def _read(self, role: Role, actions: Int64Array) -> tuple[Int64Array, Int64Array | None]:
        """(N,) the actions' choices, NO_CHOICE out of turn and for illegal ones; (N,) what they say, if `role` can."""
        moves, size, own = self.moves[role], self._game.message_sizes[role], self._game.choices[role]
        choice, word = np.divmod(actions, size + 1) if size else (actions, None)
        legal = moves & (choice >= own.start) & (choice < own.stop)
        wait_action = self._game.wait_actions[role]
        self._illegal[role] = ~legal & (moves if wait_action is None else moves | (actions != wait_action))
        if word is not None:
            word = np.where(legal, word, SILENCE)
            self.words[role] = np.where(moves, word, self.words[role])
        return np.where(legal, choice, NO_CHOICE), word

    def _truths(self, decision: Int64Array) -> Int64Array:
        """(N,) 1 where what is judged is true and somebody asks for that."""
        holds = np.zeros(len(decision), np.int64)
        for number in self._tables.wants_truth[decision].nonzero()[0].tolist():
            holds[number] = self._dynamics.goal_reached(self.mdp(number))
        return holds

    def _step_mdps(self, mdp_move: Int64Array, asked: Int64Array) -> Int64Array:
        """Has the MDPs take a step where the decision says so. (N,) indices of step results, or `nothing_played`."""
        buffers = self._buffers
        buffers.action[:] = np.where(mdp_move == STOP, STOP_ACTION, asked)
        buffers.result[:] = self._game.decision_table.nothing_played
        acting, waiting = (mdp_move >= PROPOSAL).nonzero()[0], (mdp_move == WAIT).nonzero()[0]
        if len(acting):
            self._core.step(None if len(acting) == len(mdp_move) else acting)
            self._has_masks = self._has_items = False
        if len(waiting):
            self._core.wait(waiting)
        return buffers.result.astype(np.int64)

    @property
    def images(self) -> UInt8Array:
        """(N, height, width, 3), brought up to date in every turn; not to be written."""
        return self._buffers.image

    @property
    def tasks(self) -> Int64Array:
        """(N,) numbers of the tasks; not to be written."""
        return self._buffers.task

    def items(self) -> Int16Array:
        """(N, 3, capacity, 5) `item_array` of the scenes; not to be written."""
        if not self._has_items:
            self._core.write_items()
            self._has_items = True
        return self._buffers.items

    def masks(self, role: Role, indices: Int64Array) -> Int8Array:
        """(k, actions) a new array: `Game.legal_mask` in the games (k,)."""
        game = self._game
        if not game.takes_turns:
            if role is VERIFIER:
                return np.repeat(game.answering_mask[None], len(indices), axis=0)
            return game.proposer_masks(self._legal()[indices])
        masks = np.repeat(game.waiting_masks[role][None], len(indices), axis=0)
        moving = self.moves[role, indices].nonzero()[0]
        if role is VERIFIER:
            masks[moving] = game.answering_mask
        elif len(moving):
            masks[moving] = game.proposer_masks(self._legal()[indices[moving]])
        return masks

    def _legal(self) -> BoolArray:
        """(N, actions of the MDP); not to be written."""
        if not self._has_masks:
            self._core.write_masks()
            self._has_masks = True
        return self._buffers.mask

    def mdp(self, number: int) -> State:
        """The state of the MDP of a game."""
        return self._core.state(number)

    def last_end(self, number: int) -> Info:
        """`end_info` of the last turn of a game, which ended it: a new dict."""
        buffers = self._buffers
        key = int(buffers.result[number]), int(buffers.invalid[number])
        if key not in self._ends:
            verdict, reason = key
            invalid = None if reason == NO_REASON else INVALID_REASONS[reason]
            self._ends[key] = end_info(Transition(self.mdp(number), self._dynamics.step_results[verdict], invalid))
        return self._ends[key].copy()

    def last_judgement(self, number: int) -> Judgement | None:
        """What the verifier judged in the last turn of a game; the truth is right where infos reveal it."""
        decision = self._game.decision_table.decisions[self._decisions[number]]
        if decision.probability is None:
            return None
        return Judgement(decision.probability, decision.final, bool(self._holds[number]))

    def last_illegal(self, number: int) -> tuple[bool, bool]:
        """By Role: whose choice in the last turn of a game was illegal."""
        proposer, verifier = self._illegal[:, number].tolist()
        return proposer, verifier


class _Tables(NamedTuple):
    """A decision table as arrays."""

    indices: Int64Array  # (turns, proposals, answers, 2) of the decisions, as in the table
    mdp_move: Int64Array  # (decisions,) a MDPMove
    asks: BoolArray  # (decisions,)
    rejects: BoolArray  # (decisions,)
    wants_truth: BoolArray  # (decisions,) whether rewards or infos depend on the truth of what is judged
    rewards: Float64Array  # (2, decisions, results + 1, 2, 2) by Role, then as in the table
    terminated: BoolArray  # (results + 1,) the last for `nothing_played`
    truncated: BoolArray  # (results + 1,)

    @classmethod
    def of(cls, setup: GameSetup) -> _Tables:
        table, verdicts = setup.game.decision_table, setup.game.conditions.dynamics.step_results
        decisions = table.decisions
        wants_truth = [setup.reveals_truth and decision.probability is not None for decision in decisions]
        return cls(
            indices=np.array(table.indices),
            mdp_move=np.array([int(decision.mdp_move) for decision in decisions]),
            asks=np.array([decision.asks for decision in decisions]),
            rejects=np.array([decision.rejects for decision in decisions]),
            wants_truth=np.array(wants_truth) | np.array(table.truth_matters),
            rewards=np.moveaxis(np.array(table.rewards), -1, 0),
            terminated=np.array([*(verdict.terminated for verdict in verdicts), False]),
            truncated=np.array([*(verdict.truncated for verdict in verdicts), False]),
        )
