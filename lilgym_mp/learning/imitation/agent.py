"""The imitation agent: the network as a policy on scenes and on images, its stop rule, and its model file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from lilgym_mp.corpus.tokens import Vocabulary
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.evaluation import Observations, Policy
from lilgym_mp.evaluation.policies import PolicyOutput
from lilgym_mp.evaluation.runs import play_tasks
from lilgym_mp.learning.common.agents import Agent, check_configuration
from lilgym_mp.learning.common.model_file import ModelDescription, precision
from lilgym_mp.learning.common.tasks import TRAINING_SPLIT
from lilgym_mp.learning.common.words import StatementTokenizer
from lilgym_mp.learning.imitation.action_heads import STOP_INDEX, ActionHeads, action_heads
from lilgym_mp.learning.imitation.batches import DistinctBoxes, make_inputs
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.learner import ImitationRecipe
from lilgym_mp.learning.imitation.network import ImitationNetwork, Outputs
from lilgym_mp.perception import PerceptionError, read_scene
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import RELEASED_GRID
from lilgym_mp.scene.arrays import AnyDict, AnyMapping, Float32Array, Int64Array, Rng, UInt8Array

MAX_CACHED_BOXES = 50_000
SIZES = "width", "text_layers", "item_layers"  # settings of the recipe that make the network
BATCH_SIZE = 128  # scenes per forward pass
THRESHOLDS = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)


@dataclass(frozen=True, slots=True)
class StopRule:
    """When to take STOP; tuned on held-out training statements."""

    threshold: float = 0.0  # greedy play stops when STOP's logit exceeds it
    never_first: bool = False  # no STOP as the first action: a FlipIt start is never solved
    always_last: bool = True  # STOP as the last action within the horizon: anything else fails
    sampled: bool = False  # whether sampled actions did better than greedy ones


@dataclass(frozen=True)
class NetworkPolicy:
    """Action probabilities of the network for any number of statements and scenes."""

    network: ImitationNetwork
    table: BoxFeatureTable
    heads: ActionHeads
    tokenizer: StatementTokenizer
    reduced_precision: bool = False

    @property
    def device(self) -> torch.device:
        """The device of the network's weights."""
        return next(self.network.parameters()).device

    @torch.inference_mode()
    def log_probabilities(self, statements: Sequence[str], boxes: Int64Array, targets: Int64Array) -> Float32Array:
        """(B, logits) for B scenes, given as (B, 3) box indices in the table."""
        self.network.eval()
        self.table.update_features()
        log_probabilities = np.empty((len(statements), self.heads.size), np.float32)
        for first in range(0, len(statements), BATCH_SIZE):
            rows = slice(first, first + BATCH_SIZE)
            words = [self.tokenizer.encode(statement) for statement in statements[rows]]
            distinct = DistinctBoxes.of(boxes[rows, None], 1)
            orders = np.zeros(len(words), np.int64)
            inputs = make_inputs(self.table, words, distinct, orders, self.device)
            batch_targets = torch.from_numpy(targets[rows, None]).to(self.device)
            with precision(self.device, reduced=self.reduced_precision):
                outputs = self.network(inputs, batch_targets)
            log_probabilities[rows] = log_policy(outputs, batch_targets)[:, 0].cpu().numpy()
        return log_probabilities


def log_policy(outputs: Outputs, targets: Tensor) -> Tensor:
    """(S, A, logits) log-probabilities of all actions in the first A scenes, in the order of `ActionHeads`."""
    truth = outputs.truth[:, : targets.shape[1]]
    signed = torch.where(targets == 1, truth, -truth)  # P(STOP) is the probability of the target value
    stop = F.logsigmoid(signed)
    edit = F.logsigmoid(-signed)
    types = outputs.types.log_softmax(-1) + edit[..., None]
    return torch.cat(
        [
            stop[..., None],
            types[..., :1] + outputs.adds.log_softmax(-1),
            types[..., 1:] + outputs.removes.log_softmax(-1),
        ],
        -1,
    )


def choose_actions(
    log_probabilities: Float32Array, steps: Int64Array, horizon: int, rule: StopRule, rng: Rng | None
) -> Int64Array:
    """(B,) logit indices from (B, logits): sampled with `rng`, greedy without."""
    stop = log_probabilities[:, STOP_INDEX].astype(np.float64)
    if rng is None:
        stops = stop - np.log(-np.expm1(np.minimum(stop, -1e-12))) > rule.threshold  # the logit of STOP
    else:
        stops = np.log(rng.random(len(stop))) < stop
    if rule.never_first:
        stops &= steps > 0
    if rule.always_last:
        stops |= steps >= horizon - 1
    edits = log_probabilities[:, STOP_INDEX + 1 :]
    best = (edits if rng is None else edits + rng.gumbel(size=edits.shape)).argmax(1)
    return np.where(stops, STOP_INDEX, STOP_INDEX + 1 + best)


def tune_stop_rule(
    policy: NetworkPolicy, settings: EnvConfig, tasks: Sequence[Task], rng: Rng
) -> tuple[StopRule, float]:
    """The stop rule with the highest accuracy on the tasks, and that accuracy; ties go to the first one tried."""
    tried: list[tuple[float, StopRule]] = []
    envs = settings.make_batch(TRAINING_SPLIT, len(tasks))

    def attempt(rule: StopRule) -> float:
        playing = StopRulePolicy(policy, envs.dynamics, rule, sampled=rule.sampled, needs_states=True)
        accuracy = float(np.mean([episode.is_success for episode in play_tasks(playing, envs, tasks, rng)]))
        tried.append((accuracy, rule))
        return accuracy

    never_first = attempt(StopRule(never_first=True)) > attempt(StopRule())
    for threshold in sorted(THRESHOLDS, key=abs)[1:]:
        attempt(StopRule(threshold, never_first))
    attempt(StopRule(never_first=never_first, sampled=True))
    best, rule = max(tried, key=lambda pair: pair[0])
    return rule, best


def architecture(appearance: str, vocabulary: Vocabulary, recipe: ImitationRecipe) -> AnyDict:
    """The arguments of `make_network`, as JSON."""
    sizes = {name: getattr(recipe, name) for name in SIZES}
    return {"appearance": appearance, "vocabulary": list(vocabulary.words), **sizes}


def make_network(built: AnyMapping, dropout: float = 0.0) -> ImitationNetwork:
    """A new network of this architecture."""
    vocabulary = Vocabulary(tuple(built["vocabulary"]))
    sizes = {name: built[name] for name in SIZES}
    return ImitationNetwork(built["appearance"], len(vocabulary), dropout=dropout, **sizes)


@dataclass(frozen=True)
class ImitationAgent(Agent):
    """A network with its vocabulary and stop rules."""

    kind = "imitation"
    version = 1
    chooses_actions: ClassVar[bool] = True  # greedy or sampled, by the stop rule
    description: ModelDescription
    network: ImitationNetwork
    rules: Mapping[str, StopRule]  # by configuration

    @classmethod
    def of(cls, description: ModelDescription) -> ImitationAgent:
        rules = {name: StopRule(**rule) for name, rule in description.details["stop_rules"].items()}
        return cls(description, make_network(description.details["network"]), rules)

    def policy(self, settings: EnvConfig, *, sampled: bool = False) -> Policy:
        """The policy on images; it needs no action mask. Greedy, unless the stop rule samples or `sampled` is set.

        Raises ValueError for a configuration or grid that the network cannot play.
        """
        check_configuration(self.description, settings)
        dynamics = settings.dynamics()
        if dynamics.appearance.grid not in (None, RELEASED_GRID):
            raise ValueError(f"this network plays Scatter on the grid 19 x 5, not {settings.grid}")
        rule = self.rules[settings.configuration]
        tokenizer = StatementTokenizer(Vocabulary(tuple(self.description.details["network"]["vocabulary"])))
        policy = NetworkPolicy(self.network, BoxFeatureTable(), action_heads(dynamics.appearance), tokenizer)
        return StopRulePolicy(policy, dynamics, rule, sampled=sampled or rule.sampled)


class StopRulePolicy(Policy):
    """The network with a stop rule: on images, which `perception` reads into boxes, or in training on the scenes.

    It stops where an image cannot be read.
    """

    needs_masks = False

    def __init__(
        self, policy: NetworkPolicy, dynamics: Dynamics, rule: StopRule, *, sampled: bool, needs_states: bool = False
    ) -> None:
        self._dynamics = dynamics
        self._rule = rule
        self._sampled = sampled
        self.needs_states = needs_states
        self._policy = policy
        self._latest: tuple[Any, ...] = ()  # statements, boxes and targets of the latest call

    def __call__(self, observations: Observations, legal: np.ndarray, rng: Rng) -> np.ndarray:
        if len(self._policy.table) > MAX_CACHED_BOXES:
            self._policy = replace(self._policy, table=BoxFeatureTable())
        policy = self._policy
        dynamics = self._dynamics
        if self.needs_states:
            scenes = [state.scene for state in observations.states]
            unread = list[int]()
        else:
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
