"""The interface between PPO and its networks."""

from __future__ import annotations

from typing import Any, NamedTuple

from torch import Tensor, nn

from lilgym_mp.learning.common.factored_policy import Factorisation
from lilgym_mp.learning.common.states import States
from lilgym_mp.scene.arrays import AnyMapping


class WeightsError(ValueError):
    """An unusable directory of pretrained weights."""


class Prediction(NamedTuple):
    """Logits of a `FactoredPolicy` and values, for N states."""

    types: Tensor  # (N, 3)
    heads: tuple[Tensor, ...]  # (N, size) logits of each head of the factorisation
    values: Tensor  # (N,) in -1 .. 1


class Model(nn.Module):
    """An actor-critic network; it tokenises statements itself."""

    factorisation: Factorisation
    pretraining: str = ""  # what it was trained on before PPO; empty for nothing
    restriction: str = ""  # actions that it cannot take; empty for none

    def forward(self, states: Any) -> Prediction:
        """`states`: as `inputs` returns them."""
        raise NotImplementedError

    def inputs(self, states: States) -> Any:
        """What the network reads of the states."""
        return states

    def clear_cache(self) -> None:
        """Call it when the weights have changed."""

    def details(self) -> AnyMapping:
        """JSON details from which a model file's network is rebuilt."""
        return {}

    @property
    def trained_parameters(self) -> int:
        """The number of weights that training changes."""
        return sum(parameter.numel() for parameter in self.parameters() if parameter.requires_grad)

    @property
    def frozen_parameters(self) -> int:
        """Parameters of frozen networks, which the model file does not include."""
        return 0


class SeparateCritic(Model):
    """Two networks of the same kind, an actor and a critic."""

    def __init__(self, actor: Model, critic: Model) -> None:
        super().__init__()
        self.factorisation = actor.factorisation
        self.pretraining = actor.pretraining
        self.restriction = actor.restriction
        self.actor = actor
        self.critic = critic
        self.inputs = actor.inputs

    def forward(self, states: Any) -> Prediction:
        return self.actor(states)._replace(values=self.critic(states).values)

    def clear_cache(self) -> None:
        self.actor.clear_cache()
        self.critic.clear_cache()

    def details(self) -> AnyMapping:
        return self.actor.details()

    @property
    def frozen_parameters(self) -> int:
        return self.actor.frozen_parameters
