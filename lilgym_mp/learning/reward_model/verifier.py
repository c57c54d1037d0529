"""A reward model as the verifier of the two-agent game: it judges claims by P(true), and accepts every edit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lilgym_mp.arrays import Int64Array
from lilgym_mp.envs.proposer_verifier import BatchTurn, PartnerTurn, Role
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.partners import encode_answer
from lilgym_mp.envs.proposer_verifier.protocols import STOP_ACTION
from lilgym_mp.learning.reward_model.agent import RewardModelAgent
from lilgym_mp.rules import State


@dataclass(frozen=True)
class RewardModelVerifier:
    """Accepts a claim whose probability is above 1/2; with `verdict_bins` it gives the nearest probability instead."""

    agent: RewardModelAgent

    def __call__(self, turn: PartnerTurn) -> int:
        return self._answer(turn.game, turn.state.mdp, turn.state.proposal)

    def batch(self, turn: BatchTurn) -> Int64Array:
        """(k,) actions."""
        answers = (self._answer(turn.game, state.mdp, state.proposal) for state in turn.states())
        return np.fromiter(answers, np.int64, len(turn.indices))

    def _answer(self, game: Game, state: State, proposal: int | None) -> int:
        if proposal not in (None, STOP_ACTION):
            return encode_answer(game, accepts=True)
        probability = self.agent.success_probability(state)
        if game.config.verdict_bins is None:
            return encode_answer(game, accepts=probability > 0.5)
        return game.encode_action(Role.VERIFIER, round(probability * (game.config.verdict_bins - 1)))
