"""Generalised advantages, and the PPO loss with the ratio cap M of PPO+SF (Wu et al. 2023, section 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.arrays import BoolArray, Float32Array
from lilgym_mp.learning.ppo.recipe import PPORecipe

EPSILON = 1e-8  # added to the standard deviation


def generalised_advantages(
    rewards: Float32Array,
    values: Float32Array,
    ended: BoolArray,
    last_values: Float32Array,
    gamma: float,
    gae_lambda: float,
) -> Float32Array:
    """(T, N) advantages of T steps in N environments; `last_values` (N,) of the states after them.

    Never bootstraps past the end of an episode, terminated or truncated: an invalid action and the horizon are part of
    the MDP's reward function (SPEC section 7). The return is the advantage plus the value.
    """
    advantages = np.zeros_like(rewards)
    next_values, next_advantages = last_values, np.zeros_like(last_values)
    for step in range(len(rewards) - 1, -1, -1):
        continues = ~ended[step]
        delta = rewards[step] + gamma * next_values * continues - values[step]
        next_advantages = advantages[step] = delta + gamma * gae_lambda * continues * next_advantages
        next_values = values[step]
    return advantages


def scale_advantages(advantages: Float32Array, mode: str) -> Float32Array:
    """A rollout's advantages divided by their standard deviation, and centred if `mode` is "normalised"."""
    centre = advantages.mean() if mode == "normalised" else 0.0
    return (advantages - centre) / (advantages.std() + EPSILON)


def policy_loss(log_ratios: Tensor, advantages: Tensor, *, clip: float, capped: Tensor, ratio_cap: float) -> Tensor:
    """-mean of min(r A, clip(r) A), with r capped at `ratio_cap` for the `capped` actions (bool).

    Clipping alone does not bound r A for negative A and large r, as for a forced STOP whose advantage became negative
    by centring. The cap does; beyond it the gradient is 0.
    """
    limit = torch.where(capped, float(np.log(ratio_cap)), torch.inf).to(log_ratios.dtype)
    ratios = torch.minimum(log_ratios, limit).exp()
    return -torch.minimum(ratios * advantages, ratios.clamp(1 - clip, 1 + clip) * advantages).mean()


def value_loss(values: Tensor, old_values: Tensor, returns: Tensor, clip: float | None) -> Tensor:
    """Half the mean squared error; with `clip`, elementwise the larger of it and that of the clipped values."""
    errors = (values - returns).square()
    if clip is not None:
        clipped = old_values + (values - old_values).clamp(-clip, clip)
        errors = torch.maximum(errors, (clipped - returns).square())
    return 0.5 * errors.mean()


class ActionEvaluation(NamedTuple):
    """The current policy and value evaluated on M transitions."""

    log_probabilities: Tensor  # (M,) log-probabilities of the actions taken
    entropies: Tensor  # (M,)
    values: Tensor  # (M,)


class RolloutBatch(NamedTuple):
    """M transitions of the rollout."""

    log_probabilities: Tensor  # (M,) under the behaviour policy; of forced STOPs too, as if unforced
    values: Tensor  # (M,)
    advantages: Tensor  # (M,) scaled
    returns: Tensor  # (M,)
    forced: Tensor  # (M,) bool, forced STOPs


class Losses(NamedTuple):
    total: Tensor
    policy: Tensor
    value: Tensor
    entropy: Tensor  # mean
    clipped: Tensor  # fraction of ratios outside the clip range


def losses(recipe: PPORecipe, current: ActionEvaluation, batch: RolloutBatch, entropy_coefficient: float) -> Losses:
    """The losses of a mini-batch."""
    log_ratios = current.log_probabilities - batch.log_probabilities
    capped = torch.ones_like(batch.forced) if recipe.cap_every_ratio else batch.forced
    policy = policy_loss(log_ratios, batch.advantages, clip=recipe.clip, capped=capped, ratio_cap=recipe.ratio_cap)
    value = value_loss(current.values, batch.values, batch.returns, recipe.clip if recipe.clip_value else None)
    entropy = current.entropies.mean()
    total = policy + recipe.value * value - entropy_coefficient * entropy
    clipped = ((log_ratios.detach().exp() - 1).abs() > recipe.clip).float().mean()
    return Losses(total, policy.detach(), value.detach(), entropy.detach(), clipped)
