"""One step of an optimiser, the same for all learners but PPO, which accumulates gradients (`update`)."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from lilgym_mp.learning.common.run_directory import TrainingRunError


def optimise(
    optimiser: torch.optim.Optimizer,
    loss: Tensor,
    gradient_norm: float,
    learning_rate: float | None = None,
    **parts: Tensor,
) -> None:
    """Takes a step at a learning rate (None: the one before), with the gradient clipped to a norm.

    `parts` as in `check_finite`. Raises TrainingRunError.
    """
    check_finite(loss, **parts)
    if learning_rate is not None:
        for group in optimiser.param_groups:
            group["lr"] = learning_rate
    optimiser.zero_grad()
    loss.backward()
    parameters = [parameter for group in optimiser.param_groups for parameter in group["params"]]
    nn.utils.clip_grad_norm_(parameters, gradient_norm, foreach=True)
    optimiser.step()


def cosine_decay(done: float, lowest: float = 0.0) -> float:
    """The learning rate relative to its peak at a training progress of 0 to 1, at the end `lowest`."""
    return lowest + (1 - lowest) * 0.5 * (1 + math.cos(math.pi * min(1.0, done)))


def warm_up(done: float, fraction: float) -> float:
    """The learning rate relative to its peak while it rises, in the first fraction of the training."""
    return min(1.0, (done + 1e-3) / fraction) if fraction else 1.0


def check_finite(loss: Tensor, **parts: Tensor) -> None:
    """Raises TrainingRunError if the loss is not finite, with the `parts` that it adds up."""
    if not torch.isfinite(loss):
        listed = ", ".join(f"{name} {value.item():g}" for name, value in parts.items())
        raise TrainingRunError(
            f"the loss is not finite{listed and f' ({listed})'}; try a lower learning-rate: with --resume from the last"
            " checkpoint, or in another directory"
        )
