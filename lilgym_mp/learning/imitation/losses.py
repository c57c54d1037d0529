"""The loss of imitation: the negative log-probability of the set of optimal first actions, with auxiliary losses."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from lilgym_mp.learning.imitation.batches import Batch
from lilgym_mp.learning.imitation.network import Outputs

MIN_PROBABILITY = 1e-13  # clamp; sets below it have no gradient


class Losses(NamedTuple):
    """Means over the batch."""

    truth: Tensor  # binary cross-entropy of the statement's truth, which determines STOP
    actions: Tensor  # -log P(set | not STOP)
    steps: Tensor  # cross-entropy of the steps to go
    legal: Tensor  # binary cross-entropy of legal edits (Scatter)


def set_log_probabilities(outputs: Outputs, optimal: Tensor) -> Tensor:
    """(S, A) log P(set | not STOP) of the edits in the boolean mask `optimal` (S, A, logits)."""
    add_count = outputs.adds.shape[-1]
    types = outputs.types.log_softmax(-1)
    added = _log_masked_probability(outputs.adds, optimal[..., 1 : 1 + add_count])
    removed = _log_masked_probability(outputs.removes, optimal[..., 1 + add_count :])
    return torch.logaddexp(types[..., 0] + added, types[..., 1] + removed)


def _log_masked_probability(logits: Tensor, mask: Tensor) -> Tensor:
    """The log of the softmax probability inside the mask, clamped to MIN_PROBABILITY."""
    return (logits.softmax(-1) * mask).sum(-1).clamp(min=MIN_PROBABILITY).log()


def losses(outputs: Outputs, batch: Batch) -> Losses:
    truth = F.binary_cross_entropy_with_logits(outputs.truth, batch.truths)
    actions = -set_log_probabilities(outputs, batch.optimal).mean()
    steps = F.cross_entropy(outputs.steps.flatten(0, 1), batch.steps.flatten())
    legal = truth.new_zeros(())
    if outputs.legal is not None:
        each = F.binary_cross_entropy_with_logits(outputs.legal, batch.legal.float(), reduction="none")
        legal = each.mean((-1, -2))[batch.box_mask].mean()
    return Losses(truth, actions, steps, legal)
