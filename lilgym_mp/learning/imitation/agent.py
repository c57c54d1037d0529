"""The imitation agent: its model file, and its policy on images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lilgym_mp.appearances import RELEASED_GRID, Appearance, make_appearance
from lilgym_mp.arrays import UInt8Array
from lilgym_mp.corpus.tokens import Vocabulary
from lilgym_mp.evaluation import Observations, Policy, Settings
from lilgym_mp.evaluation.decisions import PolicyOutput
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.learning import model_file
from lilgym_mp.learning.agents import check_configuration
from lilgym_mp.learning.devices import select_device
from lilgym_mp.learning.imitation.action_heads import STOP_INDEX, action_heads
from lilgym_mp.learning.imitation.batches import StatementTokenizer
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.network import ImitationNetwork
from lilgym_mp.learning.imitation.policy import NetworkPolicy, StopRule, choose_actions
from lilgym_mp.learning.imitation.recipe import ImitationRecipe
from lilgym_mp.perception import PerceptionError, read_scene
from lilgym_mp.rules import make_dynamics
from lilgym_mp.scene import BOX_COUNT, Scene

KIND = "imitation"
VERSION = 1
MAX_CACHED_BOXES = 50_000


@dataclass(frozen=True)
class Architecture:
    """Everything needed to build the network."""

    appearance: str
    vocabulary: tuple[str, ...]
    width: int
    text_layers: int
    item_layers: int

    @classmethod
    def of(cls, appearance: str, vocabulary: Vocabulary, recipe: ImitationRecipe) -> Architecture:
        return cls(appearance, vocabulary.words, recipe.width, recipe.text_layers, recipe.item_layers)

    def network(self, dropout: float = 0.0) -> ImitationNetwork:
        return ImitationNetwork(
            self.appearance,
            len(Vocabulary(self.vocabulary)),
            width=self.width,
            text_layers=self.text_layers,
            item_layers=self.item_layers,
            dropout=dropout,
        )

    def to_json(self) -> dict[str, Any]:
        sizes = {"width": self.width, "text_layers": self.text_layers, "item_layers": self.item_layers}
        return {"appearance": self.appearance, "vocabulary": list(self.vocabulary), **sizes}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Architecture:
        """Inverse of `to_json`. Raises ValueError, TypeError, KeyError."""
        words = tuple(data["vocabulary"])
        if not all(isinstance(word, str) for word in words):
            raise ValueError("vocabulary must be a list of words")
        Vocabulary(words)
        appearance = data["appearance"]
        if appearance not in ("tower", "scatter"):
            raise ValueError(f"unknown appearance {appearance!r}; choose from scatter, tower")
        sizes = {name: data[name] for name in ("width", "text_layers", "item_layers")}
        model_file.check_sizes({**sizes, "heads": 8})  # the recipe allows multiples of 8 only
        return cls(appearance, words, **sizes)


class ImitationAgent:
    """A network with its vocabulary and stop rules."""

    chooses_actions = True  # greedy or sampled, by the stop rule

    def __init__(
        self,
        network: ImitationNetwork,
        architecture: Architecture,
        rules: Mapping[str, StopRule],
        description: model_file.ModelDescription,
    ) -> None:
        """`rules`: by configuration."""
        self.network = network
        self.architecture = architecture
        self.rules = dict(rules)
        self._description = description

    @property
    def description(self) -> model_file.ModelDescription:
        return self._description

    def policy(self, settings: Settings, *, sampled: bool = False) -> Policy:
        """The policy on images; it needs no action mask. Greedy, unless the stop rule samples or `sampled` is set.

        Raises ValueError for a configuration or grid that the network cannot play.
        """
        check_configuration(self._description, settings)
        appearance = make_appearance(settings.appearance, settings.grid)
        if appearance.grid not in (None, RELEASED_GRID):
            raise ValueError(f"this network plays Scatter on the grid 19 x 5, not {settings.grid}")
        horizon = make_dynamics(appearance, settings.rules, settings.horizon).horizon
        rule = self.rules[settings.configuration]
        return _ImagePolicy(self, appearance, horizon, rule, sampled=sampled or rule.sampled)

    def save(self, path: Path) -> None:
        model_file.save_model(path, self._description, self.network.state_dict())


_PolicyInputs = tuple[Sequence[str], np.ndarray, np.ndarray]  # statements, boxes and targets


class _ImagePolicy:
    """The network on images, which `perception` reads into boxes; it stops where one cannot be read."""

    needs_masks = False

    def __init__(
        self, agent: ImitationAgent, appearance: Appearance, horizon: int, rule: StopRule, *, sampled: bool
    ) -> None:
        self._rule = rule
        self._agent = agent
        self._appearance = appearance
        self._horizon = horizon
        self._sampled = sampled
        self._policy = self._new_policy()
        self.stop_probabilities = np.zeros(0)  # (B,) probabilities of STOP in the latest call
        self._latest: _PolicyInputs = ((), np.zeros((0, BOX_COUNT), np.int64), np.zeros(0, np.int64))

    def _new_policy(self) -> NetworkPolicy:
        agent = self._agent
        tokenizer = StatementTokenizer(Vocabulary(agent.architecture.vocabulary))
        return NetworkPolicy(agent.network, BoxFeatureTable(), action_heads(self._appearance), tokenizer)

    def __call__(self, observations: Observations, legal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        if len(self._policy.table) > MAX_CACHED_BOXES:
            self._policy = self._new_policy()
        policy = self._policy
        scenes, unread = _scenes(observations.images, self._appearance.name)
        boxes = policy.table.indices(scenes)
        self._latest = inputs = observations.statements, boxes, observations.targets
        log_probabilities = policy.log_probabilities(*inputs)
        generator = rng if self._sampled else None
        chosen = choose_actions(log_probabilities, observations.steps, self._horizon, self._rule, generator)
        chosen[unread] = STOP_INDEX
        self.stop_probabilities = np.exp(log_probabilities[:, STOP_INDEX])
        return policy.heads.action_of[chosen]

    def output(self, legal: np.ndarray, chosen: np.ndarray) -> PolicyOutput:
        """The network's probabilities in the latest call, before the stop rule."""
        log_probabilities = self._policy.log_probabilities(*self._latest)
        probabilities = np.zeros((len(log_probabilities), self._appearance.action_count), np.float32)
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


def describe(
    settings: Settings,
    recipe: ImitationRecipe,
    architecture: Architecture,
    rules: Mapping[str, StopRule],
    statistics: Mapping[str, Any],
    *,
    is_taught: bool = False,
) -> model_file.ModelDescription:
    """`statistics`: further details to save, such as the training time."""
    supervision = f"programs of train statements (corpus {settings.corpus}): truth of scenes, optimal actions"
    if is_taught:
        supervision = f"rewards; search that knows the rules of editing, imitated (corpus {settings.corpus})"
    elif recipe.pretraining:
        supervision += "; their programs and those of generated statements (pretraining)"
    stop_rules = {name: rule.to_json() for name, rule in rules.items()}
    details = {"network": architecture.to_json(), "stop_rules": stop_rules, "corpus": settings.corpus, **statistics}
    return model_file.ModelDescription(KIND, VERSION, tuple(rules), supervision, recipe.to_json(), details)


def load_agent(path: Path, device: str = "auto") -> ImitationAgent:
    """The agent in the file. Raises ModelFileError naming the file and what is wrong, DeviceError without CUDA."""
    torch_device = select_device(device)
    description, tensors = model_file.load_model_of_kind(KIND, VERSION, path, torch_device)
    with model_file.described_network(path):
        architecture = Architecture.from_json(description.details["network"])
        stop_rules = description.details["stop_rules"]
        rules = {name: StopRule(**stop_rules[name]) for name in description.configurations}
        if any(CONFIGURATIONS[name][0] != architecture.appearance for name in description.configurations):
            raise ValueError(
                f"a network for {architecture.appearance} cannot play {', '.join(description.configurations)}"
            )
        model_file.check_numbers({name: rule.threshold for name, rule in rules.items()})
        model_file.check_shapes(architecture.network, tensors, path)
        network = architecture.network()
    model_file.load_weights(network, tensors, path)
    return ImitationAgent(network.to(torch_device).eval(), architecture, rules, description)
