"""The network of both agents: a box transformer with the situation in the game and two more heads.

It gives policies: a choice, and a message where the protocol has messages.

Module attributes are the keys of saved parameters, so renaming one breaks model files.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.protocols import ACCEPT, REJECT, Role
from lilgym_mp.learning.common.box_transformer import SMALL_GAIN, BoxTransformer, EncodedStates
from lilgym_mp.learning.common.factored_policy import FactoredPolicy, Uniforms
from lilgym_mp.learning.common.states import States
from lilgym_mp.learning.game.recipe import GameRecipe
from lilgym_mp.learning.game.situations import MESSAGE, PENDING, STOP_PENDING, context_sizes
from lilgym_mp.scene import BOX_COUNT
from lilgym_mp.scene.arrays import BoolArray, Float64Array, Int64Array

IMPOSSIBLE = -1e4  # logit
SURE = 8.0  # logit of accepting an edit, of a verifier that learns from claims alone


class Categorical:
    """N categoricals over K choices."""

    def __init__(self, logits: Tensor) -> None:
        self._log_probs = torch.log_softmax(logits.float(), -1)

    def evaluate_actions(self, actions: Tensor) -> tuple[Tensor, Tensor]:
        """(N,) log-probabilities of N actions, and (N,) entropies."""
        return self.log_prob(actions), -(self._log_probs.exp() * self._log_probs).sum(-1)

    def log_prob(self, actions: Tensor) -> Tensor:
        """(N,) log-probabilities of N actions."""
        return self._log_probs.gather(1, actions[:, None]).squeeze(1)

    def sample(self, rng: Uniforms) -> Int64Array:
        """(N,) choices, one uniform number drawn for each."""
        sums = self._log_probs.detach().double().exp().cumsum(-1).cpu().numpy()
        uniforms: Float64Array = rng.random(len(sums))
        return np.minimum((sums <= (uniforms * sums[:, -1])[:, None]).sum(-1), sums.shape[1] - 1)

    def greedy(self) -> Int64Array:
        """(N,) most probable choices."""
        return self._log_probs.argmax(-1).cpu().numpy()


class AgentPolicy(NamedTuple):
    """An agent's actions of the game: choice x (messages + 1) + message, as `Game` numbers them."""

    choice: FactoredPolicy | Categorical
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
        """(N,) log-probabilities of N actions of the game."""
        if self.message is None:
            return self.choice.log_prob(actions)
        return self.choice.log_prob(actions // self.sizes) + self.message.log_prob(actions % self.sizes)

    def act(self, draw: Callable[[FactoredPolicy | Categorical], Int64Array]) -> Int64Array:
        """(N,) actions; `draw` takes the choice and the message from their distributions."""
        chosen = draw(self.choice)
        return chosen if self.message is None else chosen * self.sizes + draw(self.message)


class GameNetwork(BoxTransformer):
    """Policies and values of both agents."""

    def __init__(
        self, game: Game, vocabulary: Vocabulary, recipe: GameRecipe, *, messages_see_boxes: bool = False, **sizes: int
    ) -> None:
        """`messages_see_boxes`: messages also depend on each box, and start varied; older model files have neither."""
        super().__init__(game.dynamics.appearance, vocabulary, separators=False, **sizes)
        width = self.sizes["width"]
        counts = context_sizes(game)
        self.game = game
        self._judges_only = recipe.judges_only
        self._offsets = np.array([0, *np.cumsum(counts)[:-1].tolist()], np.int64)
        self.context = nn.EmbeddingBag(sum(counts), width, mode="sum")
        nn.init.normal_(self.context.weight, std=0.02)
        self.answers = nn.Linear(width, len(game.choices[Role.VERIFIER]))
        self.messages = nn.ModuleList(nn.Linear(width, size + 1) for size in game.message_sizes)
        for head in (self.answers, *self.messages):
            assert isinstance(head, nn.Linear)
            nn.init.orthogonal_(head.weight, SMALL_GAIN)
            nn.init.zeros_(head.bias)
        if messages_see_boxes:
            self.sizes["messages_see_boxes"] = True
            self._let_messages_see_boxes()
        self._latest: tuple[States, EncodedStates] | None = None

    def _let_messages_see_boxes(self) -> None:
        """Adds heads on boxes. With the small weights of other heads, agents learn to ignore each other's messages
        before these come to mean anything, so messages start varied and are heard from the start."""
        width = self.sizes["width"]
        first = int(self._offsets[MESSAGE])
        sizes = [size + 1 for size in self.game.message_sizes]
        self.box_messages = nn.ModuleList(nn.Linear(BOX_COUNT * width, size) for size in sizes)
        with torch.no_grad():
            self.context.weight[first : first + max(sizes)].normal_()
        for head in (*self.messages, *self.box_messages):
            assert isinstance(head, nn.Linear)
            nn.init.orthogonal_(head.weight)
            nn.init.zeros_(head.bias)

    def clear_cache(self) -> None:
        super().clear_cache()
        self._latest = None

    def encode(self, states: States) -> EncodedStates:
        """As `BoxTransformer.encode`; without gradients, the latest states are encoded once for both agents."""
        if torch.is_grad_enabled():
            return super().encode(states)
        if self._latest is None or self._latest[0] is not states:
            self._latest = states, super().encode(states)
        return self._latest[1]

    def policy(
        self, role: Role, encoded: EncodedStates, context: Int64Array, legal: BoolArray | None
    ) -> tuple[AgentPolicy, Tensor]:
        """The policy and values (N,) of one agent. `context` as in `situations`; `legal` (N, actions of the MDP)."""
        condition = self._condition(encoded, context)
        conditioned = self.judge(encoded.scenes + condition)
        sizes = self.game.message_sizes[role] + 1
        message = Categorical(self._messages(role, encoded, conditioned)) if sizes > 1 else None
        if role is Role.PROPOSER:
            prediction = self.decide(encoded, condition)
            types = prediction.types
            if not self.game.protocol.proposer_may_stop:
                types = torch.cat([torch.full_like(types[:, :1], IMPOSSIBLE), types[:, 1:]], 1)
            mask = None if legal is None else torch.from_numpy(legal).to(types.device)
            choice = FactoredPolicy(self.factorisation, types, prediction.heads, mask)
            return AgentPolicy(choice, message, sizes), prediction.values
        answers = Categorical(self._answers(encoded, conditioned, context))
        return AgentPolicy(answers, message, sizes), torch.tanh(self.value(conditioned).float()).squeeze(1)

    def values(self, encoded: EncodedStates, context: Int64Array) -> Tensor:
        """(N,) values alone, of a critic."""
        conditioned = self.judge(encoded.scenes + self._condition(encoded, context))
        return torch.tanh(self.value(conditioned).float()).squeeze(1)

    def _condition(self, encoded: EncodedStates, context: Int64Array) -> Tensor:
        """(N, d) of the target and the context."""
        indices = torch.from_numpy(context + self._offsets).to(self.answers.weight.device)
        return self.target(encoded.targets) + self.context(indices)

    def _messages(self, role: Role, encoded: EncodedStates, conditioned: Tensor) -> Tensor:
        """(N, messages + 1) logits."""
        logits = self.messages[role](conditioned)
        if "messages_see_boxes" not in self.sizes:
            return logits
        return logits + self.box_messages[role](self.box_features(encoded, conditioned).flatten(1))

    def _answers(self, encoded: EncodedStates, conditioned: Tensor, context: Int64Array) -> Tensor:
        """(N, answers) logits: learned, plus what the claim's truth says about each answer."""
        reached = self.reached(encoded)
        claims = (context[:, PENDING] == STOP_PENDING) | (not self.game.turn_based)
        is_claim = torch.from_numpy(claims).to(reached.device)
        signs = reached.new_zeros(self.answers.out_features)
        signs[REJECT] = -1
        signs[ACCEPT] = 1
        by_truth = 0.5 * reached[:, None] * signs
        if self._judges_only:
            return torch.where(is_claim[:, None], by_truth, SURE * signs)
        return self.answers(conditioned) + by_truth * is_claim[:, None]
