"""Many games at once: `Game.play` over arrays, on top of a core that steps as many MDPs.

What a protocol decides and what it is worth is read from the game's rulebook, so nothing of either stands here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.arrays import BoolArray, Float64Array, Int8Array, Int16Array, Int64Array, UInt8Array
from lilgym_mp.envs.buffers import INVALID_REASONS, NO_REASON, Buffers, buffer_specs
from lilgym_mp.envs.cores import make_core
from lilgym_mp.envs.proposer_verifier.game import EDIT
from lilgym_mp.envs.proposer_verifier.rewards import Judged
from lilgym_mp.envs.proposer_verifier.states import (
    NO_CHOICE,
    PROPOSER,
    SILENCE,
    STOP_ACTION,
    VERIFIER,
    Counted,
    PastTurn,
    Role,
)
from lilgym_mp.envs.proposer_verifier.views import World
from lilgym_mp.envs.single import end_info
from lilgym_mp.rules import State, Transition

Info = dict[str, Any]
NOTHING, WAIT, PROPOSAL, STOP = map(int, Counted)  # plain numbers for arrays, as in `envs.buffers`


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

    def __init__(self, world: World, num_games: int) -> None:
        self._game = game = world.game
        self._dynamics = dynamics = game.conditions.dynamics
        actions, capacity = dynamics.appearance.action_count, world.item_capacity
        forms = buffer_specs(num_games, world.image_size, actions, capacity, AutoresetMode.DISABLED)
        self._buffers = Buffers.new(forms)
        self._core = make_core(dynamics, world.tasks, self._buffers, world.image_size)
        self._tables = _Tables.of(world)
        self._no_answers = np.zeros(num_games, np.int64)
        self._rejections = np.zeros(num_games, np.int64)
        self._illegal = np.zeros((len(Role), num_games), np.bool_)  # whose choice was in the last turn, by Role
        self._rulings = np.zeros(num_games, np.int64)  # the last turn's
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

    def start(self, which: Int64Array, tasks: Int64Array, intents: Int64Array) -> None:
        """Begins games (k,) of tasks (k,) by number."""
        self._core.start(which, tasks)
        self._has_masks = self._has_items = False
        self._rejections[which] = 0
        self.moves[:, which] = self._first
        self.intents[which] = intents
        self.proposals[which] = NO_CHOICE
        self.words[:, which] = SILENCE
        self.history[which] = NO_CHOICE

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
        ruling = tables.numbers[is_answer, np.minimum(asked, EDIT), answer, exchanges_are_spent]
        self._rulings = ruling
        self._holds = self._truths(ruling)
        counted, asks = tables.counted[ruling], tables.asks[ruling]
        verdict = self._counted(counted, asked)
        self.rewards = tables.worths[:, ruling, verdict, self._holds, self.intents]
        self.terminated, self.truncated = tables.terminated[verdict], tables.truncated[verdict]
        self._rejections = np.where(counted == NOTHING, self._rejections + tables.rejects[ruling], 0)
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

    def _truths(self, ruling: Int64Array) -> Int64Array:
        """(N,) 1 where what is judged is true and somebody asks for that."""
        holds = np.zeros(len(ruling), np.int64)
        for number in self._tables.wants_truth[ruling].nonzero()[0].tolist():
            holds[number] = self._dynamics.goal_reached(self.mdp(number))
        return holds

    def _counted(self, counted: Int64Array, asked: Int64Array) -> Int64Array:
        """Has the MDPs take what counts. (N,) numbers of the verdicts, or the rulebook's `nothing_played`."""
        buffers = self._buffers
        buffers.action[:] = np.where(counted == STOP, STOP_ACTION, asked)
        buffers.result[:] = self._game.rulebook.nothing_played
        acting, waiting = (counted >= PROPOSAL).nonzero()[0], (counted == WAIT).nonzero()[0]
        if len(acting):
            self._core.step(None if len(acting) == len(counted) else acting)
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

    def masks(self, role: Role, which: Int64Array) -> Int8Array:
        """(k, actions) a new array: `Game.legal_mask` in the games (k,)."""
        game = self._game
        if not game.takes_turns:
            if role is VERIFIER:
                return np.repeat(game.answering_mask[None], len(which), axis=0)
            return game.proposer_masks(self._legal()[which])
        masks = np.repeat(game.waiting_masks[role][None], len(which), axis=0)
        moving = self.moves[role, which].nonzero()[0]
        if role is VERIFIER:
            masks[moving] = game.answering_mask
        elif len(moving):
            masks[moving] = game.proposer_masks(self._legal()[which[moving]])
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

    def last_judged(self, number: int) -> Judged | None:
        """What the verifier judged in the last turn of a game; the truth is right where infos reveal it."""
        ruling = self._game.rulebook.rulings[self._rulings[number]]
        if ruling.probability is None:
            return None
        return Judged(ruling.probability, ruling.final, bool(self._holds[number]))

    def last_illegal(self, number: int) -> tuple[bool, bool]:
        """By Role: whose choice in the last turn of a game was illegal."""
        proposer, verifier = self._illegal[:, number].tolist()
        return proposer, verifier


class _Tables(NamedTuple):
    """A rulebook as arrays."""

    numbers: Int64Array  # (turns, proposals, answers, 2) of the rulings, as in the rulebook
    counted: Int64Array  # (rulings,) a Counted
    asks: BoolArray  # (rulings,)
    rejects: BoolArray  # (rulings,)
    wants_truth: BoolArray  # (rulings,) whether rewards or infos depend on the truth of what is judged
    worths: Float64Array  # (2, rulings, verdicts + 1, 2, 2) by Role, then as in the rulebook
    terminated: BoolArray  # (verdicts + 1,) the last for `nothing_played`
    truncated: BoolArray  # (verdicts + 1,)

    @classmethod
    def of(cls, world: World) -> _Tables:
        book, verdicts = world.game.rulebook, world.game.conditions.dynamics.step_results
        rulings = book.rulings
        wants_truth = [world.reveals_truth and ruling.probability is not None for ruling in rulings]
        return cls(
            numbers=np.array(book.numbers),
            counted=np.array([int(ruling.counted) for ruling in rulings]),
            asks=np.array([ruling.asks for ruling in rulings]),
            rejects=np.array([ruling.rejects for ruling in rulings]),
            wants_truth=np.array(wants_truth) | np.array(book.truth_matters),
            worths=np.moveaxis(np.array(book.worths), -1, 0),
            terminated=np.array([*(verdict.terminated for verdict in verdicts), False]),
            truncated=np.array([*(verdict.truncated for verdict in verdicts), False]),
        )
