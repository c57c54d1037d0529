"""The agent that parses and plans: it reads the scene from pixels, and plans for the set of likely programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lilgym_mp.actions import STOP, Action
from lilgym_mp.arrays import BoolArray, Int64Array, UInt8Array
from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.evaluation import Observations, Policy, Settings
from lilgym_mp.evaluation.decisions import PolicyOutput, one_hot
from lilgym_mp.learning.agents import check_configuration
from lilgym_mp.learning.devices import select_device
from lilgym_mp.learning.model_file import ModelDescription, ModelFileError, load_model_of_kind, load_weights
from lilgym_mp.learning.parsing.calibration import Calibration
from lilgym_mp.learning.parsing.parser import Parser, move
from lilgym_mp.learning.parsing.planning import Plan, Planner
from lilgym_mp.learning.parsing.training import KIND, VERSION
from lilgym_mp.perception import PerceptionError, read_scene
from lilgym_mp.render import draw
from lilgym_mp.scene import Scene

KEPT_EPISODES = 4096  # whose plans are remembered


@dataclass
class _EpisodePlan:
    """What is left of an episode's plan."""

    actions: Sequence[Action]
    scene: Scene  # that the next picture should show
    plan: Plan | None = None  # that it comes from; None where the picture could not be read


class ParseAndPlanPolicy:
    """Plans at the start of an episode, and again where a picture is not the one that the plan expects."""

    needs_masks = False

    def __init__(self, planner: Planner) -> None:
        self.planner = planner
        self._courses: dict[int, _EpisodePlan] = {}
        self._latest: list[Plan | None] = []  # B, of the latest call

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        appearance = self.planner.dynamics.appearance
        chosen: list[int] = []
        self._latest = []
        for row, (episode, step) in enumerate(
            zip(observations.episodes.tolist(), observations.steps.tolist(), strict=True)
        ):
            image, statement = observations.images[row], observations.statements[row]
            course = self._courses.pop(episode, None) if step else None
            if course is None or not np.array_equal(draw(course.scene, "half"), image):
                course = self._planned(image, statement, bool(observations.targets[row]), step)
            chosen.append(appearance.encode(course.actions[0]))
            self._latest.append(course.plan)
            self._advance(episode, course)
        return np.array(chosen, np.int64)

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput:
        """Certain of what it chose; how probable the programs were when the plan was made, and its success."""
        programs = [
            {} if plan is None else {goal.program: goal.probability for goal in plan.goals} for plan in self._latest
        ]
        successes = [0.0 if plan is None else plan.success_probability for plan in self._latest]
        return PolicyOutput(
            one_hot(chosen, self.planner.dynamics.appearance.action_count),
            success_probabilities=successes,
            programs=programs,
        )

    def _planned(self, image: UInt8Array, statement: str, target: bool, step: int) -> _EpisodePlan:
        dynamics = self.planner.dynamics
        try:
            scene = dynamics.appearance.check_scene(read_scene(image, dynamics.appearance.name))
        except (PerceptionError, ValueError):  # a picture that cannot be read leaves nothing to plan with
            return _EpisodePlan((STOP,), Scene.empty())
        plan = self.planner.plan(scene, statement, target, step)
        return _EpisodePlan(plan.actions, scene, plan)

    def _advance(self, episode: int, course: _EpisodePlan) -> None:
        """Remembers what follows the next action of the plan."""
        action, *rest = course.actions
        if not rest:
            return
        if len(self._courses) >= KEPT_EPISODES:
            self._courses.clear()
        dynamics = self.planner.dynamics
        scene = dynamics.appearance.apply(course.scene, action, dynamics.rules.placement).scene
        self._courses[episode] = _EpisodePlan(rest, scene, course.plan)


@dataclass(frozen=True)
class ParseAndPlanAgent:
    """One parser for all configurations of the appearances that it was trained on."""

    description: ModelDescription
    parser: Parser

    def planner(self, settings: Settings, *, votes: bool = True) -> Planner:
        """Raises AgentError for a configuration that it does not play."""
        check_configuration(self.description, settings)
        calibration = Calibration(**self.description.details["calibration"])
        return Planner(self.parser, settings.dynamics(), settings.start == FLIPIT, calibration, votes)

    def policy(self, settings: Settings, *, sampled: bool = False) -> Policy:
        """Planning draws nothing, so `sampled` changes nothing."""
        return ParseAndPlanPolicy(self.planner(settings))


def load_agent(path: Path, device: str = "auto") -> ParseAndPlanAgent:
    """The agent in a model file. Raises ModelFileError naming the file and what is wrong with it."""
    target = select_device(device)
    description, tensors = load_model_of_kind(KIND, VERSION, path, target)
    try:
        parser = move(Parser.from_details(description.details), target)
        Calibration(**description.details["calibration"])
    except (KeyError, TypeError, ValueError) as fault:
        raise ModelFileError(f"{path}: its description cannot be used: {fault!r}") from None
    load_weights(parser.network, tensors, path)
    return ParseAndPlanAgent(description, parser)
