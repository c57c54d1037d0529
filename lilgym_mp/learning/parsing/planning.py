"""From a scene, a statement and a target to a plan: what the likely programs have in common."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from lilgym_mp.actions import STOP, Action
from lilgym_mp.learning.parsing.calibration import Calibration
from lilgym_mp.learning.parsing.parser import BEAM_WIDTH, Parse, Parser
from lilgym_mp.programs import compile_program
from lilgym_mp.rules import Dynamics, Outcome
from lilgym_mp.scene import Scene
from lilgym_mp.solver import Solver, WeightedGoal
from lilgym_mp.task import Task

ALREADY_TRUE = 0.1  # by which the probability of a program that a Scratch start satisfies is multiplied
AS_THEY_ARE = Calibration()
LEAST_PROBABILITY = 0.0002  # that a program must have to be planned for


class Plan(NamedTuple):
    """What is going to be done, and why."""

    scene: Scene  # as it was read
    parse: Parse
    goals: tuple[WeightedGoal, ...]  # programs that were planned for, the most probable first
    actions: tuple[Action, ...]  # edits and STOP
    satisfied: tuple[int, ...]  # which of the goals hold where it stops
    success_probability: float  # stated: of the goals' mass, calibrated, times the share of words known


@dataclass
class Planner:
    """Plans for statements in one configuration."""

    parser: Parser
    dynamics: Dynamics
    is_flipit: bool  # whether a start is known not to be a success
    calibration: Calibration = AS_THEY_ARE
    votes: bool = True  # plan for all candidates; else for the likeliest alone
    beam_width: int = BEAM_WIDTH
    _solver: Solver = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._solver = Solver(self.dynamics)

    def plan(self, scene: Scene, statement: str, target: bool, steps: int = 0) -> Plan:
        """What to do in a scene after so many actions of the episode."""
        parse = self.parser.parse(statement, self.dynamics.appearance.name, self.beam_width)
        goals = self._goals(parse, scene, target, steps)
        edits_left = self.dynamics.horizon - steps - 1
        if not goals or edits_left < 0:
            return Plan(scene, parse, goals, (STOP,), (), 0.0)
        planned = self._solver.plan_for(goals if self.votes else goals[:1], scene, edits_left)
        mass = sum(goals[index].probability for index in planned.satisfied)
        return Plan(
            scene,
            parse,
            goals,
            planned.actions or (STOP,),
            planned.satisfied,
            self.calibration(mass) * parse.known_share,
        )

    def outcome(self, plan: Plan, task: Task) -> Outcome:
        """What comes of a plan for the task."""
        state = self.dynamics.start(task)
        for action in plan.actions:
            transition = self.dynamics.step(state, action)
            state = transition.state
        return transition.outcome

    def _goals(self, parse: Parse, scene: Scene, target: bool, steps: int) -> tuple[WeightedGoal, ...]:
        """The candidates with what the scene says of them: no start of FlipIt is a success, few of Scratch are."""
        weights: list[tuple[str, float]] = []
        for program, probability, _ in parse.candidates:
            if steps == 0 and compile_program(program)(scene) == target:
                probability *= 0.0 if self.is_flipit else ALREADY_TRUE
            if probability > 0:
                weights.append((program, probability))
        total = sum(weight for _, weight in weights)
        ranked = sorted(((weight / total, program) for program, weight in weights), reverse=True)
        return tuple(WeightedGoal(program, target, share) for share, program in ranked if share >= LEAST_PROBABILITY)
