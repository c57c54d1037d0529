"""The PPO update: advantages, losses with the ratio cap M of PPO+SF (Wu et al. 2023, section 6), and optimiser steps.

Start reading at `update`. It knows neither environments nor networks: an `Experience` says how to evaluate its rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor, nn

from lilgym_mp.learning.common.optimisation import check_finite
from lilgym_mp.learning.common.recipes import UpdateRecipe
from lilgym_mp.scene.arrays import BoolArray, Float32Array, Int64Array, Rng

EPSILON = 1e-8  # added to the standard deviation


class Policy(Protocol):
    """Action distributions of N states, such as a `FactoredPolicy`."""

    def evaluate_actions(self, actions: Tensor) -> tuple[Tensor, Tensor]:
        """(N,) log-probabilities of N actions, and (N,) entropies."""
        ...


class Transitions(NamedTuple):
    """M transitions of a rollout."""

    actions: Tensor  # (M,)
    log_probabilities: Tensor  # (M,) under the behaviour policy; of forced STOPs too, as if unforced
    values: Tensor  # (M,)
    advantages: Tensor  # (M,) scaled
    returns: Tensor  # (M,)
    forced: Tensor  # (M,) bool, forced STOPs


class Experience:
    """Transitions of one actor in a rollout, to learn from."""

    def __init__(
        self,
        recipe: UpdateRecipe,
        arrays: dict[str, Float32Array | Int64Array | BoolArray],
        advantages: Float32Array,
        statement_of: Int64Array,
        evaluate: Callable[[Int64Array], tuple[Policy, Tensor]],
        device: torch.device,
    ) -> None:
        """`arrays`: actions, log_probabilities, values and forced, in the shape of `advantages`, as is `statement_of`.

        `evaluate` gives the current policy and values (m,) of rows (m,).
        """
        returns = advantages + arrays["values"]
        if not recipe.forced_baseline:
            advantages = np.where(arrays["forced"], returns, advantages)
        advantages = scale_advantages(advantages, recipe.advantages).astype(np.float32)
        columns = {**arrays, "advantages": advantages, "returns": returns}
        flat = {name: torch.from_numpy(np.ascontiguousarray(columns[name]).reshape(-1)) for name in Transitions._fields}
        self.transitions = Transitions(**{name: column.to(device) for name, column in flat.items()})
        self.statement_of = statement_of.reshape(-1)
        self.evaluate = evaluate


class Losses(NamedTuple):
    """Losses of a mini-batch, each a scalar."""

    total: Tensor
    policy: Tensor
    value: Tensor
    entropy: Tensor  # mean
    clipped: Tensor  # fraction of ratios outside the clip range


def update(
    experience: Experience,
    optimiser: torch.optim.Optimizer,
    recipe: UpdateRecipe,
    entropy_coefficient: float,
    rng: Rng,
) -> list[Losses]:
    """Optimises on the experience; returns the losses of each optimiser step. Raises TrainingRunError."""
    parameters = [parameter for group in optimiser.param_groups for parameter in group["params"]]
    steps: list[Losses] = []
    for _ in range(recipe.epochs):
        grouped = recipe.same_statement > 1
        for rows in mini_batches(experience.statement_of, recipe.batch_size, rng, by_statement=grouped):
            optimiser.zero_grad()
            parts: list[Losses] = []
            size = recipe.microbatch or len(rows)
            for some in (rows[first : first + size] for first in range(0, len(rows), size)):
                policy, values = experience.evaluate(some)
                old = Transitions(*(column[torch.from_numpy(some)] for column in experience.transitions))
                loss = losses(recipe, policy, values, old, entropy_coefficient)
                check_finite(loss.total, policy=loss.policy, value=loss.value)
                (loss.total * (len(some) / len(rows))).backward()
                parts.append(loss._replace(total=loss.total.detach()))
            nn.utils.clip_grad_norm_(parameters, recipe.gradient_norm)
            optimiser.step()
            steps.append(mean_losses(parts))
    return steps


def mini_batches(statement_of: Int64Array, batch_size: int, rng: Rng, *, by_statement: bool) -> Iterator[Int64Array]:
    """All rows in shuffled mini-batches; `by_statement`: each has few distinct statements, for speed."""
    count = len(statement_of)
    order = rng.permutation(count)
    if by_statement:
        ranks = rng.permutation(int(statement_of.max()) + 1)
        order = order[np.argsort(ranks[statement_of[order]], kind="stable")]
    starts = list(range(0, count, batch_size))
    for start in rng.permutation(len(starts)).tolist() if by_statement else range(len(starts)):
        yield order[starts[start] : starts[start] + batch_size]


def losses(
    recipe: UpdateRecipe, policy: Policy, values: Tensor, old: Transitions, entropy_coefficient: float
) -> Losses:
    """The losses of a mini-batch, from the current policy and values and the transitions they were trained on."""
    log_probabilities, entropies = policy.evaluate_actions(old.actions)
    log_ratios = log_probabilities - old.log_probabilities
    capped = torch.ones_like(old.forced) if recipe.cap_every_ratio else old.forced
    policy_part = policy_loss(log_ratios, old.advantages, clip=recipe.clip, capped=capped, ratio_cap=recipe.ratio_cap)
    value_part = value_loss(values, old.values, old.returns, recipe.clip if recipe.clip_value else None)
    entropy = entropies.mean()
    total = policy_part + recipe.value * value_part - entropy_coefficient * entropy
    clipped = ((log_ratios.detach().exp() - 1).abs() > recipe.clip).float().mean()
    return Losses(total, policy_part.detach(), value_part.detach(), entropy.detach(), clipped)


def policy_loss(log_ratios: Tensor, advantages: Tensor, *, clip: float, capped: Tensor, ratio_cap: float) -> Tensor:
    """-mean of min(r A, clip(r) A), with r capped at `ratio_cap` for the `capped` actions (bool).

    Clipping alone does not bound r A for negative A and large r, as for a forced STOP whose advantage became negative
    by centring. The cap does; beyond it the gradient is 0.
    """
    limit = torch.full_like(log_ratios, torch.inf).masked_fill(capped, float(np.log(ratio_cap)))
    ratios = torch.minimum(log_ratios, limit).exp()
    return -torch.minimum(ratios * advantages, ratios.clamp(1 - clip, 1 + clip) * advantages).mean()


def value_loss(values: Tensor, old_values: Tensor, returns: Tensor, clip: float | None) -> Tensor:
    """Half the mean squared error; with `clip`, elementwise the larger of it and that of the clipped values."""
    errors = (values - returns).square()
    if clip is not None:
        clipped = old_values + (values - old_values).clamp(-clip, clip)
        errors = torch.maximum(errors, (clipped - returns).square())
    return 0.5 * errors.mean()


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
    the MDP's reward function. The return is the advantage plus the value.
    """
    advantages = np.zeros_like(rewards)
    next_values = last_values
    next_advantages = np.zeros_like(last_values)
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


def mean_losses(parts: list[Losses]) -> Losses:
    """The mean of each loss."""
    return Losses(*(torch.stack(values).mean() for values in zip(*parts, strict=True)))


def make_optimiser(model: nn.Module, recipe: UpdateRecipe) -> torch.optim.Optimizer:
    """The recipe's optimiser of the parameters that require gradients."""
    trained = [parameter for parameter in model.parameters() if parameter.requires_grad]
    if recipe.optimiser == "adamw":  # the release's, with torch's weight decay
        return torch.optim.AdamW(trained, recipe.learning_rate, (0.9, 0.98), eps=1e-8, weight_decay=0.01, fused=True)
    return torch.optim.Adam(trained, recipe.learning_rate, eps=1e-5, fused=True)


def schedule(optimiser: torch.optim.Optimizer, recipe: UpdateRecipe, done: float) -> float:
    """Sets the learning rate and returns the entropy coefficient at a training progress from 0 to 1."""
    done = min(1.0, done)
    left = 1 - done
    decay = {"constant": 1.0, "linear": left, "cosine": 0.5 * (1 - math.cos(math.pi * left))}[recipe.schedule]
    warm_up = min(1.0, (done or recipe.warmup / 10) / recipe.warmup) if recipe.warmup else 1.0  # above 0 at first
    for group in optimiser.param_groups:
        group["lr"] = recipe.learning_rate * decay * warm_up
    return recipe.entropy + (recipe.final_entropy - recipe.entropy) * done
