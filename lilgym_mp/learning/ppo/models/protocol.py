"""What PPO asks of a network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from torch import Tensor, nn

from lilgym_mp.learning.ppo.factored_policy import Factorisation
from lilgym_mp.learning.ppo.states import States


class Prediction(NamedTuple):
    """Logits of a `FactoredPolicy`, and values, of N states."""

    types: Tensor  # (N, 3)
    heads: tuple[Tensor, ...]  # (N, size) of each head of the factorisation
    values: Tensor  # (N,) in -1 .. 1


class Model(nn.Module):
    """A policy with a critic. Statements come as texts: how they are read is the model's own."""

    factorisation: Factorisation
    pretraining: str = ""  # what it learnt from before its training with PPO; empty for nothing

    def forward(self, states: States) -> Prediction:
        raise NotImplementedError

    def clear_cache(self) -> None:
        """To be called when the weights have changed, where the model remembers what it read."""

    def details(self) -> Mapping[str, Any]:
        """What a model file must hold, beside tensors, to build it again, as JSON."""
        return {}

    @property
    def trained_parameters(self) -> int:
        return sum(weight.numel() for weight in self.parameters() if weight.requires_grad)

    @property
    def frozen_parameters(self) -> int:
        """Of networks that stay as they are, which the model file leaves out."""
        return 0


class SeparateCritic(Model):
    """Two networks of one kind: one has_actor, the other has_critic."""

    def __init__(self, actor: Model, critic: Model) -> None:
        super().__init__()
        self.factorisation, self.pretraining = actor.factorisation, actor.pretraining
        self.actor, self.critic = actor, critic

    def forward(self, states: States) -> Prediction:
        return self.actor(states)._replace(values=self.critic(states).values)

    def clear_cache(self) -> None:
        self.actor.clear_cache()
        self.critic.clear_cache()

    def details(self) -> Mapping[str, Any]:
        return self.actor.details()

    @property
    def frozen_parameters(self) -> int:
        return self.actor.frozen_parameters
