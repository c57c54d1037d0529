"""Plays the game: the states of one game or of many, on top of a core that steps their MDPs.

Decisions and rewards are looked up in the game's `DecisionTable`; this module has no rules of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.envs.batched import ResultTable
from lilgym_mp.envs.buffers import INVALID_REASONS, NO_REASON, Buffers, buffer_specs
from lilgym_mp.envs.cores import make_core
from lilgym_mp.envs.interface import end_info
from lilgym_mp.envs.proposer_verifier.game import SILENCE, Game
from lilgym_mp.envs.proposer_verifier.protocols import (
    NO_CHOICE,
    PROPOSER,
    STOP_ACTION,
    VERIFIER,
    MDPMove,
    ProposalType,
    Role,
)
from lilgym_mp.envs.proposer_verifier.rewards import Intent, Judgement, judgement_in
from lilgym_mp.envs.rules import Outcome, State
from lilgym_mp.scene import Scene
from lilgym_mp.scene.arrays import AnyDict, BoolArray, Int8Array, Int16Array, Int64Array, UInt8Array

NOTHING, WAIT, PROPOSAL, STOP = map(int, MDPMove)  # plain ints for array code
EDIT = int(ProposalType.EDIT)
_MOVERS = (((), (VERIFIER,)), ((PROPOSER,), (PROPOSER, VERIFIER)))  # by whether each agent is to move

# Indices of games
_FIRST = np.zeros(1, np.int64)
_NONE = np.zeros(0, np.int64)

Info = AnyDict
Indices = int | Int64Array  # of one game, or (k,) of several: their values have the leading axis (k,)


class GameState(NamedTuple):
    """The state of a game, with the truth, for scripted partners. `mdp.steps` counts the rounds."""

    mdp: State
    intent: Intent
    proposal: int | None  # index of the proposed action that awaits the verifier's answer


def _where(condition: Any, value: Any, otherwise: Any) -> Any:
    """`np.where`, and the same for scalars."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, value, otherwise)
    return value if condition else otherwise


def _games_where(condition: Any, every: Any) -> Int64Array:
    """(k,) indices of the games where it is met, one value for each of `every`."""
    if not isinstance(condition, np.ndarray):
        return _FIRST if condition else _NONE
    found = condition.nonzero()[0]
    return found if isinstance(every, slice) else every[found]


class GameArrays:
    """The states of N games and the results of the last turn."""

    def __init__(self, game: Game, num_games: int) -> None:
        self.game = game
        dynamics = game.dynamics
        actions = dynamics.appearance.action_count
        capacity = game.sizes.item_capacity
        specs = buffer_specs(num_games, game.settings.image_size, actions, capacity, AutoresetMode.DISABLED)
        self._buffers = Buffers.new(specs)
        tasks = [*game.tasks, game.tasks[0]]  # with room for one that a caller chooses
        self._core = make_core(dynamics, tasks, self._buffers, game.settings.image_size)
        self._mdp_results = results = ResultTable.of(dynamics)
        self._continues = ~(results.terminated | results.truncated)  # by step result
        # All games as NumPy indexes them in a step: a single one as scalars. A turn of veto then takes 18 us, and 53 us
        # with arrays of one element.
        self._all: Any = 0 if num_games == 1 else slice(None)
        table = game.decision_table
        is_shown = (table.verdicts != NO_CHOICE) & game.reveals_truth
        self._needs_truth = is_shown | table.needs_truth  # (decisions,) whether rewards or infos depend on it
        self._judges = bool(self._needs_truth.any())
        self._rejections = np.zeros(num_games, np.int64)
        self._has_masks = self._has_items = False  # whether those in the buffers are up to date
        self.movers = np.zeros((len(Role), num_games), bool)  # (2, N) indexed by role, whether the agent is to move
        self.intents = np.zeros(num_games, np.int64)
        self.proposals = np.full(num_games, NO_CHOICE)  # pending
        self.refused = np.full(num_games, NO_CHOICE)  # index of the action refused last, until an action is played
        self.messages = np.full((len(Role), num_games), SILENCE)  # (2, N) indexed by role, the agent's last message
        # (N, turns, 4) proposal, answer and both messages; newest last, padded with NO_CHOICE
        self.history = np.full((num_games, game.history_length, 2 + len(Role)), NO_CHOICE)
        # Of the last turn, overwritten by the next one:
        self.rewards = np.zeros((len(Role), num_games))  # (2, N) indexed by role
        self.terminated, self.truncated = np.zeros((2, num_games), bool)  # (N,) each
        self._illegal = np.zeros((len(Role), num_games), bool)  # (2, N) indexed by role
        self._decisions = np.zeros(num_games, np.int64)  # indices of the decisions
        self._results = np.full(num_games, table.no_mdp_step)  # indices of the step results
        self._distances = np.full(num_games, np.nan)  # to the goal, if rewards depend on it
        self._holds = np.zeros(num_games, np.int64)  # whether the judged claim held, if that was needed

    def start(self, indices: Int64Array, tasks: Int64Array, intents: Int64Array) -> None:
        """Starts games (k,) with the tasks of indices (k,) and intents (k,)."""
        self._core.start(indices, tasks)
        self._has_masks = self._has_items = False
        started: Any = slice(None) if len(indices) == len(self.intents) else indices  # a slice is faster
        self._rejections[started] = 0
        self.movers[PROPOSER, started] = True
        self.movers[VERIFIER, started] = not self.game.turn_based
        self.intents[started] = intents
        self.proposals[started] = self.refused[started] = NO_CHOICE
        self.messages[:, started] = SILENCE
        self.history[started] = NO_CHOICE
        self._results[started] = self.game.decision_table.no_mdp_step
        self._update_distances(indices)

    def step(self, proposers: Int64Array, verifiers: Int64Array, playing: Int64Array | None = None) -> None:
        """Plays one turn of games `playing` (k,), None for all; actions (N,) of agents out of turn are ignored."""
        every = self._all if playing is None else playing
        game = self.game
        table = self.game.decision_table
        choice, proposer_message = self._decode_actions(PROPOSER, proposers[every], every)
        answer, verifier_message = self._decode_actions(VERIFIER, verifiers[every], every)
        proposal = choice
        is_answer = 0
        if game.turn_based:
            is_answer = _where(self.movers[VERIFIER, every], 1, 0)
            proposal = _where(is_answer, self.proposals[every], choice)
        rejections = self._rejections[every]
        exchanges_spent = 0
        if game.has_free_rejections:
            exchanges_spent = _where(rejections >= game.settings.exchanges, 1, 0)
        decision = table.indices[is_answer, _where(proposal < EDIT, proposal, EDIT), answer, exchanges_spent]
        mdp_move = table.mdp_moves[decision]
        needs_answer = table.needs_answer[decision]
        holds = self._claims_hold(decision, every)
        result = self._step_mdps(mdp_move, proposal, every)
        self._decisions[every] = decision
        self.rewards[:, every] = table.rewards[:, decision, result, holds, self.intents[every]]
        if game.goal_distance is not None:
            self._reward_progress(_games_where(mdp_move == PROPOSAL, every))
        results = self._mdp_results
        self.terminated[every] = results.terminated[result]
        self.truncated[every] = results.truncated[result]
        is_active = self._continues[result]
        if game.has_free_rejections:
            self._rejections[every] = _where(mdp_move == NOTHING, rejections + ~needs_answer, 0)
        if game.has_refusals:
            refused = _where(is_answer, proposal, self.refused[every])
            self.refused[every] = _where(mdp_move >= PROPOSAL, NO_CHOICE, refused)
        if game.turn_based:
            self.proposals[every] = _where(needs_answer, proposal, NO_CHOICE)
            self.movers[PROPOSER, every] = is_active != needs_answer  # a game that needs an answer is active
            self.movers[VERIFIER, every] = needs_answer
        else:
            self.movers[:, every] = is_active
        for role, message in ((PROPOSER, proposer_message), (VERIFIER, verifier_message)):
            if message is not None:
                self.rewards[role, every] -= game.settings.message_cost * (message > SILENCE)
        if game.history_length:
            self.history[every, :-1] = self.history[every, 1:]
            self.history[every, -1] = np.stack([choice, answer, *self.messages[:, every]], axis=-1)

    def _update_distances(self, indices: Int64Array) -> None:
        if (distance := self.game.goal_distance) is not None:
            self._distances[indices] = [distance(self.mdp(index)) for index in indices.tolist()]

    def _reward_progress(self, played: Int64Array) -> None:
        """Adds the term `progress` in games (k,) whose scene has changed: 0 where a distance is not known."""
        before = self._distances.copy()
        self._update_distances(played)
        change = np.nan_to_num(before - self._distances)
        self.rewards += self.game.progress_weights[:, None] * change

    def _decode_actions(self, role: Role, actions: Any, every: Any) -> tuple[Any, Any]:
        """By game: the choices, NO_CHOICE if out of turn or illegal; the messages, None if `role` has none."""
        movers = self.movers[role, every]
        size = self.game.message_sizes[role]
        own = self.game.choices[role]
        choice, message = np.divmod(actions, size + 1) if size else (actions, None)
        is_legal = movers & (choice >= own.start) & (choice < own.stop)
        wait_action = self.game.wait_actions[role]
        chooses = movers if wait_action is None else movers | (actions != wait_action)
        self._illegal[role, every] = chooses != is_legal
        if message is not None:
            message = _where(is_legal, message, SILENCE)
            self.messages[role, every] = _where(movers, message, self.messages[role, every])
        return _where(is_legal, choice, NO_CHOICE), message

    def _claims_hold(self, decision: Any, every: Any) -> Any:
        """By game: 1 if a claim judged in this turn holds, otherwise 0, also where nothing depends on it."""
        needed = self._needs_truth[decision]
        is_needed = self._judges and np.any(needed)
        self._holds[every] = _where(needed, self.goals_reached()[every], False) if is_needed else False
        return self._holds[every]

    def _step_mdps(self, mdp_move: Any, proposal: Any, every: Any) -> Any:
        """Steps the MDPs as decided. By game: indices of step results, or `no_mdp_step`."""
        buffers = self._buffers
        buffers.action[every] = _where(mdp_move == STOP, STOP_ACTION, proposal)
        buffers.result[every] = self.game.decision_table.no_mdp_step
        acting = _games_where(mdp_move >= PROPOSAL, every)
        waiting = _games_where(mdp_move == WAIT, every)
        if len(acting):
            self._core.step(None if len(acting) == len(buffers.action) else acting)
            self._has_masks = self._has_items = False
        if len(waiting):
            self._core.wait(waiting)
        self._results[every] = buffers.result[every]
        return self._results[every]

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

    def masks(self, role: Role, indices: Indices) -> Int8Array:
        """(..., actions) a new array: 1 for each legal action of `role`; there is always at least one."""
        game = self.game
        if isinstance(indices, int):
            if game.turn_based and not self.movers[role, indices]:
                return game.wait_masks[role].copy()
            return game.answer_mask.copy() if role is VERIFIER else game.proposer_masks(self.legal()[indices])
        masks = np.repeat(game.wait_masks[role][None], len(indices), axis=0)
        moving: Any = self.movers[role, indices].nonzero()[0] if game.turn_based else slice(None)
        if not game.turn_based or len(moving):
            masks[moving] = game.answer_mask if role is VERIFIER else game.proposer_masks(self.legal()[indices[moving]])
        return masks

    def legal(self) -> BoolArray:
        """(N, actions of the MDP); read-only."""
        if not self._has_masks:
            self._core.write_masks()
            self._has_masks = True
        return self._buffers.mask

    def movers_of(self, index: int) -> tuple[Role, ...]:
        """The agents to act in a game; empty after its end."""
        proposer, verifier = self.movers[:, index].tolist()
        return _MOVERS[proposer][verifier]

    def mdp(self, index: int) -> State:
        """The MDP's state in a game."""
        return self._core.state(index)

    def state(self, index: int) -> GameState:
        """The state of a game."""
        proposal = int(self.proposals[index])
        return GameState(self.mdp(index), Intent(int(self.intents[index])), None if proposal == NO_CHOICE else proposal)

    def proposed_scene(self, index: int) -> Scene:
        """The scene of a game after the pending proposal; the current one if that is none, STOP or invalid."""
        mdp = self.mdp(index)
        proposal = int(self.proposals[index])
        if proposal <= STOP_ACTION:
            return mdp.scene
        dynamics = self.game.dynamics
        return dynamics.step(mdp._replace(steps=0), dynamics.appearance.decode(proposal)).state.scene

    @property
    def have_infos(self) -> BoolArray:
        """(N,) whether there is something in `infos`."""
        return self.terminated | self.truncated | self._illegal.any(0) | self.game.reveals_truth

    def infos(self, index: int) -> tuple[Info, Info]:
        """Both agents' infos after a turn: outcome at the end, illegal choices, the truth if settings reveal it."""
        illegal = self._illegal[:, index].tolist()
        is_over = self.terminated[index] or self.truncated[index]
        if not (is_over or self.game.reveals_truth or any(illegal)):
            return {}, {}
        shared = self.truth_info(index)
        if shared and (judgement := self.last_judgement(index)) is not None:
            shared["judgement"] = {"accepted": judgement.accepted, "holds": judgement.holds}
        if is_over:
            reason = int(self._buffers.invalid[index])
            outcome = self.last_outcome(index)
            assert outcome is not None
            shared |= end_info(outcome, None if reason == NO_REASON else INVALID_REASONS[reason])
        proposer, verifier = ({**shared, "illegal_choice": True} if wrong else shared.copy() for wrong in illegal)
        return proposer, verifier

    def truth_info(self, index: int) -> Info:
        """The info entries of the setting `reveal_truth`; {} without it."""
        if not self.game.reveals_truth:
            return {}
        mdp = self.mdp(index)
        return {
            "truth": mdp.task.truth(mdp.scene),
            "goal_reached": self.game.dynamics.goal_reached(mdp),
            "intent": Intent(int(self.intents[index])).name.lower(),
        }

    def last_outcome(self, index: int) -> Outcome | None:
        """The MDP's outcome in the last turn of a game; None if it took no step."""
        results = self.game.dynamics.step_results
        result = self._results[index]
        return results[result].outcome if result < len(results) else None

    def last_judgement(self, index: int) -> Judgement | None:
        """The judgement in the last turn of a game; `holds` is valid only if the settings reveal the truth."""
        decision = self.game.decision_table.decisions[self._decisions[index]]
        return judgement_in(decision, holds=bool(self._holds[index]))

    @property
    def verdicts(self) -> Int64Array:
        """(N,) in the last turn: 1 where the verifier accepted a claim, 0 where it rejected one, otherwise -1."""
        return self.game.decision_table.verdicts[self._decisions]

    @property
    def holds(self) -> BoolArray:
        """(N,) `Judgement.holds` in the last turn; valid only where judged, and if the settings reveal the truth."""
        return self._holds.astype(bool)

    @property
    def successes(self) -> BoolArray:
        """(N,) whether the game ended in success in the last turn."""
        return self._mdp_results.successes[self._results]

    def goals_reached(self) -> BoolArray:
        """(N,) whether the statement has the target value; read-only."""
        self._core.write_goals()
        return self._buffers.goal
