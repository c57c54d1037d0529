"""The agent: a reward model that plans by search, and its model file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import torch

from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.corpus.tokens import Vocabulary
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.proposer_verifier import GameSettings, Partner, PartnerTurn, Role
from lilgym_mp.envs.proposer_verifier.protocols import ACCEPT, REJECT, STOP_ACTION
from lilgym_mp.envs.rules import State
from lilgym_mp.evaluation import CONFIGURATIONS, Policy
from lilgym_mp.learning.common.agents import Agent, check_configuration
from lilgym_mp.learning.common.model_file import ModelDescription
from lilgym_mp.learning.common.planning import PlanPolicy
from lilgym_mp.learning.reward_model.features import BoxTable, InputReader
from lilgym_mp.learning.reward_model.learner import RewardModelRecipe
from lilgym_mp.learning.reward_model.network import ModulatedNetwork
from lilgym_mp.learning.reward_model.search import Judge, SearchPlanner, mean_probabilities
from lilgym_mp.scene import Scene
from lilgym_mp.scene.arrays import Float64Array


def make_network(recipe: RewardModelRecipe, vocabulary: Vocabulary, appearance: str) -> ModulatedNetwork:
    """A new network of the recipe's sizes."""
    sizes = {name: getattr(recipe, name) for name in ("width", "counts", "tokens", "dropout")}
    table = BoxTable(appearance)
    return ModulatedNetwork(len(vocabulary), table.item_width, table.box_width, **sizes)


@dataclass(frozen=True)
class RewardModelAgent(Agent):
    """One model for both starts of an appearance."""

    kind = "reward-model"
    version = 1
    teaches: ClassVar[bool] = True
    description: ModelDescription
    recipe: RewardModelRecipe
    network: ModulatedNetwork
    vocabulary: Vocabulary
    appearance: str

    @classmethod
    def of(cls, description: ModelDescription) -> RewardModelAgent:
        recipe = RewardModelRecipe.from_json(description.recipe)
        vocabulary = Vocabulary(tuple(description.details["vocabulary"]))
        appearance, _ = CONFIGURATIONS[description.configurations[0]]
        return cls(description, recipe, make_network(recipe, vocabulary, appearance), vocabulary, appearance)

    def policy(self, settings: EnvConfig, *, sampled: bool = False) -> Policy:
        """Planning is deterministic, so `sampled` has no effect. Raises AgentError for another configuration."""
        return PlanPolicy(self.planner(settings))

    def planner(self, settings: EnvConfig) -> SearchPlanner:
        """Raises AgentError for a configuration it does not play."""
        check_configuration(self.description, settings)
        is_flipit = settings.start == FLIPIT
        return SearchPlanner(self.network, self._reader(), settings.dynamics(), self.recipe, is_flipit=is_flipit)

    def partner(self, role: Role | str, game: GameSettings | None = None, *, sampled: bool = False) -> Partner | None:
        """A verifier judges claims by their probability; a proposer follows the policy's plans."""
        if Role.of(role) is Role.VERIFIER:
            return self.answer
        return super().partner(role, game, sampled=sampled)

    @torch.inference_mode()
    def probabilities(self, statement: str, scenes: Sequence[Scene]) -> Float64Array:
        """(N,) that the statement is true in each scene, averaged as in the search."""
        judge = Judge(self.network, self._reader(), statement, self.recipe.averaged_exchanges, target=True)
        return mean_probabilities(judge.scene_logits(scenes))

    def success_probability(self, state: State) -> float:
        """Estimates that the statement has its target value in the state's scene; reads no program."""
        truth = float(self.probabilities(state.task.statement, [state.scene])[0])
        return truth if state.task.target else 1 - truth

    def answer(self, turn: PartnerTurn) -> int:
        """As a verifier: accepts every edit, and a claim whose probability is above 1/2."""
        is_edit = turn.state.proposal not in (None, STOP_ACTION)
        accepts = is_edit or self.success_probability(turn.state.mdp) > 0.5
        return turn.game.encode_action(Role.VERIFIER, ACCEPT if accepts else REJECT)

    def _reader(self) -> InputReader:
        return InputReader(self.vocabulary, BoxTable(self.appearance), torch.device("cpu"))


def load_agent(path: Path, device: str = "auto") -> RewardModelAgent:
    """The agent in a model file; it plays on the CPU. Raises ModelFileError naming the file and what is wrong."""
    agent = RewardModelAgent.load(path, device)
    agent.network.cpu()
    return agent
