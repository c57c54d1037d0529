"""`ActorCritic` as a Stable-Baselines3 maskable policy, and as a policy for evaluations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from actor_critic import ActorCritic
from gymnasium import spaces
from sb3_contrib.common.maskable.distributions import MaskableCategorical
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from stable_baselines3.common.type_aliases import Schedule
from torch import Tensor

from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.evaluation import Observations

Masks = BoolArray | Tensor

ADAM_EPSILON = 1e-5


class MaskedActorCritic(MaskableActorCriticPolicy):
    """Samples legal actions only. `make_network` returns the ActorCritic to train.

    A mask with a single legal action means stop forcing: log-probability and entropy are then those of the unmasked
    policy, so that it learns to choose the action itself. Source: docs/spec.md, "Stop forcing".
    """

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Space[Any],
        lr_schedule: Schedule,
        *,
        make_network: Callable[[], ActorCritic],
        **settings: Any,
    ) -> None:
        self._make_network = make_network
        super().__init__(observation_space, action_space, lr_schedule, **settings)

    def _build(self, lr_schedule: Schedule) -> None:
        self.network = self._make_network()
        progress_remaining = 1.0
        self.optimizer = torch.optim.Adam(
            self.network.parameters(), lr=lr_schedule(progress_remaining), eps=ADAM_EPSILON
        )

    def forward(
        self, obs: dict[str, Tensor], deterministic: bool = False, action_masks: Masks | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Actions (B,), values (B, 1) and log-probabilities (B,)."""
        logits, values = self._logits_and_values(obs)
        masked = _distribution(logits, action_masks)
        actions = masked.logits.argmax(1) if deterministic else masked.sample()
        return actions, values, _unforced_distribution(logits, action_masks).log_prob(actions)

    def evaluate_actions(
        self, obs: dict[str, Tensor], actions: Tensor, action_masks: Masks | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Values (B, 1), log-probabilities (B,) and entropies (B,)."""
        logits, values = self._logits_and_values(obs)
        unforced = _unforced_distribution(logits, action_masks)
        return values, unforced.log_prob(actions), unforced.entropy()

    def predict_values(self, obs: dict[str, Tensor]) -> Tensor:
        """(B, 1)."""
        return self._logits_and_values(obs)[1]

    def _predict(
        self, observation: dict[str, Tensor], deterministic: bool = False, action_masks: Masks | None = None
    ) -> Tensor:
        return self.forward(observation, deterministic, action_masks)[0]

    def _logits_and_values(self, obs: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Logits (B, actions) and values (B, 1); Stable-Baselines3 passes images as (B, 3, height, width)."""
        images = obs["image"].permute(0, 2, 3, 1)
        logits, values = self.network(images, obs["statement"].long(), obs["target"].long().flatten())
        return logits, values.unsqueeze(1)


def _distribution(logits: Tensor, masks: Masks | None) -> MaskableCategorical:
    return MaskableCategorical(logits=logits, masks=masks, validate_args=False)


def _unforced_distribution(logits: Tensor, masks: Masks | None) -> MaskableCategorical:
    """The distribution over legal actions, or over all actions where only one is legal (stop forcing)."""
    if masks is not None:
        legal = torch.as_tensor(masks, dtype=torch.bool, device=logits.device).reshape(logits.shape)
        masks = legal | (legal.sum(1, keepdim=True) == 1)
    return _distribution(logits, masks)


@dataclass(frozen=True)
class Agent:
    """A trained network as a policy for evaluations."""

    network: ActorCritic
    vocabulary: Vocabulary
    length: int  # words; longer statements are truncated
    greedy: bool = True  # the most probable legal action; else sampled as in training

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        words = np.stack([self.vocabulary.encode(text, self.length) for text in observations.statements])
        with torch.inference_mode():
            device = next(self.network.parameters()).device
            inputs = (observations.images, words, observations.targets)
            prediction = self.network(*(torch.from_numpy(array).to(device) for array in inputs))
        logits = prediction.logits.cpu().numpy()
        if not self.greedy:
            logits = logits + rng.gumbel(size=logits.shape)
        return np.where(legal, logits, -np.inf).argmax(1)
