"""`ActorCritic` as Stable-Baselines3's masked policy, and alone, as evaluations call it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from sb3_contrib.common.maskable.distributions import MaskableCategorical
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from stable_baselines3.common.type_aliases import Schedule
from torch import Tensor

from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.evaluation import Observations
from lilgym_mp.learning.network import ActorCritic

Masks = BoolArray | Tensor

ADAM_EPSILON = 1e-5


class MaskedActorCritic(MaskableActorCriticPolicy):
    """Draws legal actions only. `make_network` gives the ActorCritic to train.

    A mask that leaves a single action is one of stop forcing: the probability that counts is then the one that the
    policy would give this action if it were free, so that it learns to choose it. Source: SPEC section 6 (PPO+SF).
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
        whole_training_left = 1.0
        self.optimizer = torch.optim.Adam(
            self.network.parameters(), lr=lr_schedule(whole_training_left), eps=ADAM_EPSILON
        )

    def forward(
        self, obs: dict[str, Tensor], deterministic: bool = False, action_masks: Masks | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Actions (B,), values (B, 1) and log-probabilities (B,)."""
        logits, values = self._predicted(obs)
        drawn = _distribution(logits, action_masks)
        actions = drawn.logits.argmax(1) if deterministic else drawn.sample()
        return actions, values, _free_distribution(logits, action_masks).log_prob(actions)

    def evaluate_actions(
        self, obs: dict[str, Tensor], actions: Tensor, action_masks: Masks | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Values (B, 1), log-probabilities (B,) and entropies (B,)."""
        logits, values = self._predicted(obs)
        free = _free_distribution(logits, action_masks)
        return values, free.log_prob(actions), free.entropy()

    def predict_values(self, obs: dict[str, Tensor]) -> Tensor:
        """(B, 1)."""
        return self._predicted(obs)[1]

    def _predict(
        self, observation: dict[str, Tensor], deterministic: bool = False, action_masks: Masks | None = None
    ) -> Tensor:
        return self.forward(observation, deterministic, action_masks)[0]

    def _predicted(self, obs: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Logits (B, actions) and values (B, 1); Stable-Baselines3 has images (B, 3, height, width)."""
        images = obs["image"].permute(0, 2, 3, 1)
        logits, values = self.network(images, obs["statement"].long(), obs["target"].long().flatten())
        return logits, values.unsqueeze(1)


def _distribution(logits: Tensor, masks: Masks | None) -> MaskableCategorical:
    return MaskableCategorical(logits=logits, masks=masks, validate_args=False)


def _free_distribution(logits: Tensor, masks: Masks | None) -> MaskableCategorical:
    """The distribution over legal actions, and over all where only one was left."""
    if masks is not None:
        legal = torch.as_tensor(masks, dtype=torch.bool, device=logits.device).reshape(logits.shape)
        masks = legal | (legal.sum(1, keepdim=True) == 1)
    return _distribution(logits, masks)


@dataclass(frozen=True)
class Agent:
    """A trained network as a policy for evaluations."""

    network: ActorCritic
    vocabulary: Vocabulary
    length: int  # words of a statement that it reads
    greedy: bool = True  # the likeliest legal action; else drawn as in training

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        words = np.stack([self.vocabulary.encode(text, self.length) for text in observations.statements])
        with torch.inference_mode():
            device = next(self.network.parameters()).device
            seen = (observations.images, words, observations.targets)
            prediction = self.network(*(torch.from_numpy(array).to(device) for array in seen))
        logits = prediction.logits.cpu().numpy()
        if not self.greedy:
            logits = logits + rng.gumbel(size=logits.shape)
        return np.where(legal, logits, -np.inf).argmax(1)
