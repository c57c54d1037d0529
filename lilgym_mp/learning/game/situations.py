"""What an agent knows in its turn, as arrays: the scene's boxes, the statement, the target, and the turn's context.

The verifier sees the scene after the pending proposal. The context is one small number for each of CONTEXT.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lilgym_mp.arrays import Int16Array, Int64Array
from lilgym_mp.envs.proposer_verifier.game import Game, GameState
from lilgym_mp.envs.proposer_verifier.game_arrays import GameArrays
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE, PROPOSER, Role
from lilgym_mp.envs.proposer_verifier.views import GameSetup, ItemArrayPart, ProposedScenePart

CONTEXT = ("role", "intent", "pending", "message", "refused", "rounds", "goal")  # 0 where an agent does not know it
ROLE, INTENT, PENDING, MESSAGE, REFUSED, ROUNDS, GOAL = range(len(CONTEXT))
STOP_PENDING, EDIT_PENDING = 1, 2
MOST_ROUNDS = 12  # more count as so many


def context_sizes(game: Game) -> tuple[int, ...]:
    """How many values each of CONTEXT has."""
    return 2, 3, 3, max(game.message_sizes) + 1, game.config.dynamics.appearance.action_count + 1, MOST_ROUNDS + 1, 3


class Situations(NamedTuple):
    """The situations of one agent in k games."""

    items: Int16Array  # (k, 3, capacity, 5)
    context: Int64Array  # (k, 7)


class SituationReader:
    """Reads situations from batches of games and from single ones."""

    def __init__(self, setup: GameSetup) -> None:
        self._game = setup.game
        self._scene = ItemArrayPart(setup)
        self._proposed = ProposedScenePart(setup, self._scene) if setup.game.turn_based else self._scene

    def read(self, games: GameArrays, role: Role, indices: Int64Array) -> Situations:
        """Of the games (k,)."""
        scene = self._scene if role is PROPOSER else self._proposed
        context = self._context(
            role,
            games.intents[indices],
            games.proposals[indices],
            games.refused[indices],
            games.messages[:, indices],
            games.rounds[indices],
        )
        return Situations(scene.encode_batch(games, indices), context)

    def read_state(self, state: GameState, role: Role) -> Situations:
        """Of a single game."""
        scene = self._scene if role is PROPOSER else self._proposed
        proposal, refused = (NO_CHOICE if action is None else action for action in (state.proposal, state.refused))
        intent, proposals, refusals = (np.array([value]) for value in (int(state.intent), proposal, refused))
        messages, rounds = np.array(state.messages)[:, None], np.array([state.mdp.steps])
        context = self._context(role, intent, proposals, refusals, messages, rounds)
        return Situations(np.asarray(scene.encode(state), np.int16)[None], context)

    def _context(
        self,
        role: Role,
        intents: Int64Array,
        proposals: Int64Array,
        refused: Int64Array,
        messages: Int64Array,
        rounds: Int64Array,
    ) -> Int64Array:
        context = np.zeros((len(intents), len(CONTEXT)), np.int64)
        context[:, ROLE] = role
        context[:, MESSAGE] = messages[role.other]
        context[:, ROUNDS] = np.minimum(rounds, MOST_ROUNDS)
        if role is PROPOSER:
            context[:, REFUSED] = refused + 1
            if self._game.rewards.draws_intent:
                context[:, INTENT] = intents + 1
        else:
            context[:, PENDING] = np.minimum(proposals + 1, EDIT_PENDING)
        return context


def with_hidden_facts(context: Int64Array, games: GameArrays, indices: Int64Array) -> Int64Array:
    """The context a central critic sees: also the intent and whether the statement has the target value."""
    full = context.copy()
    full[:, INTENT] = games.intents[indices] + 1
    full[:, GOAL] = games.goals_reached()[indices].astype(np.int64) + 1
    return full
