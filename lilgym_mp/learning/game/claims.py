"""Learning the truth of statements from judged claims, by cross-entropy."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from lilgym_mp.envs.proposer_verifier import Role
from lilgym_mp.learning.game.network import GameNetwork
from lilgym_mp.learning.game.recipe import GameRecipe
from lilgym_mp.learning.game.rollout import Claims, Rollout
from lilgym_mp.scene.arrays import AnyDict, Int64Array, Rng

MAX_CLAIMS_PER_STATEMENT = 32  # in one step, at most


class ClaimMemory:
    """The latest claims, up to `claim_memory` of them."""

    def __init__(self, recipe: GameRecipe) -> None:
        self._recipe = recipe
        self._claims: Claims | None = None

    def add(self, claims: Claims) -> None:
        """Adds claims; beyond `claim_memory` of the recipe, the oldest are forgotten."""
        if self._claims is not None:
            claims = Claims.joined([self._claims, claims])
        self._claims = claims.rows(slice(-self._recipe.claim_memory, None))

    def batches(self, rng: Rng) -> Iterator[Claims]:
        """`claim_steps` batches, of few statements each."""
        if self._claims is None or not len(self._claims.holds):
            return
        order = np.argsort(self._claims.statement_of, kind="stable")
        firsts = np.unique(self._claims.statement_of[order], return_index=True)[1]  # of each statement, in the order
        counts = np.diff(np.append(firsts, len(order)))
        for _ in range(self._recipe.claim_steps):
            chosen = rng.choice(len(counts), min(self._recipe.claim_statements, len(counts)), replace=False)
            rows = [
                firsts[index] + rng.permutation(counts[index])[:MAX_CLAIMS_PER_STATEMENT] for index in chosen.tolist()
            ]
            yield self._claims.rows(order[np.concatenate(rows)])

    def to_json(self) -> AnyDict:
        """For a checkpoint: tensors."""
        if self._claims is None:
            return {}
        return {name: torch.from_numpy(part) for name, part in self._claims._asdict().items()}

    def restore(self, data: AnyDict) -> None:
        """Inverse of `to_json`. Raises KeyError, TypeError."""
        if data:
            self.add(Claims(*(data[name].cpu().numpy() for name in Claims._fields)))


def claim_loss(network: GameNetwork, rollout: Rollout, claims: Claims) -> tuple[Tensor, float]:
    """Cross-entropy of the statements' truth in the claims' scenes, true and false ones weighted alike; accuracy.

    The truth does not depend on the target, so the verifier cannot resort to what the target alone predicts.
    """
    boxes_of: Int64Array = rollout.table.item_indices(claims.items)
    encoded = network.encode(rollout.states(rollout.game, Role.VERIFIER, claims.statement_of, boxes_of, claims.targets))
    logits = network.truth(encoded.scenes).squeeze(1).float()
    truths = torch.from_numpy((claims.holds == (claims.targets == 1)).astype(np.float32)).to(logits.device)
    true_share = truths.mean().clamp(0.05, 0.95)
    weights = torch.where(truths > 0.5, 0.5 / true_share, 0.5 / (1 - true_share))
    loss = F.binary_cross_entropy_with_logits(logits, truths, weights)
    return loss, float(((logits.detach() > 0) == (truths > 0.5)).float().mean())
