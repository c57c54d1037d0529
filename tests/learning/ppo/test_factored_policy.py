"""Factored policies: hand-written examples, and brute-force enumeration of all actions."""

import numpy as np
import pytest
import torch
from torch.testing import assert_close

from lilgym_mp.learning.common.factored_policy import (
    CHUNK,
    FactoredPolicy,
    joint_factorisation,
    log_prob_and_entropy,
    slot_factorisation,
)
from lilgym_mp.scene.actions import ActionType
from lilgym_mp.scene.appearances import Scatter, Tower

STATES = 3
NAMED = {"tower": Tower(), "scatter": Scatter(), "slot": slot_factorisation, "joint": joint_factorisation}
EACH = pytest.mark.parametrize(
    ("appearance", "make"), [(NAMED[name], NAMED[form]) for name in ("tower", "scatter") for form in ("slot", "joint")]
)


def logits(factorisation, seed=0):
    generator = torch.Generator().manual_seed(seed)
    sizes = [len(ActionType), *(head.size for head in factorisation.heads)]
    types, *heads = (
        torch.randn(STATES, size, generator=generator, dtype=torch.float64, requires_grad=True) for size in sizes
    )
    return types, heads


def gradients(values, *parameters):
    """Of a weighted sum of the states' values."""
    weights = torch.linspace(-2, 1, len(values), dtype=torch.float64)
    total = (values * weights).sum()
    return torch.autograd.grad(total, parameters, retain_graph=True, allow_unused=True, materialize_grads=True)


def kinds_of(appearance):
    """The type of each action."""
    return np.array([appearance.to_array(appearance.decode(index))[0] for index in range(appearance.action_count)])


def enumerated(factorisation, types, heads):
    """(states, actions) probabilities."""
    return FactoredPolicy(factorisation, types, heads).joint_log_probs().exp()


# Actions as released arrays, and the choices that they make, by head: slots, or places among all ADDs and all REMOVEs,
# which are ordered by box, cell row, cell column and item type.
EXAMPLES = """
tower   slot  0 -1 -1          |
tower   slot  1 2 0            | 0:2 1:0
tower   slot  2 1 -1           | 0:1
tower   joint 0 -1 -1          |
tower   joint 1 2 1            | 0:7
tower   joint 2 1 -1           | 1:1
scatter slot  1 18 4 2 1 0     | 0:18 1:4 2:2 3:1 4:0
scatter slot  2 7 0 -1 -1 -1   | 0:7 1:0
scatter joint 0 -1 -1 -1 -1 -1 |
scatter joint 1 8 3 2 1 0      | 0:1128
scatter joint 2 18 4 -1 -1 -1  | 1:74
"""


@pytest.mark.parametrize("line", EXAMPLES.strip().splitlines())
def test_policy__the_probability_of_an_action_is_that_of_its_type_times_those_of_its_choices(line):
    (name, form, *array), choices = map(str.split, line.split("|"))
    factorisation, array = NAMED[form](NAMED[name]), [*map(int, array)]
    types, heads = logits(factorisation)
    wanted = types.softmax(1)[:, array[0]]
    for head, choice in (map(int, each.split(":")) for each in choices):
        wanted = wanted * heads[head].softmax(1)[:, choice]
    index = NAMED[name].encode(NAMED[name].from_array(array))
    assert_close(enumerated(factorisation, types, heads)[:, index], wanted)


@EACH
def test_policy__probabilities_entropy_and_gradients_match_enumeration(appearance, make):
    factorisation = make(appearance)
    types, heads = logits(factorisation)
    every = enumerated(factorisation, types, heads)
    assert every.shape == (STATES, {"tower": 13, "scatter": 2661}[appearance.name])
    assert_close(every.sum(1), torch.ones(STATES, dtype=torch.float64))
    policy = FactoredPolicy(factorisation, types, heads)
    rng = np.random.default_rng(1)
    possible = np.flatnonzero(every[0].detach().numpy() > 0)
    actions = torch.from_numpy(np.array([0, *rng.choice(possible, STATES - 1)]))
    log_probabilities = every.gather(1, actions[:, None]).squeeze(1).log()
    entropies = -(every * every.clamp(min=1e-300).log()).sum(1)
    assert_close(policy.log_prob(actions), log_probabilities)
    for found, wanted in zip(policy.evaluate_actions(actions), (log_probabilities, entropies), strict=True):
        assert_close(found, wanted)
        assert_close(gradients(found, types, *heads), gradients(wanted, types, *heads))


def test_log_prob_and_entropy__match_autograd_over_several_chunks():
    generator = torch.Generator().manual_seed(0)
    logits = torch.randn(3 * CHUNK // 2, 7, generator=generator, dtype=torch.float64).requires_grad_()
    choices = torch.randint(7, (len(logits),), generator=generator)
    logs = logits.log_softmax(1)
    wanted = logs.gather(1, choices[:, None]).squeeze(1), -(logs.exp() * logs).sum(1)
    for one, other in zip(log_prob_and_entropy(logits, choices), wanted, strict=True):
        assert_close(one, other)
        assert_close(gradients(one, logits), gradients(other, logits))


@EACH
def test_mask__renormalises_over_legal_actions(appearance, make):
    factorisation = make(appearance)
    types, heads = logits(factorisation)
    every = enumerated(factorisation, types, heads).detach()
    legal = torch.from_numpy(np.random.default_rng(2).random(every.shape) < 0.2)
    legal[:, 0] = True
    policy = FactoredPolicy(factorisation, types, heads, legal)
    wanted = every * legal / (every * legal).sum(1, keepdim=True)
    actions = torch.zeros(STATES, dtype=torch.int64)
    assert_close(policy.log_prob(actions).exp(), wanted[:, 0])
    assert_close(policy.stop_probability(), wanted[:, 0])
    assert_close(policy.evaluate_actions(actions)[1], -(wanted * wanted.clamp(min=1e-300).log()).sum(1))
    assert legal[torch.arange(STATES), torch.from_numpy(policy.sample(np.random.default_rng(3)))].all()
    assert (torch.from_numpy(policy.greedy()) == wanted.argmax(1)).all()


@EACH
def test_sample__frequencies_match_probabilities(appearance, make):
    factorisation = make(appearance)
    types, heads = logits(factorisation)
    many = 20_000
    repeated = [logit[:1].expand(many, -1) for logit in (types, *heads)]
    drawn = FactoredPolicy(factorisation, repeated[0], repeated[1:]).sample(np.random.default_rng(0))
    every = enumerated(factorisation, types, heads).detach()[0].numpy()
    shares = np.bincount(drawn, minlength=len(every)) / many
    assert shares[every == 0].sum() == 0
    assert np.abs(shares - every).max() < 5 * np.sqrt(every.max() / many)
    kinds = kinds_of(appearance)
    for kind in ActionType:
        assert abs(shares[kinds == kind].sum() - every[kinds == kind].sum()) < 0.02


@EACH
def test_greedy__is_the_most_probable_type_with_its_most_probable_arguments(appearance, make):
    factorisation = make(appearance)
    types, heads = logits(factorisation)
    chosen = FactoredPolicy(factorisation, types, heads).greedy()
    every = enumerated(factorisation, types, heads).detach().numpy()
    kinds = kinds_of(appearance)
    for state in range(STATES):
        best = int(types[state].argmax())
        assert chosen[state] == np.where(kinds == best, every[state], 0).argmax()


def test_factorisation__only_joint_heads_exclude_scatters_separators():
    joint, factored = joint_factorisation(Scatter()), slot_factorisation(Scatter())
    assert [head.size for head in joint.heads] == [75 * 27, 75]
    assert [head.size for head in factored.heads] == [19, 5, 3, 3, 3]
    assert (joint.types < 0).sum() == 20 * 28
    types, heads = logits(joint)
    left_out = torch.from_numpy(np.flatnonzero(joint.types < 0)[:STATES])
    assert FactoredPolicy(joint, types, heads).log_prob(left_out).exp().sum() == 0
    finer = joint_factorisation(Scatter((38, 10)))
    assert finer.heads[1].size == 3 * 10 * 10


def test_factorisation__with_separators_every_action_has_choices_of_its_own():
    boxes, everywhere = joint_factorisation(Scatter()), joint_factorisation(Scatter(), separators=True)
    assert [head.size for head in everywhere.heads] == [95 * 27, 95]
    assert len(np.unique(np.column_stack([everywhere.types, everywhere.choices]), axis=0)) == 2_661
    inside = boxes.types >= 0
    assert (boxes.choices[inside] == everywhere.choices[inside]).all()
    assert joint_factorisation(Tower(), separators=True).heads == joint_factorisation(Tower()).heads
