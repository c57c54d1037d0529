"""Invariances of the network, and equality of its evaluation scene by scene and at once."""

import numpy as np
import torch
from numpy.testing import assert_allclose

from lilgym_mp.corpus.tokens import Vocabulary
from lilgym_mp.envs.rules import make_dynamics
from lilgym_mp.learning.common.words import StatementTokenizer
from lilgym_mp.learning.imitation.action_heads import action_heads
from lilgym_mp.learning.imitation.agent import NetworkPolicy, StopRule, choose_actions
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.dataset import DataCollector
from lilgym_mp.learning.imitation.network import ImitationNetwork
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import make_appearance

STATEMENTS = ["There is a blue block.", "No circle is black and none is blue.", "Something."]


def policy_of(name):
    appearance = make_appearance(name)
    table = BoxFeatureTable()
    torch.manual_seed(0)
    vocabulary = Vocabulary.from_statements(STATEMENTS)
    network = ImitationNetwork(name, len(vocabulary), width=32)
    collector = DataCollector(make_dynamics(appearance), table, np.random.default_rng(0))
    return NetworkPolicy(network, table, action_heads(appearance), StatementTokenizer(vocabulary)), collector


def test_policy__is_independent_of_the_rest_of_the_batch(appearance):
    policy, collector = policy_of(appearance)
    scene = Scene.empty()
    scenes = [scene := collector.edited(scene) for _ in STATEMENTS]
    targets = np.array([0, 1, 1])
    boxes = policy.table.indices(scenes)
    together = policy.log_probabilities(STATEMENTS, boxes, targets)
    for row, statement in enumerate(STATEMENTS):
        alone = policy.log_probabilities([statement], boxes[[row]], targets[[row]])
        assert_allclose(alone[0], together[row], atol=1e-4)


def test_stop_rule__stops_above_the_threshold_never_first_and_always_last():
    stop, add = [0.6, 0.1, 0.3], [0.4, 0.5, 0.1]
    log_probabilities = np.log(np.array([stop, stop, add, add], np.float32))
    steps = np.array([0, 1, 1, 11])

    def chosen(rule):
        return choose_actions(log_probabilities, steps, 12, rule, None).tolist()

    assert chosen(StopRule()) == [0, 0, 1, 0]
    assert chosen(StopRule(never_first=True, always_last=False)) == [2, 0, 1, 1]
    assert chosen(StopRule(threshold=1.0)) == [2, 2, 1, 0]


def test_policy__is_equivariant_to_box_permutations(appearance):
    policy, collector = policy_of(appearance)
    scene = Scene.empty()
    for _ in range(5):
        scene = collector.edited(scene)
    order = [2, 0, 1]
    boxes = policy.table.indices([scene, scene.permuted(order)])
    stop, adds, removes = np.split(
        policy.log_probabilities(STATEMENTS[:1] * 2, boxes, np.ones(2, np.int64)), [1, 1 + policy.heads.add_count], 1
    )
    assert_allclose(stop[0], stop[1], atol=1e-4)
    for edits in (adds.reshape(2, 3, -1), removes.reshape(2, 3, -1)):
        assert_allclose(edits[0, order], edits[1], atol=1e-4)
