"""The agent: a reward model that plans by search, and its model file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from lilgym_mp.arrays import Float64Array
from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.corpus.tokens import Vocabulary
from lilgym_mp.envs.proposer_verifier import Partner
from lilgym_mp.evaluation import CONFIGURATIONS, Policy, Settings
from lilgym_mp.learning.agents import check_configuration
from lilgym_mp.learning.devices import select_device
from lilgym_mp.learning.model_file import ModelDescription, described_network, load_model_of_kind, load_weights
from lilgym_mp.learning.parsing.agent import ParseAndPlanPolicy
from lilgym_mp.learning.reward_model.features import BoxTable
from lilgym_mp.learning.reward_model.inputs import InputReader
from lilgym_mp.learning.reward_model.network import ModulatedNetwork
from lilgym_mp.learning.reward_model.recipe import RewardModelRecipe
from lilgym_mp.learning.reward_model.search import Judge, Planner
from lilgym_mp.rules import State
from lilgym_mp.scene import BOX_COUNT, Scene

KIND = "reward-model"
VERSION = 1
SUPERVISION = "rewards; knows the rules of editing"


def make_network(recipe: RewardModelRecipe, vocabulary: Vocabulary, table: BoxTable) -> ModulatedNetwork:
    return ModulatedNetwork(
        len(vocabulary),
        table.item_width,
        table.box_width,
        width=recipe.width,
        counts=recipe.counts,
        tokens=recipe.tokens,
        dropout=recipe.dropout,
    )


@dataclass(frozen=True)
class RewardModelAgent:
    """One model for both starts of an appearance."""

    description: ModelDescription
    recipe: RewardModelRecipe
    network: ModulatedNetwork
    vocabulary: Vocabulary

    @property
    def appearance(self) -> str:
        return CONFIGURATIONS[self.description.configurations[0]][0]

    def policy(self, settings: Settings, *, sampled: bool = False) -> Policy:
        """Planning is deterministic, so `sampled` has no effect. Raises AgentError for another configuration."""
        planner: Any = self.planner(settings)  # makes plans with actions, but no programs
        return ParseAndPlanPolicy(planner)

    def planner(self, settings: Settings) -> Planner:
        """Raises AgentError for a configuration it does not play."""
        check_configuration(self.description, settings)
        is_flipit = settings.start == FLIPIT
        return Planner(self.network, self._reader(), settings.dynamics(), self.recipe, is_flipit=is_flipit)

    def verifier(self) -> Partner:
        """The model as the verifier of the two-agent game."""
        from lilgym_mp.learning.reward_model.verifier import RewardModelVerifier

        return RewardModelVerifier(self)

    @torch.inference_mode()
    def probabilities(self, statement: str, scenes: Sequence[Scene]) -> Float64Array:
        """(N,) that the statement is true in each scene, averaged over exchanges of colours as in the search."""
        reader = self._reader()
        judge = Judge(self.network, reader, statement, self.recipe.averaged_exchanges, target=True)
        boxes = np.array([reader.table.of(scene) for scene in scenes])
        _, values = judge.box_values(boxes.ravel())
        return torch.sigmoid(judge.logits(values.unflatten(1, (-1, BOX_COUNT)).sum(2))).mean(0).double().numpy()

    def success_probability(self, state: State) -> float:
        """That the statement has its target value in the state's scene; reads no program."""
        truth = float(self.probabilities(state.task.statement, [state.scene])[0])
        return truth if state.task.target else 1 - truth

    def _reader(self) -> InputReader:
        return InputReader(self.vocabulary, BoxTable(self.appearance), torch.device("cpu"))


def describe(
    settings: Settings,
    recipe: RewardModelRecipe,
    configurations: tuple[str, ...],
    vocabulary: Vocabulary,
    statistics: Mapping[str, Any],
) -> ModelDescription:
    """`statistics`: further details to save, such as the training time."""
    supervision = f"{SUPERVISION} (corpus {settings.corpus})"
    details = {"vocabulary": list(vocabulary.words), "corpus": settings.corpus, **statistics}
    return ModelDescription(KIND, VERSION, configurations, supervision, recipe.to_json(), details)


def load_agent(path: Path, device: str = "auto") -> RewardModelAgent:
    """The agent in a model file; it plays on the CPU. Raises ModelFileError naming the file and what is wrong."""
    select_device(device)
    description, tensors = load_model_of_kind(KIND, VERSION, path)
    with described_network(path):
        recipe = RewardModelRecipe.from_json(description.recipe)
        vocabulary = Vocabulary(tuple(description.details["vocabulary"]))
        table = BoxTable(CONFIGURATIONS[description.configurations[0]][0])
        network = make_network(recipe, vocabulary, table)
    load_weights(network, tensors, path)
    return RewardModelAgent(description, recipe, network.eval(), vocabulary)
