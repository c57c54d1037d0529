"""The reward model as a verifier."""

from functools import partial
from types import SimpleNamespace

import pytest

from lilgym_mp.envs.proposer_verifier import measure
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.envs.proposer_verifier.partners import ClaimingProposer
from lilgym_mp.envs.proposer_verifier.rewards import Intent
from lilgym_mp.learning.reward_model.agent import RewardModelAgent


@pytest.mark.parametrize("intent", list(Intent))
@pytest.mark.parametrize("probability", [0.6, 0.97])
def test_verifier__accepts_the_claims_it_finds_probable(intent, probability):
    model = SimpleNamespace(
        success_probability=lambda state: probability if state.task.solved_by(state.scene) else 1 - probability
    )
    env = BaseGameEnv("TowerFlipIt", protocol="audit", split="dev")
    tasks = env.tasks.ids[:60]
    measured = measure(env, ClaimingProposer(intent), partial(RewardModelAgent.answer, model), tasks=tasks, seed=0)
    judged = [(each["true_accept_rate"], each["false_accept_rate"]) for each in measured.by_target.values()]
    assert {true for true, _ in judged} <= {1.0, None}
    assert {false for _, false in judged} <= {0.0, None}
