"""Single-agent trained agents as partners in the proposer-verifier game.

They act on their seat's view, with the half-size image: a proposer proposes the action it would take, a verifier
accepts a claim exactly where it would itself STOP, and accepts every edit.
"""

from __future__ import annotations

import numpy as np

from lilgym_mp.arrays import Int64Array
from lilgym_mp.envs.proposer_verifier import BatchTurn, PartnerTurn, Role, read_text
from lilgym_mp.envs.proposer_verifier.partners import encode_answer, encode_answers
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE, STOP_ACTION
from lilgym_mp.evaluation import Observations, Policy
from lilgym_mp.render import draw

REQUIRED = ("image", "statement", "target")  # parts of the view


class PartnerViewError(ValueError):
    """A seat whose view lacks a required part."""


class AgentPartner:
    """A policy in one seat; the view must include the image, the statement text and the target."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._calls = 0

    def __call__(self, turn: PartnerTurn) -> int:
        """Raises PartnerViewError when the view lacks a required part."""
        chosen = self._policy_action(turn)
        if turn.role is Role.PROPOSER:
            action = turn.game.encode_action(Role.PROPOSER, chosen)
            return action if turn.action_mask[action] else turn.random_action()
        if turn.observation.get("proposal", (STOP_ACTION,))[0] not in (NO_CHOICE, STOP_ACTION):
            return encode_answer(turn.game, accepts=True)
        return encode_answer(turn.game, accepts=chosen == STOP_ACTION)

    def batch(self, turn: BatchTurn) -> Int64Array:
        """The actions in many games, from their images, statements and targets, whatever the view."""
        games, indices = turn.games, turn.indices
        states = [games.mdp(index) for index in indices.tolist()]
        observations = Observations(
            np.stack([draw(state.scene, "half") for state in states]),
            tuple(state.task.statement for state in states),
            np.array([int(state.task.target) for state in states]),
            np.array([state.steps for state in states]),
            turn.episodes,
        )
        needs_masks = getattr(self._policy, "needs_masks", True)
        legal = games.legal()[indices] if needs_masks else np.zeros((len(indices), 0), np.bool_)
        chosen = self._policy(observations, legal, turn.rngs[0])
        if turn.role is Role.PROPOSER:
            actions = turn.game.encode_action(Role.PROPOSER, 1) * chosen
            is_legal = turn.action_mask[np.arange(len(actions)), actions] > 0
            return actions if is_legal.all() else np.where(is_legal, actions, turn.random_actions())
        is_edit = games.proposals[indices] > STOP_ACTION
        return encode_answers(turn.game, is_edit | (chosen == STOP_ACTION))

    def _policy_action(self, turn: PartnerTurn) -> int:
        view = turn.observation
        missing = [name for name in REQUIRED if name not in view]
        if missing:
            raise PartnerViewError(f"this agent needs {', '.join(missing)} in its view; give its seat the whole view")
        observations = Observations(
            draw(turn.state.mdp.scene, "half")[None],
            (read_text(view["statement"]),),
            np.array([int(view["target"])]),
            np.array([self._calls]),
            np.zeros(1, np.int64),
        )
        self._calls += 1
        mdp_mask = turn.game.config.dynamics.legal_mask(turn.state.mdp)[None]
        needs_masks = getattr(self._policy, "needs_masks", True)
        legal = mdp_mask if needs_masks else np.zeros((1, 0), np.bool_)
        return int(self._policy(observations, legal, turn.rng)[0])
