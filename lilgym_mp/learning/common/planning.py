"""Agents that plan: what a plan is, and the policy that follows plans."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.evaluation import Observations, Policy
from lilgym_mp.evaluation.policies import PolicyOutput
from lilgym_mp.perception import read_scene
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP, Action
from lilgym_mp.scene.arrays import BoolArray, Int64Array, Rng, UInt8Array, one_hot
from lilgym_mp.scene.render import draw


@dataclass(frozen=True)
class Plan:
    """Edits, then STOP, and the probability that they succeed."""

    actions: tuple[Action, ...]
    success_probability: float

    def probabilities(self) -> Mapping[str, float]:
        """The probability of each program planned for; none of a plan that knows no programs."""
        return {}

    def notes(self) -> Sequence[str]:
        """Lines about the statement, such as its unknown words."""
        return ()


class Planner(ABC):
    """Plans for statements in one configuration."""

    dynamics: Dynamics

    @abstractmethod
    def plan(self, scene: Scene, statement: str, target: bool, steps: int = 0) -> Plan:
        """A plan from the scene; `steps`: actions taken so far in the episode."""

    def plans(self, scene: Scene, statement: str, target: bool, steps: int = 0, most: int = 1) -> Sequence[Plan]:
        """The best plan, then others that are nearly as good, `most` in all."""
        return [self.plan(scene, statement, target, steps)]


class PlanPolicy(Policy):
    """Plans at the start of an episode, and again whenever an image differs from the one the plan expects."""

    needs_masks = False

    def __init__(self, planner: Planner) -> None:
        self.planner = planner
        self._episode_plans: dict[int, _EpisodePlan] = {}
        self._latest: list[Plan] = []  # (B,) of the latest call

    def __call__(self, observations: Observations, legal: BoolArray, rng: Rng) -> Int64Array:
        dynamics = self.planner.dynamics
        chosen: list[int] = []
        self._latest = []
        for row, (episode, step) in enumerate(
            zip(observations.episodes.tolist(), observations.steps.tolist(), strict=True)
        ):
            image = observations.images[row]
            statement = observations.statements[row]
            episode_plan = self._episode_plans.pop(episode, None) if step else None
            if episode_plan is None or not np.array_equal(draw(episode_plan.scene, "half"), image):
                episode_plan = self._new_plan(image, statement, bool(observations.targets[row]), step)
            action, *rest = episode_plan.actions
            chosen.append(dynamics.appearance.encode(action))
            self._latest.append(episode_plan.plan)
            if rest:
                scene = dynamics.appearance.apply(episode_plan.scene, action, dynamics.rules.placement).scene
                self._episode_plans[episode] = _EpisodePlan(rest, scene, episode_plan.plan)
        return np.array(chosen, np.int64)

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput:
        """Probability 1 for the chosen action; program and success probabilities as of planning time."""
        return PolicyOutput(
            one_hot(chosen, self.planner.dynamics.appearance.action_count).astype(np.float64),
            success_probabilities=[plan.success_probability for plan in self._latest],
            programs=[plan.probabilities() for plan in self._latest],
            notes=[tuple(plan.notes()) for plan in self._latest],
        )

    def _new_plan(self, image: UInt8Array, statement: str, target: bool, step: int) -> _EpisodePlan:
        dynamics = self.planner.dynamics
        try:
            scene = dynamics.appearance.check_scene(read_scene(image, dynamics.appearance.name))
        except ValueError:  # no scene, so no plan
            return _EpisodePlan((STOP,), Scene.empty(), Plan((STOP,), 0.0))
        plan = self.planner.plan(scene, statement, target, step)
        return _EpisodePlan(plan.actions, scene, plan)


@dataclass
class _EpisodePlan:
    """The remainder of an episode's plan."""

    actions: Sequence[Action]
    scene: Scene  # the scene expected in the next image
    plan: Plan  # the whole one
