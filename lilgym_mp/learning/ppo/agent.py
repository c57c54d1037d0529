"""The PPO agent: its model file, and its policy on images."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import torch

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import Observations, Policy
from lilgym_mp.evaluation.policies import PolicyOutput
from lilgym_mp.learning.common.agents import SHARED, Agent, AgentError, check_configuration
from lilgym_mp.learning.common.box_transformer import BoxTransformer
from lilgym_mp.learning.common.factored_policy import MAX_ACTIONS, FactoredPolicy
from lilgym_mp.learning.common.model import Model, SeparateCritic, WeightsError
from lilgym_mp.learning.common.model_file import ModelDescription
from lilgym_mp.learning.common.states import BoxImageTable
from lilgym_mp.learning.ppo.learner import TRANSFORMERS, PPORecipe
from lilgym_mp.learning.ppo.rollout import policy_and_values
from lilgym_mp.scene.appearances import Appearance, make_appearance
from lilgym_mp.scene.arrays import AnyMapping, BoolArray, Int64Array, Rng, Strings

MASKED = "illegal actions masked in training and in play"
UNMASKED = "no mask of legal actions"
MAX_CACHED_BOXES = 50_000


def make_model(
    recipe: PPORecipe,
    appearance: Appearance,
    *,
    statements: Iterable[str] = (),
    weights: Path | None = None,
    details: AnyMapping | None = None,
) -> Model:
    """A new model with the vocabulary of `statements`, or with `details` the one described by a model file.

    Raises WeightsError for an unusable directory of weights, ValueError for an appearance with too many actions.
    """
    if appearance.action_count > MAX_ACTIONS:
        raise ValueError(
            f"{appearance.action_count:,} actions are too many for a flat policy, which takes at most {MAX_ACTIONS:,};"
            " choose a coarser grid"
        )
    make: Callable[[bool, bool], Model]
    if recipe.model in TRANSFORMERS:
        from lilgym_mp.learning.ppo.pretrained import model_maker  # the paper's models

        make = model_maker(recipe.model, appearance, weights, details)
    else:
        if weights is not None:
            raise WeightsError(f"the model {recipe.model!r} has no pretrained weights; leave --weights out")
        words = Vocabulary.from_statements(statements) if details is None else Vocabulary(tuple(details["words"]))
        sizes = {} if details is None else details["sizes"]
        separators = recipe.model == "ours-separators"

        def ours(has_actor: bool, has_critic: bool) -> Model:  # it has both
            return BoxTransformer(appearance, words, separators=separators, **sizes)

        make = ours
    if recipe.critic == "separate":
        return SeparateCritic(make(True, False), make(False, True))
    return make(True, True)


class ModelPolicy(Policy):
    """A model as a policy for evaluations."""

    def __init__(self, model: Model, *, mask: bool, sampled: bool) -> None:
        self.needs_masks = mask
        self._model = model
        self._sampled = sampled
        self._table = BoxImageTable()
        self._latest: tuple[FactoredPolicy, torch.Tensor] | None = None  # and values, of the latest call

    def __call__(self, observations: Observations, legal: BoolArray, rng: Rng) -> Int64Array:
        if len(self._table) > MAX_CACHED_BOXES:
            self._table = BoxImageTable()
        boxes_of = self._table.indices(observations.images)
        states = self._table.states_of(observations.statements, boxes_of, observations.targets)
        with torch.no_grad():
            policy, values = policy_and_values(self._model, states, legal if self.needs_masks else None)
        self.stop_probabilities = policy.stop_probability().float().cpu().numpy()
        self._latest = policy, values
        return policy.sample(rng) if self._sampled else policy.greedy()

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput | None:
        if self._latest is None:
            return None
        policy, values = self._latest
        return PolicyOutput(policy.probabilities().cpu().numpy(), values.float().cpu().numpy())


@dataclass(frozen=True)
class PPOAgent(Agent):
    """A trained model, for its training environment."""

    kind = "ppo"
    version = 2
    description: ModelDescription
    settings: EnvConfig
    network: Model

    @classmethod
    def of(cls, description: ModelDescription) -> PPOAgent:
        recipe = PPORecipe.from_json(description.recipe)
        settings = EnvConfig.from_json(description.details["settings"])
        appearance = make_appearance(settings.appearance, settings.grid)
        return cls(description, settings, make_model(recipe, appearance, details=description.details["model"]))

    def policy(self, settings: EnvConfig, *, sampled: bool = False) -> Policy:
        """Raises AgentError for a configuration or grid it was not trained on."""
        check_configuration(self.description, settings)
        if settings.grid != self.settings.grid:
            raise AgentError(f"this agent was trained on the grid {self.settings.grid}, not {settings.grid}")
        return ModelPolicy(self.network, mask=self.description.details["mask"], sampled=sampled)

    def box_transformers(self) -> Mapping[str, BoxTransformer]:
        actor = self.network.actor if isinstance(self.network, SeparateCritic) else self.network
        return {SHARED: actor} if isinstance(actor, BoxTransformer) else super().box_transformers()


def describe(
    settings: EnvConfig,
    recipe: PPORecipe,
    recipe_name: str,
    configurations: Strings,
    model: Model,
    statistics: AnyMapping,
) -> ModelDescription:
    """`statistics`: further details to save, such as the training time."""
    source = "rewards, and programs to exchange colours" if recipe.recolour else "rewards alone"
    notes = [MASKED if recipe.mask else UNMASKED, model.restriction, model.pretraining]
    supervision = f"{source} (corpus {settings.corpus}); {'; '.join(filter(None, notes))}"
    details = {
        "settings": settings.to_json(),
        "recipe_name": recipe_name,
        "mask": recipe.mask,
        "model": dict(model.details()),
        **statistics,
    }
    return PPOAgent.describe(configurations, supervision, recipe.to_json(), details)
