"""The agents' policies: a choice, and a message where the protocol has messages."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.arrays import Float64Array, Int64Array


class ChoicePolicy(Protocol):
    """Distributions of N choices, such as a `FactoredPolicy`."""

    def evaluate_actions(self, actions: Tensor) -> tuple[Tensor, Tensor]: ...
    def log_prob(self, actions: Tensor) -> Tensor: ...
    def sample(self, rng: np.random.Generator) -> Int64Array: ...
    def greedy(self) -> Int64Array: ...


class Categorical:
    """N categoricals over K choices."""

    def __init__(self, logits: Tensor) -> None:
        self._log_probs = torch.log_softmax(logits.float(), -1)

    def evaluate_actions(self, actions: Tensor) -> tuple[Tensor, Tensor]:
        """(N,) log-probabilities of N actions, and (N,) entropies."""
        return self.log_prob(actions), -(self._log_probs.exp() * self._log_probs).sum(-1)

    def log_prob(self, actions: Tensor) -> Tensor:
        return self._log_probs.gather(1, actions[:, None]).squeeze(1)

    def sample(self, rng: np.random.Generator) -> Int64Array:
        sums = self._log_probs.detach().double().exp().cumsum(-1).cpu().numpy()
        uniforms: Float64Array = rng.random(len(sums))
        return np.minimum((sums <= (uniforms * sums[:, -1])[:, None]).sum(-1), sums.shape[1] - 1)

    def greedy(self) -> Int64Array:
        return self._log_probs.argmax(-1).cpu().numpy()


class AgentPolicy(NamedTuple):
    """An agent's actions of the game: choice x (messages + 1) + message, as `Game` numbers them."""

    choice: ChoicePolicy
    message: Categorical | None
    sizes: int  # of the action of a choice with silence: messages + 1

    def evaluate_actions(self, actions: Tensor) -> tuple[Tensor, Tensor]:
        """(N,) log-probabilities of N actions, and (N,) entropies."""
        if self.message is None:
            return self.choice.evaluate_actions(actions)
        chosen, chosen_entropies = self.choice.evaluate_actions(actions // self.sizes)
        said, said_entropies = self.message.evaluate_actions(actions % self.sizes)
        return chosen + said, chosen_entropies + said_entropies

    def log_prob(self, actions: Tensor) -> Tensor:
        if self.message is None:
            return self.choice.log_prob(actions)
        return self.choice.log_prob(actions // self.sizes) + self.message.log_prob(actions % self.sizes)

    def act(self, draw: Callable[[ChoicePolicy | Categorical], Int64Array]) -> Int64Array:
        """(N,) actions; `draw` takes the choice and the message from their distributions."""
        chosen = draw(self.choice)
        return chosen if self.message is None else chosen * self.sizes + draw(self.message)
