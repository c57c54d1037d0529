"""Plans that maximise the total probability of the candidate programs they satisfy, and its calibration."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from lilgym_mp.envs.rules import Dynamics, Outcome
from lilgym_mp.learning.common.planning import Plan, Planner
from lilgym_mp.learning.parsing.parser import Parse, Parser, truths
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP, describe
from lilgym_mp.solver import Solver, WeightedGoal, WeightedPlan

ALREADY_TRUE = 0.1  # factor on the probability of a program whose target already holds at a Scratch start
MIN_GAIN = 0.01  # probability for which a plan that is shown to people gets another action
MIN_PROBABILITY = 0.0002  # less probable programs are not planned for
NEWTON_STEPS = 50
CLIP = 1e-3  # probabilities are clipped to [CLIP, 1 - CLIP]
PRIOR = 1.0  # precision of the Gaussian prior on the identity, slope 1 and shift 0


@dataclass(frozen=True)
class Calibration:
    """Logistic recalibration of a probability (Platt 1999)."""

    slope: float = 1.0
    shift: float = 0.0

    def __call__(self, probability: float) -> float:
        return 0.0 if probability <= 0 else _logistic(self.slope * _logit(probability) + self.shift)


IDENTITY = Calibration()


def fit_calibration(forecasts: Iterable[tuple[float, bool]]) -> Calibration:
    """The maximum a posteriori calibration of predicted probabilities, given the outcomes; the identity without any."""
    points = [(_logit(probability), float(success)) for probability, success in forecasts]
    logits, successes = np.array(points).reshape(-1, 2).T
    features = np.stack([logits, np.ones_like(logits)])
    prior = fitted = np.array([1.0, 0.0])  # slope and shift
    for _ in range(NEWTON_STEPS):
        predicted = np.array([_logistic(x) for x in fitted @ features])
        gradient = PRIOR * (fitted - prior) + features @ (predicted - successes)
        curvature = PRIOR * np.eye(2) + features * (predicted * (1 - predicted)) @ features.T
        fitted = fitted - np.linalg.solve(curvature, gradient)
    return Calibration(max(0.0, float(fitted[0])), float(fitted[1]))


def _logit(probability: float) -> float:
    clipped = min(1 - CLIP, max(CLIP, probability))
    return math.log(clipped / (1 - clipped))


def _logistic(x: float) -> float:
    return 1 / (1 + math.exp(-max(-30.0, min(30.0, x))))


@dataclass(frozen=True)
class ProgramPlan(Plan):
    """A plan for the candidate programs of a statement.

    Its probability of success is that of the satisfied goals, calibrated, times the squared share of known words.
    """

    scene: Scene  # the scene in which the plan starts
    parse: Parse
    goals: tuple[WeightedGoal, ...] = ()  # programs planned for, the most probable first
    satisfied: tuple[int, ...] = ()  # indices of the goals that hold in the final scene

    def probabilities(self) -> dict[str, float]:
        """By program planned for: its probability in this scene. All together they have the parse's confidence."""
        return {goal.program: self.parse.confidence * goal.probability for goal in self.goals}

    def notes(self) -> list[str]:
        return self.parse.notes()


@dataclass
class ProgramPlanner(Planner):
    """Plans for statements in one configuration."""

    parser: Parser
    dynamics: Dynamics
    is_flipit: bool  # a FlipIt start never satisfies the target
    calibration: Calibration = IDENTITY
    _solver: Solver = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._solver = Solver(self.dynamics)

    def plan(self, scene: Scene, statement: str, target: bool, steps: int = 0) -> ProgramPlan:
        parse = self.parser.parse(statement, self.dynamics.appearance.name)
        goals = self._goals(parse, scene, target, steps)
        edits_left = self.dynamics.horizon - steps - 1
        if not goals or edits_left < 0:
            return ProgramPlan((STOP,), 0.0, scene, parse, goals)
        return self._plan_of(self._solver.plan_for(goals, scene, edits_left), scene, parse, goals)

    def short_plan(self, scene: Scene, statement: str, target: bool) -> ProgramPlan:
        """A plan as short as the shortest for the most probable program, unless others are worth more actions.

        Each action besides must add MIN_GAIN to the probability of success. The agent itself plays `plan`.
        """
        plan = self.plan(scene, statement, target)
        goals = plan.goals
        if not plan.satisfied:
            return plan
        shortest = self._solver.plan_for(goals[:1], scene, len(plan.actions) - 1)
        added = len(plan.actions) - len(shortest.actions)
        if not shortest.satisfied or added <= 0:
            return plan
        short = self._solver.plan_for(goals, scene, len(shortest.actions) - 1)
        lost = sum(goals[index].probability for index in plan.satisfied) - short.mass
        return self._plan_of(short, scene, plan.parse, goals) if lost < MIN_GAIN * added else plan

    def _plan_of(
        self, planned: WeightedPlan, scene: Scene, parse: Parse, goals: tuple[WeightedGoal, ...]
    ) -> ProgramPlan:
        mass = sum(goals[index].probability for index in planned.satisfied)
        probability = self.calibration(mass) * parse.known_share**2
        return ProgramPlan(planned.actions or (STOP,), probability, scene, parse, goals, planned.satisfied)

    def outcome(self, plan: ProgramPlan, task: Task) -> Outcome:
        """The outcome of executing the plan on the task."""
        state = self.dynamics.start(task)
        for action in plan.actions:
            transition = self.dynamics.step(state, action)
            state = transition.state
        return transition.outcome

    def _goals(self, parse: Parse, scene: Scene, target: bool, steps: int) -> tuple[WeightedGoal, ...]:
        """The candidates reweighted by the start scene: no FlipIt start, and few Scratch starts, satisfy the target."""
        weights: list[tuple[str, float]] = []
        for program, probability in parse.candidates:
            if steps == 0 and compile_program(program)(scene) == target:
                probability *= 0.0 if self.is_flipit else ALREADY_TRUE
            if probability > 0:
                weights.append((program, probability))
        total = sum(weight for _, weight in weights)
        ranked = sorted(((weight / total, program) for program, weight in weights), reverse=True)
        return tuple(WeightedGoal(program, target, share) for share, program in ranked if share >= MIN_PROBABILITY)


def explanation_lines(plan: ProgramPlan, planner: ProgramPlanner, statement: str, target: bool) -> Iterator[str]:
    """The plan in text: candidate programs, their truth, and the actions."""
    parse = plan.parse
    appearance = planner.dynamics.appearance.name
    yield f'task: make "{statement}" {str(target).lower()}'
    yield f"parsed words: {' '.join(parse.words[1:])}"
    yield from (f"note: {note}" for note in parse.notes())
    yield from (f"unsure: {doubt}" for doubt in parse.doubts if parse.is_understood)
    if not parse.candidates or not parse.is_understood:
        yield "nothing was understood" if parse.candidates else "no program was found"
        return
    yield ""
    yield "candidate programs: probability; truth in this scene; true in % of probe scenes; satisfied by the plan"
    probabilities = plan.probabilities()
    satisfied = {plan.goals[index].program for index in plan.satisfied}
    for candidate in parse.candidates:
        if candidate.probability < MIN_PROBABILITY:
            continue
        truth = compile_program(candidate.program)
        probed = truths(candidate.program, appearance)
        share = probed.count(True) / len(probed)
        probability = probabilities.get(candidate.program, 0.0)
        fulfilled = "yes" if candidate.program in satisfied else "no"
        here = str(truth(plan.scene)).lower()
        yield f"  {100 * probability:5.1f} %  {here:5}  {100 * share:3.0f} %  {fulfilled:3}  {candidate.program}"
        if truth(plan.scene) == target:
            yield "           (unlikely: the start scene would already be a success)"
    yield ""
    yield f"plan: {', '.join(map(describe, plan.actions))}"
    yield f"predicted probability of success: {100 * plan.success_probability:.0f} %"
