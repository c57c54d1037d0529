"""Agents of the two-agent game: their model file, and partners that act in many games at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.proposer_verifier import AGENTS, BatchTurn, GameSettings, Role
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.partners import BatchPartner
from lilgym_mp.evaluation import Policy
from lilgym_mp.learning.common.agents import SHARED, Agent, AgentError
from lilgym_mp.learning.common.model_file import ModelDescription
from lilgym_mp.learning.common.states import BoxImageTable
from lilgym_mp.learning.game.network import AgentPolicy, GameNetwork
from lilgym_mp.learning.game.recipe import GameRecipe
from lilgym_mp.learning.game.rollout import proposer_choices
from lilgym_mp.learning.game.situations import HIDDEN_STATEMENT, REFUSED, read_situations
from lilgym_mp.scene.arrays import Float64Array, Int64Array

MAX_CACHED_BOXES = 50_000


@dataclass(frozen=True)
class GameAgent(Agent):
    """A proposer, a verifier, or both."""

    kind = "game"
    version = 1
    description: ModelDescription
    settings: GameSettings
    recipe: GameRecipe
    networks: Mapping[Role, GameNetwork]  # of the agents that learned

    @classmethod
    def of(cls, description: ModelDescription) -> GameAgent:
        details = description.details
        settings = GameSettings.from_json(description.details["game"])
        recipe = GameRecipe.from_json(description.recipe)
        vocabulary = Vocabulary(tuple(details["words"]))
        names = network_names([Role[name.upper()] for name in details["roles"]], recipe)
        game = Game(settings)
        distinct = dict.fromkeys(names.values())
        networks = {name: GameNetwork(game, vocabulary, recipe, **details["sizes"]) for name in distinct}
        return cls(description, settings, recipe, {role: networks[name] for role, name in names.items()})

    @property
    def network(self) -> nn.ModuleDict:
        """The networks by name."""
        return nn.ModuleDict(dict(self.box_transformers()))

    @property
    def game(self) -> GameSettings:
        return self.settings

    def partner(
        self, role: Role | str, game: GameSettings | None = None, *, sampled: bool = False
    ) -> SeatPartner | None:
        """One of the agents, taking its most probable actions unless `sampled`; None if it did not learn.

        It plays in any `game` with the actions and the protocol of its own. Raises ValueError for an unknown role.
        """
        role = Role.of(role)
        if role not in self.networks:
            return None
        return SeatPartner(self.networks[role], role, mask=self.recipe.mask, sampled=sampled)

    def box_transformers(self) -> Mapping[str, GameNetwork]:
        return {name: self.networks[role] for role, name in network_names([*self.networks], self.recipe).items()}

    def policy(self, settings: EnvConfig, *, sampled: bool = False) -> Policy:
        """Raises AgentError: neither agent plays the single-agent environment."""
        raise AgentError("this is an agent of the two-agent game; evaluate it with `lilgym-mp evaluate`")


load_agent = GameAgent.load


@dataclass(frozen=True)
class OwnUniforms:
    """Random numbers of k games, each from its game's own generator."""

    turn: BatchTurn

    def random(self, size: int, /) -> Float64Array:
        """(k,) numbers from 0 to 1."""
        return self.turn.uniform()


class SeatPartner(BatchPartner):
    """A trained agent as one agent of a game with the same protocol and actions. It sees what it saw when it learned,
    whatever the views of that game.

    An illegal action, which only a proposer trained without a mask can choose, becomes the first legal one.
    """

    def __init__(self, network: GameNetwork, role: Role, *, mask: bool, sampled: bool) -> None:
        self.role = role
        self._network = network
        self._mask = mask
        self._sampled = sampled
        self._table = BoxImageTable()

    def batch(self, turn: BatchTurn) -> Int64Array:
        """(k,) legal actions. Raises AgentError for a game with other actions."""
        uniforms = OwnUniforms(turn)
        actions = self._policy(turn).act(lambda part: part.sample(uniforms) if self._sampled else part.greedy())
        return np.where(turn.are_legal(actions), actions, turn.action_mask.argmax(1))

    def _policy(self, turn: BatchTurn) -> AgentPolicy:
        own = self._network.game
        game = turn.game
        if game.action_counts != own.action_counts or game.protocol is not own.protocol:
            raise AgentError(
                f"this {AGENTS[self.role]} was trained on protocol {own.protocol.name!r} with {own.action_counts}"
                f" actions; the game has protocol {game.protocol.name!r} with {game.action_counts}"
            )
        if game.history_length < own.views[self.role].history:
            raise AgentError(
                f"this {AGENTS[self.role]} was trained with a history of {own.views[self.role].history} turns in its"
                f" views; the game keeps {game.history_length}"
            )
        items, context = read_situations(turn.games, self.role, turn.indices, own)
        tasks = [turn.tasks[index] for index in turn.task_indices.tolist()]
        legal = None
        if self.role is Role.PROPOSER and self._mask:
            legal = proposer_choices(turn.game, turn.action_mask, context[:, REFUSED] - 1)
        if len(self._table) > MAX_CACHED_BOXES:
            self._table = BoxImageTable()
        targets = np.array([task.target for task in tasks], np.int64)
        view = own.views[self.role]
        statements = [HIDDEN_STATEMENT if view.statement == "none" else task.statement for task in tasks]
        states = self._table.states_of(statements, self._table.item_indices(items), targets * view.target)
        with torch.no_grad():
            return self._network.policy(self.role, self._network.encode(states), context, legal)[0]


def network_names(roles: Sequence[Role], recipe: GameRecipe) -> dict[Role, str]:
    """The name of each agent's network."""
    return {role: SHARED if recipe.algorithm == SHARED else role.name.lower() for role in roles}
