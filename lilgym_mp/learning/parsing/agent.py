"""The parse-and-plan agent: reads scenes from pixels and plans for the likely programs of the statement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.evaluation import Observations, Policy, Settings
from lilgym_mp.evaluation.decisions import PolicyOutput, one_hot
from lilgym_mp.learning.agents import check_configuration
from lilgym_mp.learning.model_file import (
    ModelDescription,
    check_numbers,
    check_shapes,
    described_network,
    load_model_of_kind,
    load_weights,
)
from lilgym_mp.learning.parsing.calibration import Calibration
from lilgym_mp.learning.parsing.parser import Parser
from lilgym_mp.learning.parsing.planning import Plan, Planner
from lilgym_mp.learning.parsing.training import KIND, VERSION
from lilgym_mp.perception import PerceptionError, read_scene
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP, Action
from lilgym_mp.scene.arrays import BoolArray, Int64Array, UInt8Array
from lilgym_mp.scene.render import draw

MAX_CACHED_EPISODES = 4096


class ParseAndPlanPolicy:
    """Plans at the start of an episode, and again whenever an image differs from the one the plan expects."""

    needs_masks = False

    def __init__(self, planner: Planner) -> None:
        self.planner = planner
        self._episode_plans: dict[int, _EpisodePlan] = {}
        self._latest: list[Plan | None] = []  # (B,) plans of the latest call

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        appearance = self.planner.dynamics.appearance
        chosen: list[int] = []
        self._latest = []
        for row, (episode, step) in enumerate(
            zip(observations.episodes.tolist(), observations.steps.tolist(), strict=True)
        ):
            image, statement = observations.images[row], observations.statements[row]
            episode_plan = self._episode_plans.pop(episode, None) if step else None
            if episode_plan is None or not np.array_equal(draw(episode_plan.scene, "half"), image):
                episode_plan = self._new_plan(image, statement, bool(observations.targets[row]), step)
            chosen.append(appearance.encode(episode_plan.actions[0]))
            self._latest.append(episode_plan.plan)
            self._advance(episode, episode_plan)
        return np.array(chosen, np.int64)

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput:
        """Probability 1 for the chosen action; program and success probabilities as of planning time."""
        programs = [{} if plan is None else plan.probabilities() for plan in self._latest]
        successes = [0.0 if plan is None else plan.success_probability for plan in self._latest]
        return PolicyOutput(
            one_hot(chosen, self.planner.dynamics.appearance.action_count),
            success_probabilities=successes,
            programs=programs,
            notes=[() if plan is None else tuple(plan.parse.notes()) for plan in self._latest],
        )

    def _new_plan(self, image: UInt8Array, statement: str, target: bool, step: int) -> _EpisodePlan:
        dynamics = self.planner.dynamics
        try:
            scene = dynamics.appearance.check_scene(read_scene(image, dynamics.appearance.name))
        except (PerceptionError, ValueError):  # no scene, so no plan
            return _EpisodePlan((STOP,), Scene.empty())
        plan = self.planner.plan(scene, statement, target, step)
        return _EpisodePlan(plan.actions, scene, plan)

    def _advance(self, episode: int, episode_plan: _EpisodePlan) -> None:
        """Stores the plan from its second action on."""
        action, *rest = episode_plan.actions
        if not rest:
            return
        if len(self._episode_plans) >= MAX_CACHED_EPISODES:
            self._episode_plans.clear()
        dynamics = self.planner.dynamics
        scene = dynamics.appearance.apply(episode_plan.scene, action, dynamics.rules.placement).scene
        self._episode_plans[episode] = _EpisodePlan(rest, scene, episode_plan.plan)


@dataclass
class _EpisodePlan:
    """The remainder of an episode's plan."""

    actions: Sequence[Action]
    scene: Scene  # the scene expected in the next image
    plan: Plan | None = None  # None if the image could not be read


@dataclass(frozen=True)
class ParseAndPlanAgent:
    """One parser for all configurations of the appearances it was trained on."""

    description: ModelDescription
    parser: Parser

    def planner(self, settings: Settings, *, votes: bool = True, objective: str | None = None) -> Planner:
        """`votes` and `objective` as in `Planner`; None is the recipe's objective, or accuracy if it names none.

        Raises AgentError for a configuration it does not play.
        """
        check_configuration(self.description, settings)
        calibration = Calibration(**self.description.details["calibration"])
        objective = objective or str(self.description.recipe.get("objective", "accuracy"))
        return Planner(self.parser, settings.dynamics(), settings.start == FLIPIT, calibration, votes, objective)

    def policy(self, settings: Settings, *, sampled: bool = False, objective: str | None = None) -> Policy:
        """Planning is deterministic, so `sampled` has no effect."""
        return ParseAndPlanPolicy(self.planner(settings, objective=objective))


def load_agent(path: Path, device: str = "auto") -> ParseAndPlanAgent:
    """The agent in a model file. Raises ModelFileError naming the file and what is wrong with it."""
    description, tensors, torch_device = load_model_of_kind(KIND, VERSION, path, device)
    details = description.details
    with described_network(path):
        check_shapes(lambda: Parser.from_details(details).network, tensors, path)
        parser = Parser.from_details(details)
        check_numbers({"temperature": parser.temperature, **asdict(Calibration(**details["calibration"]))})
    load_weights(parser.network.to(torch_device), tensors, path)
    return ParseAndPlanAgent(description, parser)
