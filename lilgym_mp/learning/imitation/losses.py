"""What is minimised: -log of the probability of the whole set of optimal first actions, with auxiliaries."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from lilgym_mp.learning.imitation.batches import Batch
from lilgym_mp.learning.imitation.network import Outputs

LEAST_SHARE = 1e-13  # of a probability; what is less likely is not learnt from


class Losses(NamedTuple):
    """Means over the batch."""

    truth: Tensor  # of the statement's truth, hence of STOP
    actions: Tensor  # -log P(set | not STOP)
    steps: Tensor
    legal: Tensor


def log_policy(outputs: Outputs, targets: Tensor) -> Tensor:
    """(S, A, heads) log-probabilities of all actions of the first A scenes: STOP, then the ADDs, then the REMOVEs."""
    stop, edit = stop_log_probabilities(outputs.truth[:, : targets.shape[1]], targets)
    types = outputs.types.log_softmax(-1) + edit[..., None]
    return torch.cat(
        [
            stop[..., None],
            types[..., :1] + outputs.adds.log_softmax(-1),
            types[..., 1:] + outputs.removes.log_softmax(-1),
        ],
        -1,
    )


def stop_log_probabilities(truth: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
    """log P(STOP) and log P(not STOP): STOP is as likely as the statement has the target's value."""
    signed = torch.where(targets == 1, truth, -truth)
    return F.logsigmoid(signed), F.logsigmoid(-signed)


def set_log_probabilities(outputs: Outputs, optimal: Tensor) -> Tensor:
    """(S, A) log P(set | not STOP) of sets of edits, as `optimal` (S, A, heads) marks them."""
    adds = outputs.adds.shape[-1]
    types = outputs.types.log_softmax(-1)
    added = _marked_share(outputs.adds, optimal[..., 1 : 1 + adds])
    removed = _marked_share(outputs.removes, optimal[..., 1 + adds :])
    return torch.logaddexp(types[..., 0] + added, types[..., 1] + removed)


def _marked_share(logits: Tensor, marked: Tensor) -> Tensor:
    """The logarithm of how much of the softmax is marked, LEAST_SHARE at least."""
    return (logits.softmax(-1) * marked).sum(-1).clamp(min=LEAST_SHARE).log()


def losses(outputs: Outputs, batch: Batch) -> Losses:
    truth = F.binary_cross_entropy_with_logits(outputs.truth, batch.truths)
    actions = -set_log_probabilities(outputs, batch.optimal).mean()
    steps = F.cross_entropy(outputs.steps.flatten(0, 1), batch.steps.flatten())
    legal = truth.new_zeros(())
    if outputs.legal is not None:
        wrong = F.binary_cross_entropy_with_logits(outputs.legal, batch.legal.float(), reduction="none")
        legal = wrong.mean((-1, -2))[batch.box_mask].mean()
    return Losses(truth, actions, steps, legal)
