"""The decision table agrees with the protocols and rewards."""

from __future__ import annotations

from typing import Any

import pytest

from lilgym_mp.envs.proposer_verifier import PROTOCOLS, Intent
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE, ProposalType, TurnInput
from lilgym_mp.envs.proposer_verifier.rewards import Judgement
from tests.envs.proposer_verifier.games import ACCEPT, game

GAMES = [
    *({"protocol": protocol, "ending": ending} for protocol in PROTOCOLS for ending in PROTOCOLS[protocol].endings),
    {"protocol": "audit", "verdict_bins": 5, "rewards": "log"},
]


@pytest.mark.parametrize("settings", GAMES, ids=str)
def test_indices__lead_to_the_protocols_decisions(settings: dict[str, Any]):
    this = game(**settings)
    table, decide = this.decision_table, this.protocol.decide
    for is_answer in range(len(table.indices)):
        for proposal in ProposalType:
            for answer in (*this.choices[1], NO_CHOICE):
                for spent in (False, True):
                    turn_input = TurnInput(bool(is_answer), proposal, None if answer == NO_CHOICE else answer, spent)
                    decision = table.decisions[table.indices[is_answer, proposal, answer, int(spent)]]
                    assert decision == decide(this.config, turn_input)


@pytest.mark.parametrize("rewards", ["correctness", "hidden"])
def test_rewards__equal_the_reward_scheme(rewards: str):
    this = game(rewards=rewards, false_accept_cost=3.0)
    table = this.decision_table
    stop = table.indices[1, ProposalType.STOP, ACCEPT, 0]
    for result in this.config.dynamics.step_results:
        for holds in (False, True):
            for intent in Intent:
                expected = this.rewards(result.reward, Judgement(1.0, final=True, holds=holds), intent)
                assert tuple(table.rewards[:, stop, result.code, int(holds), intent]) == expected


def test_rewards__without_an_mdp_step_depend_only_on_the_judgement():
    this = game(protocol="critique", rewards="correctness", false_reject_cost=0.5)
    table = this.decision_table
    rejected = table.indices[1, ProposalType.STOP, NO_CHOICE, 0]
    assert table.rewards[:, rejected, table.no_mdp_step].tolist() == [[[0.0] * 2, [0.0] * 2], [[0.0] * 2, [-0.5] * 2]]


@pytest.mark.parametrize(("rewards", "matters"), [("common", False), ("correctness", True), ("deceptive", True)])
def test_needs_truth__only_if_a_reward_depends_on_it(rewards: str, matters: bool):
    table = game(protocol="joint", rewards=rewards).decision_table
    judging = [index for index, decision in enumerate(table.decisions) if decision.probability is not None]
    assert any(table.needs_truth[index] for index in judging) == matters
    assert not any(matters for index, matters in enumerate(table.needs_truth) if index not in judging)
