"""The trained network as an agent: its model file, and its policy on images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lilgym_mp.appearances import Scatter, Tower, make_appearance
from lilgym_mp.corpus.tokens import Vocabulary, VocabularyError
from lilgym_mp.evaluation import Observations, Policy, Settings
from lilgym_mp.evaluation.decisions import PolicyOutput
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.learning.agents import check_configuration
from lilgym_mp.learning.devices import select_device
from lilgym_mp.learning.imitation.action_heads import STOP_INDEX, action_heads
from lilgym_mp.learning.imitation.batches import StatementTokenizer
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.cached_policy import Player, StopRule, decide
from lilgym_mp.learning.imitation.network import ImitationNetwork
from lilgym_mp.learning.imitation.recipe import ImitationRecipe
from lilgym_mp.learning.model_file import ModelDescription, ModelFileError, load_model_of_kind, load_weights, save_model
from lilgym_mp.perception import read_scenes
from lilgym_mp.rules import make_dynamics
from lilgym_mp.scene import BOX_COUNT

KIND = "imitation"
VERSION = 1
MOST_BOXES = 50_000  # distinct boxes that a policy remembers


@dataclass(frozen=True)
class Shape:
    """What the network is built from."""

    appearance: str
    vocabulary: tuple[str, ...]
    width: int
    text_layers: int
    item_layers: int

    @classmethod
    def of(cls, appearance: str, vocabulary: Vocabulary, recipe: ImitationRecipe) -> Shape:
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
    def from_json(cls, data: Mapping[str, Any]) -> Shape:
        """What `to_json` gave. Raises ValueError, TypeError, KeyError for anything else."""
        words = tuple(data["vocabulary"])
        if not all(isinstance(word, str) for word in words):
            raise ValueError("vocabulary must be a list of words")
        Vocabulary(words)
        appearance = data["appearance"]
        if appearance not in ("tower", "scatter"):
            raise ValueError(f"unknown appearance {appearance!r}; choose from scatter, tower")
        sizes = [data["width"], data["text_layers"], data["item_layers"]]
        if not all(isinstance(size, int) and 0 <= size <= 4096 for size in sizes) or sizes[0] % 8 or not sizes[0]:
            raise ValueError(f"width, text_layers and item_layers cannot be {sizes}")
        return cls(appearance, words, *sizes)


class ImitationAgent:
    """A network with its words and its rule for when to stop."""

    def __init__(
        self,
        network: ImitationNetwork,
        shape: Shape,
        rules: Mapping[str, StopRule],
        description: ModelDescription,
    ) -> None:
        """`rules`: by the configuration's name."""
        self.network = network
        self.shape = shape
        self.rules = dict(rules)
        self._description = description

    @property
    def description(self) -> ModelDescription:
        return self._description

    def policy(self, settings: Settings, *, sampled: bool = False) -> Policy:
        """The policy on images, which looks at no mask. Greedy unless the rule chosen in training says otherwise.

        Raises ValueError for a configuration or grid that the network cannot play.
        """
        check_configuration(self._description, settings)
        appearance = make_appearance(settings.appearance, settings.grid)
        if isinstance(appearance, Scatter) and appearance != Scatter():
            raise ValueError(f"this network plays Scatter on the grid 19 x 5, not {settings.grid}")
        assert isinstance(appearance, Tower | Scatter)
        horizon = make_dynamics(appearance, settings.rules, settings.horizon).horizon
        rule = self.rules[settings.configuration]
        return _ImagePolicy(self, appearance, horizon, rule, sampled=sampled or rule.sampled)

    def save(self, path: Path) -> None:
        save_model(path, self._description, self.network.state_dict())


_Asked = tuple[Sequence[str], np.ndarray, np.ndarray]  # statements, boxes and targets of a call


class _ImagePolicy:
    """The network on images: each is read into its boxes, each distinct box of which is described once."""

    needs_masks = False

    def __init__(
        self, agent: ImitationAgent, appearance: Tower | Scatter, horizon: int, rule: StopRule, *, sampled: bool
    ) -> None:
        self._rule = rule
        self._agent = agent
        self._appearance = appearance
        self._horizon = horizon
        self._sampled = sampled
        self._player = self._fresh()
        self.stop_probabilities = np.zeros(0)  # (B,) of the latest call
        self._latest: _Asked = ((), np.zeros((0, BOX_COUNT), np.int64), np.zeros(0, np.int64))

    def _fresh(self) -> Player:
        agent = self._agent
        tokenizer = StatementTokenizer(Vocabulary(agent.shape.vocabulary))
        return Player(agent.network, BoxFeatureTable(), action_heads(self._appearance), tokenizer)

    def __call__(self, observations: Observations, legal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        if len(self._player.table) > MOST_BOXES:
            self._player = self._fresh()
        player = self._player
        boxes = player.table.indices(read_scenes(observations.images, self._appearance.name))
        self._latest = asked = observations.statements, boxes, observations.targets
        if self._sampled:
            found = player.log_probabilities(*asked)
            log_stops = found[:, STOP_INDEX]
            chosen = decide(found, observations.steps, self._horizon, self._rule, rng)
        else:
            chosen, log_stops = player.likeliest(*asked, observations.steps, self._horizon, self._rule)
        self.stop_probabilities = np.exp(log_stops)
        return player.heads.action_of[chosen]

    def output(self, legal: np.ndarray, chosen: np.ndarray) -> PolicyOutput:
        """The network's own probabilities in the latest call, before its rule for when to stop."""
        found = self._player.log_probabilities(*self._latest)
        probabilities = np.zeros((len(found), self._appearance.action_count), np.float32)
        probabilities[:, self._player.heads.action_of] = np.exp(found)
        return PolicyOutput(probabilities)


def describe(
    settings: Settings,
    recipe: ImitationRecipe,
    shape: Shape,
    rules: Mapping[str, StopRule],
    found: Mapping[str, Any],
) -> ModelDescription:
    """`found`: what else is worth keeping, such as how long the training took."""
    supervision = f"programs of train statements (corpus {settings.corpus}): truth of scenes, optimal actions"
    if recipe.pretraining:
        supervision += "; programs as texts, of generated statements too (pretraining)"
    if found.get("generated_share"):
        supervision += "; generated statements with programs"
    if found.get("other_statements"):
        supervision += "; other statements with programs"
    kept = {name: rule.to_json() for name, rule in rules.items()}
    details = {"network": shape.to_json(), "stop_rules": kept, "corpus": settings.corpus, **found}
    return ModelDescription(KIND, VERSION, tuple(rules), supervision, recipe.to_json(), details)


def load_agent(path: Path, device: str = "auto") -> ImitationAgent:
    """The agent in the file. Raises ModelFileError naming the file and what is wrong, DeviceError without CUDA."""
    place = select_device(device)
    description, tensors = load_model_of_kind(KIND, VERSION, path, place)
    try:
        shape = Shape.from_json(description.details["network"])
        kept = description.details["stop_rules"]
        rules = {name: StopRule(**kept[name]) for name in description.configurations}
        if any(CONFIGURATIONS[name][0] != shape.appearance for name in description.configurations):
            raise ValueError(f"a network for {shape.appearance} cannot play {', '.join(description.configurations)}")
        network = shape.network()
    except (ValueError, TypeError, KeyError, VocabularyError) as fault:
        raise ModelFileError(f"{path}: its description cannot be used: {fault}") from None
    load_weights(network, tensors, path)
    return ImitationAgent(network.to(place).eval(), shape, rules, description)
