"""Log-probabilities of actions and action sets, compared with enumeration."""

import numpy as np
import pytest
import torch

from lilgym_mp.learning.imitation.action_heads import action_heads
from lilgym_mp.learning.imitation.agent import log_policy
from lilgym_mp.learning.imitation.batches import set_log_probabilities
from lilgym_mp.learning.imitation.network import MAX_STEPS, Outputs
from lilgym_mp.scene.appearances import make_appearance


def test_set_log_probabilities__sums_over_the_actions_of_the_set(appearance):
    heads = action_heads(make_appearance(appearance))
    made = torch.Generator().manual_seed(0)
    sizes = ((2,), (2, 2), (2, heads.add_count), (2, heads.remove_count), (2, MAX_STEPS))
    outputs = Outputs(*(3 * torch.randn((2, *size), generator=made) for size in sizes), legal=None)
    targets = torch.tensor([[0, 1], [1, 0]])
    optimal = torch.rand((2, 2, heads.size), generator=made) < 0.3
    optimal[..., 0] = False
    optimal[0, 0, 1 : 1 + heads.add_count] = False  # a set of REMOVEs alone
    optimal[..., -1] = True
    policy = log_policy(outputs, targets).exp().double().numpy()
    found = set_log_probabilities(outputs, optimal)
    for place in np.ndindex(2, 2):
        edits = 1 - policy[place][0]
        total = sum(policy[place][head] for head in range(heads.size) if optimal[place][head])
        assert float(found[place]) == pytest.approx(np.log(total / edits), abs=1e-4)


def test_action_heads__index_maps_are_inverse_except_on_separators(appearance):
    heads = action_heads(make_appearance(appearance))
    assert np.array_equal(heads.index_of[heads.action_of], np.arange(heads.size))
    left_out = np.flatnonzero(heads.index_of < 0)
    assert len(left_out) == (0 if appearance == "tower" else 2 * 2 * 5 * 28)
