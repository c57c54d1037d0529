"""The vectorised form of `Game.step`, on top of a core that steps N MDPs.

Decisions and rewards are looked up in the game's `DecisionTable`; this module has no rules of its own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.arrays import BoolArray, Float64Array, Int8Array, Int16Array, Int64Array, UInt8Array
from lilgym_mp.envs.batched import ResultTable
from lilgym_mp.envs.buffers import INVALID_REASONS, NO_REASON, Buffers, buffer_specs
from lilgym_mp.envs.cores import make_core
from lilgym_mp.envs.proposer_verifier.game import EDIT, SILENCE, GameState, PastTurn
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE, PROPOSER, STOP_ACTION, VERIFIER, MDPMove, Role
from lilgym_mp.envs.proposer_verifier.rewards import Intent, Judgement, judgement_in
from lilgym_mp.envs.proposer_verifier.views import GameSetup
from lilgym_mp.envs.single import end_info
from lilgym_mp.rules import State

NOTHING, WAIT, PROPOSAL, STOP = map(int, MDPMove)  # plain ints for array code


class GameArrays:
    """The states of N games and the results of the last turn."""

    def __init__(self, setup: GameSetup, num_games: int) -> None:
        self.game = game = setup.game
        dynamics = game.config.dynamics
        actions, capacity = dynamics.appearance.action_count, setup.item_capacity
        specs = buffer_specs(num_games, setup.image_size, actions, capacity, AutoresetMode.DISABLED)
        self._buffers = Buffers.new(specs)
        self._core = make_core(dynamics, setup.tasks, self._buffers, setup.image_size)
        self._mdp_results = ResultTable.of(dynamics)
        # The decision table as arrays, by index of the decision
        table = game.decision_table
        mdp_moves, needs_answer, probabilities, _ = zip(*table.decisions, strict=True)
        self._decision_indices = np.array(table.indices)  # (turns, proposal types, answers, 2) as in the table
        self._mdp_moves = np.array(mdp_moves, np.int64)
        self._needs_answer = np.array(needs_answer)
        self._probabilities = np.array(probabilities, np.float64)  # NaN without a judgement
        is_shown = ~np.isnan(self._probabilities) & setup.reveals_truth
        self._needs_truth = is_shown | np.array(table.needs_truth)  # whether rewards or infos depend on it
        self._reward_table = np.moveaxis(np.array(table.rewards), -1, 0)  # (2, decisions, results + 1, 2, 2) by Role
        self._no_answers = np.zeros(num_games, np.int64)
        self._rejections = np.zeros(num_games, np.int64)
        self._has_masks = self._has_items = False  # whether those in the buffers are up to date
        self._first_movers = np.array([[role in game.protocol.first_movers] for role in Role])  # (2, 1)
        self.movers = np.zeros((len(Role), num_games), np.bool_)  # (2, N) by Role, whether the agent is to move
        self.intents = np.zeros(num_games, np.int64)
        self.proposals = np.full(num_games, NO_CHOICE)  # pending
        self.refused = np.full(num_games, NO_CHOICE)  # as `GameState.refused`
        self.messages = np.full((len(Role), num_games), SILENCE)  # (2, N) by Role, the agent's last message
        # (N, turns, 4) proposal, answer and both messages; newest last, padded with NO_CHOICE
        self.history = np.full((num_games, game.history_length, len(PastTurn._fields) + 1), NO_CHOICE)
        # (2, N) by Role, the rewards since the agent's last own turn, or since the start of the game
        self.own_turn_rewards = np.zeros((len(Role), num_games))
        # Of the last turn:
        self.rewards = np.zeros((len(Role), num_games))  # (2, N) by Role
        self.terminated, self.truncated = np.zeros((2, num_games), np.bool_)  # (N,) each
        self._illegal = np.zeros((len(Role), num_games), np.bool_)  # (2, N) by Role
        self._decisions = np.zeros(num_games, np.int64)  # indices of the decisions
        self._results = np.zeros(num_games, np.int64)  # indices of the step results
        self._holds = np.zeros(num_games, np.int64)  # whether the judged claim held, if that was needed

    def start(self, indices: Int64Array, tasks: Int64Array, intents: Int64Array) -> None:
        """Starts games (k,) with the tasks of indices (k,) and intents (k,)."""
        self._core.start(indices, tasks)
        self._has_masks = self._has_items = False
        self._rejections[indices] = 0
        self.own_turn_rewards[:, indices] = 0
        self.movers[:, indices] = self._first_movers
        self.intents[indices] = intents
        self.proposals[indices] = NO_CHOICE
        self.refused[indices] = NO_CHOICE
        self.messages[:, indices] = SILENCE
        self.history[indices] = NO_CHOICE

    def step(self, proposers: Int64Array, verifiers: Int64Array) -> None:
        """Plays one turn of every game; actions (N,) of agents out of turn are ignored."""
        game, moved = self.game, self.movers
        choice, proposer_message = self._decode_actions(PROPOSER, proposers)
        answer, verifier_message = self._decode_actions(VERIFIER, verifiers)
        proposal, is_answer = choice, self._no_answers
        if game.turn_based:
            is_answer = self.movers[VERIFIER].astype(np.int64)
            proposal = np.where(is_answer, self.proposals, choice)
        exchanges_spent = (self._rejections >= game.config.exchanges).astype(np.int64)
        decision = self._decision_indices[is_answer, np.minimum(proposal, EDIT), answer, exchanges_spent]
        self._decisions = decision
        needed = self._needs_truth[decision]
        self._holds = (needed & self.goals_reached() if needed.any() else needed).astype(np.int64)
        mdp_move, needs_answer = self._mdp_moves[decision], self._needs_answer[decision]
        result = self._step_mdps(mdp_move, proposal)
        self.rewards = self._reward_table[:, decision, result, self._holds, self.intents]
        self.terminated, self.truncated = self._mdp_results.terminated[result], self._mdp_results.truncated[result]
        self._rejections = np.where(mdp_move == NOTHING, self._rejections + ~needs_answer, 0)
        if game.has_refusals:
            refused = np.where(is_answer, proposal, self.refused)
            self.refused = np.where(mdp_move >= PROPOSAL, NO_CHOICE, refused)
        is_active = ~(self.terminated | self.truncated)
        if game.turn_based:
            self.proposals = np.where(needs_answer, proposal, NO_CHOICE)
            self.movers = np.array([is_active & ~needs_answer, needs_answer])
        else:
            self.movers = np.array([is_active, is_active])
        for role, message in ((PROPOSER, proposer_message), (VERIFIER, verifier_message)):
            if message is not None:
                self.rewards[role] -= game.message_cost * (message > SILENCE)
        self.own_turn_rewards = np.where(moved, 0.0, self.own_turn_rewards) + self.rewards
        self._results = result
        if game.history_length:
            self.history[:, :-1] = self.history[:, 1:]
            self.history[:, -1] = np.stack([choice, answer, *self.messages], axis=1)

    def _decode_actions(self, role: Role, actions: Int64Array) -> tuple[Int64Array, Int64Array | None]:
        """(N,) choices, NO_CHOICE if out of turn or illegal; (N,) messages, None if `role` has none."""
        movers, size, own = self.movers[role], self.game.message_sizes[role], self.game.choices[role]
        choice, message = np.divmod(actions, size + 1) if size else (actions, None)
        legal = movers & (choice >= own.start) & (choice < own.stop)
        wait_action = self.game.wait_actions[role]
        self._illegal[role] = ~legal & (movers if wait_action is None else movers | (actions != wait_action))
        if message is not None:
            message = np.where(legal, message, SILENCE)
            self.messages[role] = np.where(movers, message, self.messages[role])
        return np.where(legal, choice, NO_CHOICE), message

    def _step_mdps(self, mdp_move: Int64Array, proposal: Int64Array) -> Int64Array:
        """Steps the MDPs as decided. (N,) indices of step results, or `no_mdp_step`."""
        buffers = self._buffers
        buffers.action[:] = np.where(mdp_move == STOP, STOP_ACTION, proposal)
        buffers.result[:] = self.game.decision_table.no_mdp_step
        acting, waiting = (mdp_move >= PROPOSAL).nonzero()[0], (mdp_move == WAIT).nonzero()[0]
        if len(acting):
            self._core.step(None if len(acting) == len(mdp_move) else acting)
            self._has_masks = self._has_items = False
        if len(waiting):
            self._core.wait(waiting)
        return buffers.result.astype(np.int64)

    @property
    def images(self) -> UInt8Array:
        """(N, height, width, 3), updated in every turn; read-only."""
        return self._buffers.image

    @property
    def tasks(self) -> Int64Array:
        """(N,) task indices; read-only."""
        return self._buffers.task

    @property
    def rounds(self) -> Int64Array:
        """(N,) `State.steps`; read-only."""
        return self._buffers.steps

    def items(self) -> Int16Array:
        """(N, 3, capacity, 5) `item_array` of the scenes; read-only."""
        if not self._has_items:
            self._core.write_items()
            self._has_items = True
        return self._buffers.items

    def masks(self, role: Role, indices: Int64Array) -> Int8Array:
        """(k, actions) a new array: `Game.legal_mask` of games (k,)."""
        game = self.game
        if not game.turn_based:
            if role is VERIFIER:
                return np.repeat(game.answer_mask[None], len(indices), axis=0)
            return game.proposer_masks(self.legal()[indices])
        masks = np.repeat(game.wait_masks[role][None], len(indices), axis=0)
        moving = self.movers[role, indices].nonzero()[0]
        if role is VERIFIER:
            masks[moving] = game.answer_mask
        elif len(moving):
            masks[moving] = game.proposer_masks(self.legal()[indices[moving]])
        return masks

    def legal(self) -> BoolArray:
        """(N, actions of the MDP); read-only."""
        if not self._has_masks:
            self._core.write_masks()
            self._has_masks = True
        return self._buffers.mask

    def mdp(self, index: int) -> State:
        """The MDP's state in a game."""
        return self._core.state(index)

    def state(self, index: int) -> GameState:
        """The state of a game that goes on, without its history."""
        proposal, refused = int(self.proposals[index]), int(self.refused[index])
        proposer_message, verifier_message = self.messages[:, index].tolist()
        return GameState(
            self.mdp(index),
            tuple(role for role in Role if self.movers[role, index]),
            Intent(int(self.intents[index])),
            None if proposal == NO_CHOICE else proposal,
            None if refused == NO_CHOICE else refused,
            int(self._rejections[index]),
            (proposer_message, verifier_message),
        )

    def end_info(self, index: int) -> dict[str, Any]:
        """`end_info` of a game that ended in the last turn."""
        reason = int(self._buffers.invalid[index])
        outcome = self.game.config.dynamics.step_results[self._results[index]].outcome
        return end_info(outcome, None if reason == NO_REASON else INVALID_REASONS[reason])

    def last_judgement(self, index: int) -> Judgement | None:
        """The judgement in the last turn of a game; `holds` is valid only if the settings reveal the truth."""
        decision = self.game.decision_table.decisions[self._decisions[index]]
        return judgement_in(decision, holds=bool(self._holds[index]))

    @property
    def probabilities(self) -> Float64Array:
        """(N,) `Judgement.probability` in the last turn, NaN without a judgement."""
        return self._probabilities[self._decisions]

    @property
    def holds(self) -> BoolArray:
        """(N,) `Judgement.holds` in the last turn; valid only where judged, and if the settings reveal the truth."""
        return self._holds.astype(np.bool_)

    @property
    def successes(self) -> BoolArray:
        """(N,) whether the game ended in success in the last turn."""
        return self._mdp_results.successes[self._results]

    def goals_reached(self) -> BoolArray:
        """(N,) whether the statement has the target value; read-only."""
        self._core.write_goals()
        return self._buffers.goal

    def last_illegal(self, index: int) -> tuple[bool, bool]:
        """By Role: whether the agent's choice in the last turn of a game was illegal."""
        proposer, verifier = self._illegal[:, index].tolist()
        return proposer, verifier
