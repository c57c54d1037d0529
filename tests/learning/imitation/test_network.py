"""Invariances of the network, and equality of its evaluation scene by scene and at once."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from lilgym_mp.corpus.tokens import Vocabulary
from lilgym_mp.envs.rules import make_dynamics
from lilgym_mp.learning.common.words import StatementTokenizer
from lilgym_mp.learning.imitation.action_heads import action_heads
from lilgym_mp.learning.imitation.agent import NetworkPolicy, StopRule, choose_actions
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.dataset import DataCollector
from lilgym_mp.learning.imitation.network import ImitationNetwork
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import Scatter, Tower

STATEMENTS = ["There is a blue block.", "No circle is black and none is blue.", "Something."]


def policy_of(appearance: Tower | Scatter) -> tuple[NetworkPolicy, DataCollector]:
    table = BoxFeatureTable()
    torch.manual_seed(0)
    vocabulary = Vocabulary.from_statements(STATEMENTS)
    network = ImitationNetwork(appearance.name, len(vocabulary), width=32)
    collector = DataCollector(make_dynamics(appearance), table, np.random.default_rng(0))
    return NetworkPolicy(network, table, action_heads(appearance), StatementTokenizer(vocabulary)), collector


@pytest.mark.parametrize("appearance", [Tower(), Scatter()])
def test_policy__is_independent_of_the_rest_of_the_batch(appearance: Tower | Scatter):
    policy, collector = policy_of(appearance)
    scene = Scene.empty()
    scenes = [scene := collector.edited(scene) for _ in range(7)]
    statements = [STATEMENTS[index % 3] for index in range(7)]
    targets = np.array([0, 1, 1, 0, 1, 0, 0])
    boxes = policy.table.indices(scenes)
    together = policy.log_probabilities(statements, boxes, targets)
    for row in range(7):
        alone = policy.log_probabilities(statements[row : row + 1], boxes[row : row + 1], targets[row : row + 1])
        np.testing.assert_allclose(alone[0], together[row], atol=1e-4)


def test_stop_rule__stops_above_the_threshold_never_first_and_always_last():
    log_probabilities = np.log(
        np.array([[0.6, 0.1, 0.3], [0.6, 0.1, 0.3], [0.4, 0.5, 0.1], [0.4, 0.5, 0.1]], np.float32)
    )
    steps = np.array([0, 1, 1, 11])

    def chosen(rule: StopRule) -> list[int]:
        return choose_actions(log_probabilities, steps, 12, rule, None).tolist()

    assert chosen(StopRule()) == [0, 0, 1, 0]
    assert chosen(StopRule(never_first=True, always_last=False)) == [2, 0, 1, 1]
    assert chosen(StopRule(threshold=1.0)) == [2, 2, 1, 0]


@pytest.mark.parametrize("appearance", [Tower(), Scatter()])
def test_policy__is_equivariant_to_box_permutations(appearance: Tower | Scatter):
    policy, collector = policy_of(appearance)
    scene = Scene.empty()
    for _ in range(5):
        scene = collector.edited(scene)
    heads = policy.heads
    order = [2, 0, 1]
    found = policy.log_probabilities(
        STATEMENTS[:1] * 2, policy.table.indices([scene, scene.permuted(order)]), np.array([1, 1])
    )
    adds = found[:, 1 : 1 + heads.add_count].reshape(2, 3, -1)
    removes = found[:, 1 + heads.add_count :].reshape(2, 3, -1)
    np.testing.assert_allclose(found[0, 0], found[1, 0], atol=1e-4)
    np.testing.assert_allclose(adds[0, order], adds[1], atol=1e-4)
    np.testing.assert_allclose(removes[0, order], removes[1], atol=1e-4)
