"""Advantages and losses, compared with hand calculations."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from lilgym_mp.learning.common.update import (
    Transitions,
    generalised_advantages,
    losses,
    policy_loss,
    scale_advantages,
    value_loss,
)
from lilgym_mp.learning.ppo.learner import PPORecipe

GAMMA, LAMBDA = 0.9, 0.8
STEP_COST = -0.1


def advantages(rewards, values, *, ended, after=0.0):
    """Advantages of consecutive steps; `after`: the bootstrap value if the episode continues."""
    ends = [False] * (len(rewards) - 1) + [ended]
    arrays = (np.array(column, np.float32)[:, None] for column in (rewards, values))
    found = generalised_advantages(*arrays, np.array(ends)[:, None], np.array([after], np.float32), GAMMA, LAMBDA)
    return found[:, 0].tolist()


@pytest.mark.parametrize(
    "reward",
    [pytest.param(1.0, id="success"), pytest.param(-1.0, id="wrong stop, invalid action or horizon")],
)
def test_advantages__do_not_bootstrap_past_the_end(reward):
    first, last = 0.3, 0.5
    gap = reward - last
    wanted = [STEP_COST + GAMMA * last - first + GAMMA * LAMBDA * gap, gap]
    assert advantages([STEP_COST, reward], [first, last], ended=True, after=123.0) == pytest.approx(wanted)


def test_advantages__bootstrap_the_next_value_of_a_continuing_episode():
    gap = STEP_COST + GAMMA * 0.7 - 0.5
    wanted = [STEP_COST + GAMMA * 0.5 - 0.3 + GAMMA * LAMBDA * gap, gap]
    assert advantages([STEP_COST, STEP_COST], [0.3, 0.5], ended=False, after=0.7) == pytest.approx(wanted)


def test_weighed__normalised_is_centred_and_scaled_keeps_signs():
    some = np.array([[0.5, 1.0], [2.0, 0.1]], np.float32)
    assert scale_advantages(some, "normalised").mean() == pytest.approx(0, abs=1e-6)
    assert (scale_advantages(some, "scaled") > 0).all()
    assert scale_advantages(some, "scaled").std() == pytest.approx(1, rel=1e-5)


def fixed_policy(*given):
    """A policy with given log-probabilities and entropies."""
    return SimpleNamespace(evaluate_actions=lambda actions: given)


def loss_of(ratio, advantage, *, capped, cap=3.0):
    """The loss and its derivative by the log-probability."""
    log_ratio = torch.tensor([math.log(ratio)], dtype=torch.float64, requires_grad=True)
    loss = policy_loss(
        log_ratio,
        torch.tensor([advantage], dtype=torch.float64),
        clip=0.2,
        capped=torch.tensor([capped]),
        ratio_cap=cap,
    )
    loss.backward()
    return loss.item(), log_ratio.grad.item()


def test_cap__bounds_the_ratio_of_a_forced_stop_whose_advantage_is_negative():
    """PPO's clipping alone does not: min(r A, clip(r) A) is r A there, however large r is."""
    assert loss_of(1000, -1, capped=False) == pytest.approx((1000, 1000))
    assert loss_of(1000, -1, capped=True) == pytest.approx((3, 0))


@pytest.mark.parametrize("ratio", [0.01, 0.79, 0.9, 1.0, 1.19, 1.5, 2.99])
@pytest.mark.parametrize("advantage", [-2.0, 1.5])
def test_cap__has_no_effect_below_it(ratio, advantage):
    assert loss_of(ratio, advantage, capped=True) == loss_of(ratio, advantage, capped=False)


@pytest.mark.parametrize(
    ("ratio", "advantage", "wanted"), [(0.5, -1.0, 0.8), (0.5, 1.0, -0.5), (2.0, 1.0, -1.2), (2.0, -1.0, 2.0)]
)
def test_policy_loss__clips_ratios_where_that_lowers_the_gain(ratio, advantage, wanted):
    assert loss_of(ratio, advantage, capped=False)[0] == pytest.approx(wanted)


@pytest.mark.parametrize(("every", "wanted"), [(False, [0.0, 50.0]), (True, [0.0, 0.0])])
def test_losses__cap_only_forced_stops_unless_the_recipe_caps_all(every, wanted):
    recipe = PPORecipe(ratio_cap=3.0, cap_every_ratio=every)
    now = torch.full((2,), math.log(100), requires_grad=True)
    zeros = torch.zeros(2)
    old = Transitions(zeros, zeros, zeros, torch.full((2,), -1.0), zeros, torch.tensor([True, False]))
    losses(recipe, fixed_policy(now, zeros), zeros, old, 0.0).total.backward()
    assert now.grad.tolist() == pytest.approx(wanted)


def test_losses__entropy_is_weighted_by_its_coefficient():
    zeros = torch.zeros(2)
    entropies = torch.tensor([1.0, 3.0], requires_grad=True)
    old = Transitions(zeros, zeros, zeros, zeros, zeros, torch.zeros(2, dtype=torch.bool))
    found = losses(PPORecipe(), fixed_policy(zeros, entropies), zeros, old, 0.25)
    found.total.backward()
    assert found.total.item() == pytest.approx(-0.5)
    assert entropies.grad.tolist() == pytest.approx([-0.125, -0.125])


def test_value_loss__is_half_the_squared_error_and_clipping_takes_the_larger():
    values, old, returns = torch.tensor([1.0]), torch.tensor([0.0]), torch.tensor([0.5])
    assert float(value_loss(values, old, returns, None)) == pytest.approx(0.125)
    assert float(value_loss(values, old, returns, 0.2)) == pytest.approx(0.125)
    assert float(value_loss(torch.tensor([0.5]), old, returns, 0.2)) == pytest.approx(0.5 * 0.3**2)
