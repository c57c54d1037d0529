"""Advantages, and the loss of PPO with the cap M of stop forcing. Source: Wu et al. 2023, section 6; SPEC section 6."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.arrays import BoolArray, Float32Array
from lilgym_mp.learning.ppo.recipe import PPORecipe

SMALLEST_DEVIATION = 1e-8


def generalised_advantages(
    rewards: Float32Array,
    values: Float32Array,
    ended: BoolArray,
    last_values: Float32Array,
    gamma: float,
    gae_lambda: float,
) -> Float32Array:
    """(T, N) of T steps in N environments; `last_values` (N,) of the states after them.

    Nothing is bootstrapped past an end, however it is flagged: an invalid action and the horizon are part of the
    MDP's reward function (SPEC section 7). The return is the advantage plus the value.
    """
    advantages = np.zeros_like(rewards)
    following, after = last_values, np.zeros_like(last_values)
    for step in range(len(rewards) - 1, -1, -1):
        continues = ~ended[step]
        difference = rewards[step] + gamma * following * continues - values[step]
        after = advantages[step] = difference + gamma * gae_lambda * continues * after
        following = values[step]
    return advantages


def scale_advantages(advantages: Float32Array, manner: str) -> Float32Array:
    """The advantages of a rollout as the recipe's `advantages` says: centred and scaled, or scaled alone."""
    centre = advantages.mean() if manner == "normalised" else 0.0
    return (advantages - centre) / (advantages.std() + SMALLEST_DEVIATION)


def policy_loss(log_ratios: Tensor, advantages: Tensor, *, clip: float, capped: Tensor, ratio_cap: float) -> Tensor:
    """-mean of min(r A, clip(r) A), where r is at most `ratio_cap` for the actions that are `capped` (bool).

    Clipping alone does not bound r A where A is negative and r large, as for a forced STOP whose advantage came to be
    negative by centring: the cap does, and beyond it there is no gradient.
    """
    limit = torch.where(capped, float(np.log(ratio_cap)), torch.inf).to(log_ratios.dtype)
    ratios = torch.minimum(log_ratios, limit).exp()
    return -torch.minimum(ratios * advantages, ratios.clamp(1 - clip, 1 + clip) * advantages).mean()


def value_loss(values: Tensor, old_values: Tensor, returns: Tensor, clip: float | None) -> Tensor:
    """Half the mean squared error; with `clip` that of the value moved no further than that, where it is larger."""
    errors = (values - returns).square()
    if clip is not None:
        near = old_values + (values - old_values).clamp(-clip, clip)
        errors = torch.maximum(errors, (near - returns).square())
    return 0.5 * errors.mean()


class ActionEvaluation(NamedTuple):
    """What the loss is made of, for M states."""

    log_probabilities: Tensor  # (M,) of the actions taken, by the policy as it is now
    entropies: Tensor  # (M,)
    values: Tensor  # (M,)


class RolloutBatch(NamedTuple):
    """What was played in M states."""

    log_probabilities: Tensor  # (M,) by the policy that played; of a forced STOP too, as if it had been free
    values: Tensor  # (M,)
    advantages: Tensor  # (M,) scale_advantages
    returns: Tensor  # (M,)
    forced: Tensor  # (M,) bool: a STOP that the policy was made to take


class Losses(NamedTuple):
    total: Tensor
    policy: Tensor
    value: Tensor
    entropy: Tensor  # mean of the policies' entropy
    clipped: Tensor  # share of the ratios outside of the clip


def losses(recipe: PPORecipe, learnt: ActionEvaluation, experience: RolloutBatch, entropy_coefficient: float) -> Losses:
    """Of a mini-batch."""
    log_ratios = learnt.log_probabilities - experience.log_probabilities
    capped = torch.ones_like(experience.forced) if recipe.cap_every_ratio else experience.forced
    policy = policy_loss(log_ratios, experience.advantages, clip=recipe.clip, capped=capped, ratio_cap=recipe.ratio_cap)
    value = value_loss(learnt.values, experience.values, experience.returns, recipe.clip if recipe.clip_value else None)
    entropy = learnt.entropies.mean()
    total = policy + recipe.value * value - entropy_coefficient * entropy
    clipped = ((log_ratios.detach().exp() - 1).abs() > recipe.clip).float().mean()
    return Losses(total, policy.detach(), value.detach(), entropy.detach(), clipped)
