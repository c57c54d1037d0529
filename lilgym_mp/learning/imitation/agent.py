"""The imitation agent: its model file, and its policy on images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from lilgym_mp.corpus.tokens import Vocabulary
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.evaluation import Observations, Policy, Settings
from lilgym_mp.evaluation.decisions import PolicyOutput
from lilgym_mp.learning.common.agents import Agent, check_configuration
from lilgym_mp.learning.common.model_file import ModelDescription, load_network
from lilgym_mp.learning.common.words import StatementTokenizer
from lilgym_mp.learning.imitation.action_heads import STOP_INDEX, action_heads
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.network import ImitationNetwork
from lilgym_mp.learning.imitation.policy import NetworkPolicy, StopRule, choose_actions
from lilgym_mp.learning.imitation.recipe import ImitationRecipe
from lilgym_mp.perception import PerceptionError, read_scene
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import RELEASED_GRID
from lilgym_mp.scene.arrays import UInt8Array

KIND = "imitation"
VERSION = 1
MAX_CACHED_BOXES = 50_000
SIZES = "width", "text_layers", "item_layers"  # settings of the recipe that make the network


def architecture(appearance: str, vocabulary: Vocabulary, recipe: ImitationRecipe) -> dict[str, Any]:
    """The arguments of `make_network`, as JSON."""
    sizes = {name: getattr(recipe, name) for name in SIZES}
    return {"appearance": appearance, "vocabulary": list(vocabulary.words), **sizes}


def make_network(built: Mapping[str, Any], dropout: float = 0.0) -> ImitationNetwork:
    """A new network of this architecture."""
    vocabulary, sizes = Vocabulary(tuple(built["vocabulary"])), {name: built[name] for name in SIZES}
    return ImitationNetwork(built["appearance"], len(vocabulary), dropout=dropout, **sizes)


@dataclass(frozen=True)
class ImitationAgent(Agent):
    """A network with its vocabulary and stop rules."""

    network: ImitationNetwork
    rules: Mapping[str, StopRule]  # by configuration
    description: ModelDescription
    chooses_actions: ClassVar[bool] = True  # greedy or sampled, by the stop rule

    def policy(self, settings: Settings, *, sampled: bool = False) -> Policy:
        """The policy on images; it needs no action mask. Greedy, unless the stop rule samples or `sampled` is set.

        Raises ValueError for a configuration or grid that the network cannot play.
        """
        check_configuration(self.description, settings)
        dynamics = settings.dynamics()
        if dynamics.appearance.grid not in (None, RELEASED_GRID):
            raise ValueError(f"this network plays Scatter on the grid 19 x 5, not {settings.grid}")
        rule = self.rules[settings.configuration]
        return _ImagePolicy(self, dynamics, rule, sampled=sampled or rule.sampled)


class _ImagePolicy(Policy):
    """The network on images, which `perception` reads into boxes; it stops where one cannot be read."""

    needs_masks = False

    def __init__(self, agent: ImitationAgent, dynamics: Dynamics, rule: StopRule, *, sampled: bool) -> None:
        self._agent, self._dynamics, self._rule, self._sampled = agent, dynamics, rule, sampled
        self._policy = self._new_policy()
        self._latest: tuple[Any, ...] = ()  # statements, boxes and targets of the latest call

    def _new_policy(self) -> NetworkPolicy:
        words = self._agent.description.details["network"]["vocabulary"]
        tokenizer = StatementTokenizer(Vocabulary(tuple(words)))
        return NetworkPolicy(self._agent.network, BoxFeatureTable(), action_heads(self._dynamics.appearance), tokenizer)

    def __call__(self, observations: Observations, legal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        if len(self._policy.table) > MAX_CACHED_BOXES:
            self._policy = self._new_policy()
        policy, dynamics = self._policy, self._dynamics
        scenes, unread = _scenes(observations.images, dynamics.appearance.name)
        self._latest = observations.statements, policy.table.indices(scenes), observations.targets
        log_probabilities = policy.log_probabilities(*self._latest)
        generator = rng if self._sampled else None
        chosen = choose_actions(log_probabilities, observations.steps, dynamics.horizon, self._rule, generator)
        chosen[unread] = STOP_INDEX
        self.stop_probabilities = np.exp(log_probabilities[:, STOP_INDEX])
        return policy.heads.action_of[chosen]

    def output(self, legal: np.ndarray, chosen: np.ndarray) -> PolicyOutput:
        """The network's probabilities in the latest call, before the stop rule."""
        log_probabilities = self._policy.log_probabilities(*self._latest)
        probabilities = np.zeros((len(log_probabilities), self._dynamics.appearance.action_count), np.float32)
        probabilities[:, self._policy.heads.action_of] = np.exp(log_probabilities)
        return PolicyOutput(probabilities)


def _scenes(images: UInt8Array, appearance: str) -> tuple[list[Scene], list[int]]:
    """The scene in each image, empty where it cannot be read, and the indices of these images."""
    scenes: list[Scene] = []
    unread: list[int] = []
    for index, image in enumerate(images):
        try:
            scenes.append(read_scene(image, appearance))
        except PerceptionError:
            scenes.append(Scene.empty())
            unread.append(index)
    return scenes, unread


def load_agent(path: Path, device: str = "auto") -> ImitationAgent:
    """The agent in the file. Raises ModelFileError naming the file and what is wrong, DeviceError without CUDA."""
    description, network = load_network(KIND, VERSION, path, device, lambda made: make_network(made.details["network"]))
    rules = {name: StopRule(**rule) for name, rule in description.details["stop_rules"].items()}
    return ImitationAgent(network, rules, description)
