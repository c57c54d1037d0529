"""Trained agents of the single-agent tasks as partners in the proposer and verifier game.

They see what their seat's view says, its picture at half size: a proposer proposes what it would do, a verifier takes a
claim for true where it would stop itself, and accepts every edit.
"""

from __future__ import annotations

import numpy as np

from lilgym_mp.envs.proposer_verifier import PartnerTurn, Role, read_text
from lilgym_mp.envs.proposer_verifier.partners import encode_answer
from lilgym_mp.envs.proposer_verifier.types import NO_CHOICE, STOP_ACTION
from lilgym_mp.evaluation import Observations, Policy
from lilgym_mp.render import draw

NEEDED = ("image", "statement", "target")  # parts of the view


class PartnerViewError(ValueError):
    """A seat whose view lacks what the agent needs."""


class AgentPartner:
    """A policy in one seat of one game; the view must have the image, the statement as text and the target."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._asked = 0

    def __call__(self, turn: PartnerTurn) -> int:
        """Raises PartnerViewError where the seat does not see enough."""
        chosen = self._would_do(turn)
        if turn.role is Role.PROPOSER:
            action = turn.game.encode_action(Role.PROPOSER, chosen)
            return action if turn.action_mask[action] else turn.random_action()
        if turn.observation.get("proposal", (STOP_ACTION,))[0] not in (NO_CHOICE, STOP_ACTION):
            return encode_answer(turn.game, accepts=True)
        return encode_answer(turn.game, accepts=chosen == STOP_ACTION)

    def _would_do(self, turn: PartnerTurn) -> int:
        seen = turn.observation
        missing = [name for name in NEEDED if name not in seen]
        if missing:
            raise PartnerViewError(f"this agent needs to see {', '.join(missing)}; give its seat the whole view")
        observations = Observations(
            draw(turn.state.mdp.scene, "half")[None],
            (read_text(seen["statement"]),),
            np.array([int(seen["target"])]),
            np.array([self._asked]),
            np.zeros(1, np.int64),
        )
        self._asked += 1
        mdp_mask = turn.game.config.dynamics.legal_mask(turn.state.mdp)[None]
        needs_masks = getattr(self._policy, "needs_masks", True)
        legal = mdp_mask if needs_masks else np.zeros((1, 0), np.bool_)
        return int(self._policy(observations, legal, turn.rng)[0])
