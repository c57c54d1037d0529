"""Single-agent trained agents as partners in the proposer-verifier game.

They act on the half-size image, the statement and the target, whatever their seat's view: a proposer proposes the
action it would take, a verifier accepts a claim exactly where it would itself STOP, and accepts every edit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.envs.proposer_verifier import BatchTurn, PartnerTurn, Role
from lilgym_mp.envs.proposer_verifier.partners import encode_answer, encode_answers
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE, STOP_ACTION
from lilgym_mp.evaluation import Observations, Policy
from lilgym_mp.render import draw
from lilgym_mp.rules import State


class AgentPartner:
    """A policy in one seat."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._needs_masks: bool = getattr(policy, "needs_masks", True)

    def __call__(self, turn: PartnerTurn) -> int:
        game, state = turn.game, turn.state
        legal = game.config.dynamics.legal_mask(state.mdp)[None] if self._needs_masks else None
        chosen = int(self._chosen([state.mdp], np.zeros(1, np.int64), legal, turn.rng)[0])
        if turn.role is Role.PROPOSER:
            action = game.encode_action(Role.PROPOSER, chosen)
            return action if turn.action_mask[action] else turn.random_action()
        is_edit = state.proposal not in (None, NO_CHOICE, STOP_ACTION)
        return encode_answer(game, accepts=is_edit or chosen == STOP_ACTION)

    def batch(self, turn: BatchTurn) -> Int64Array:
        """The actions in many games."""
        games, indices = turn.games, turn.indices
        legal = games.legal()[indices] if self._needs_masks else None
        chosen = self._chosen([games.mdp(index) for index in indices.tolist()], turn.episodes, legal, turn.rngs[0])
        if turn.role is Role.PROPOSER:
            actions = turn.game.encode_action(Role.PROPOSER, 1) * chosen
            is_legal = turn.action_mask[np.arange(len(actions)), actions] > 0
            return actions if is_legal.all() else np.where(is_legal, actions, turn.random_actions())
        is_edit = games.proposals[indices] > STOP_ACTION
        return encode_answers(turn.game, is_edit | (chosen == STOP_ACTION))

    def _chosen(
        self, states: Sequence[State], episodes: Int64Array, legal: BoolArray | None, rng: np.random.Generator
    ) -> Int64Array:
        """(k,) actions of the policy in k states."""
        observations = Observations(
            np.stack([draw(state.scene, "half") for state in states]),
            tuple(state.task.statement for state in states),
            np.array([int(state.task.target) for state in states]),
            np.array([state.steps for state in states]),
            episodes,
        )
        return self._policy(observations, np.zeros((len(states), 0), np.bool_) if legal is None else legal, rng)
