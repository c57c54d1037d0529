"""An agent's knowledge in its turn, as arrays: the scene's boxes, the statement, the target, and the turn's context.

The verifier sees the scene after the pending proposal. The context is one small number for each of CONTEXT.
"""

from __future__ import annotations

import numpy as np

from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.observations import ObservedGames
from lilgym_mp.envs.proposer_verifier.protocols import VERIFIER, Role
from lilgym_mp.scene.arrays import Int16Array, Int64Array

CONTEXT = ("role", "intent", "pending", "message", "refused", "rounds", "bias")  # 0 where an agent does not know it
ROLE, INTENT, PENDING, MESSAGE, REFUSED, ROUNDS, _BIAS = range(len(CONTEXT))
STOP_PENDING, EDIT_PENDING = 1, 2
MOST_ROUNDS = 12  # more count as so many


def context_sizes(game: Game) -> tuple[int, ...]:
    """How many values each of CONTEXT has; the bias is always 0, but saved networks have three."""
    return 2, 3, 3, max(game.message_sizes) + 1, game.dynamics.appearance.action_count + 1, MOST_ROUNDS + 1, 3


def read_situations(games: ObservedGames, role: Role, indices: Int64Array) -> tuple[Int16Array, Int64Array]:
    """The items (k, 3, capacity, 5) and the context (k, 7) that `role` sees in games (k,)."""
    context = np.zeros((len(indices), len(CONTEXT)), np.int64)
    context[:, ROLE] = role
    context[:, MESSAGE] = games.messages[role.other, indices]
    context[:, ROUNDS] = np.minimum(games.rounds[indices], MOST_ROUNDS)
    if role is VERIFIER:
        context[:, PENDING] = np.minimum(games.proposals[indices] + 1, EDIT_PENDING)
        return games.proposed_item_arrays(indices), context
    context[:, REFUSED] = games.refused[indices] + 1
    if games.game.draws_intent:
        context[:, INTENT] = games.intents[indices] + 1
    return games.item_arrays(indices), context
