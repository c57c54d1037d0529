"""An agent's knowledge in its turn, as arrays: the scene's boxes, the statement, the target, and the turn's context.

An agent knows what its view shows, and the number of rounds. A verifier that sees a proposal sees the scene after it.
The context is a row of small numbers: one for each of CONTEXT, then past turns, then a proposal whose scene is not
seen.
"""

from __future__ import annotations

import numpy as np

from lilgym_mp.envs.proposer_verifier import View
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.observations import ObservedGames
from lilgym_mp.envs.proposer_verifier.protocols import VERIFIER, Role
from lilgym_mp.scene.arrays import Int16Array, Int64Array

CONTEXT = ("role", "intent", "pending", "message", "refused", "rounds", "bias")  # 0 where an agent does not know it
ROLE, INTENT, PENDING, MESSAGE, REFUSED, ROUNDS, _BIAS = range(len(CONTEXT))
STOP_PENDING = 1
EDIT_PENDING = 2
MOST_ROUNDS = 12  # more count as so many
HIDDEN_STATEMENT = ""  # which networks read instead of a statement that is not seen


def context_sizes(game: Game) -> tuple[int, ...]:
    """How many values each number of a context has; the bias is always 0, but saved networks have three."""
    actions = game.dynamics.appearance.action_count + 1
    proposer_messages, verifier_messages = game.message_sizes
    turn = actions, len(game.protocol.answers) + 1, proposer_messages + 2, verifier_messages + 2
    proposal = (actions,) if _reads_proposal(game.views[VERIFIER]) else ()
    return 2, 3, 3, max(game.message_sizes) + 1, actions, MOST_ROUNDS + 1, 3, *turn * game.history_length, *proposal


def _reads_proposal(view: View) -> bool:
    """Whether it has a proposal and no scene to show it in."""
    return view.proposal and view.scene == "none"


def read_situations(
    games: ObservedGames, role: Role, indices: Int64Array, own: Game | None = None
) -> tuple[Int16Array, Int64Array]:
    """The items (k, 3, capacity, 5), all -1 if no scene is seen, and the contexts (k, C) that `role` has in games (k,).

    `own`: the game with the views that the agent learned with; None: the game in play.
    """
    own = own or games.game
    view = own.views[role]
    sizes = context_sizes(own)
    context = np.zeros((len(indices), len(sizes)), np.int64)
    context[:, ROLE] = role
    context[:, MESSAGE] = games.messages[role.other, indices]
    context[:, ROUNDS] = np.minimum(games.rounds[indices], MOST_ROUNDS)
    if view.history:
        past = games.history[indices, -view.history :] + 1
        context[:, len(CONTEXT) : len(CONTEXT) + past[0].size] = past.reshape(len(past), -1)
    if role is VERIFIER:
        if view.proposal:
            context[:, PENDING] = np.minimum(games.proposals[indices] + 1, EDIT_PENDING)
        if _reads_proposal(view):
            context[:, -1] = games.proposals[indices] + 1
        sees_proposal = view.proposal or view.proposed_scene
        items = games.proposed_item_arrays(indices) if sees_proposal else games.item_arrays(indices)
    else:
        if view.refused:
            context[:, REFUSED] = games.refused[indices] + 1
        if games.game.draws_intent:
            context[:, INTENT] = games.intents[indices] + 1
        items = games.item_arrays(indices)
    return items if view.scene != "none" else np.full_like(items, -1), context


def seen_tasks(
    game: Game, roles: Role | Int64Array, statement_of: Int64Array, targets: Int64Array, hidden: int
) -> tuple[Int64Array, Int64Array]:
    """`statement_of` (k,) and `targets` (k,) as agents see them: `hidden` and 0 where their views have none."""
    hides_statement = np.array([view.statement == "none" for view in game.views])[roles]
    hides_target = np.array([not view.target for view in game.views])[roles]
    return np.where(hides_statement, hidden, statement_of), np.where(hides_target, 0, targets)


def check_claims(game: Game) -> None:
    """Raises ValueError if the verifier, who judges the claim, can know nothing of it."""
    view = game.views[VERIFIER]
    missing = [name for name in ("statement", "scene") if getattr(view, name) == "none"]
    if missing and not game.message_sizes[Role.PROPOSER]:
        raise ValueError(
            f"protocol {game.protocol.name!r} has verifier_0 judge whether the statement holds in the scene, but views"
            f" show it no {' and no '.join(missing)}, and proposer_0 has no messages (message_size)"
        )
