"""Plans under uncertainty about the goal: maximise the total probability of the goals that one plan satisfies."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.task import ProgramGoal, Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP, Action
from lilgym_mp.solver.layered_search import Budget, BudgetExhaustedError
from lilgym_mp.solver.scatter_search import ScatterSearch
from lilgym_mp.solver.tower_search import TowerSearch

PLAN_BUDGET = 20_000  # scenes or class triples examined for a plan
BUDGET_DIVISOR = 24  # with several goals, one search may spend the remaining budget divided by this
MAX_EXTRA_EDITS = 3  # added to a plan to satisfy one more goal
MAX_REPAIRS = 4  # searches for a plan that satisfies one more goal without losing others
MAX_TIES = 4  # equally short plans that are compared
ROUNDING = 1e-12  # tolerance for sums of the same probabilities in different order

Search = TowerSearch | ScatterSearch


class WeightedGoal(NamedTuple):
    """A program that should have the value `target`, and the probability that this is the true goal."""

    program: str
    target: bool
    probability: float


@dataclass(frozen=True, slots=True)
class WeightedPlan:
    """Actions that satisfy some of the goals."""

    actions: tuple[Action, ...]  # edits, then STOP; empty if no goal was found to be reachable
    satisfied: tuple[int, ...]  # indices of the goals that hold at STOP, ascending
    mass: float  # the sum of their probabilities
    scenes: int  # number of scenes examined by the search


class _Candidate(NamedTuple):
    """A candidate plan: edits and the goals that they satisfy."""

    edits: Sequence[Action]
    satisfied: frozenset[WeightedGoal]
    mass: float

    def beats(self, other: _Candidate) -> bool:
        """Whether its mass is higher, or equal with fewer edits."""
        gain = self.mass - other.mass
        return gain > ROUNDING or (gain > -ROUNDING and len(self.edits) < len(other.edits))


class _NoRefinementError(Exception):
    """No refinement was found for any of the nearest abstract goals."""


@dataclass
class WeightedPlanner:
    """Greedy search for a plan from one scene.

    Goals are required one after the other, the most probable first, unless the plan satisfies them already. Most
    readings of a statement are nearly equivalent, so only a few goals need to be required.
    """

    search: Search
    dynamics: Dynamics
    given: Sequence[WeightedGoal]
    scene: Scene
    max_edits: int
    budget: Budget

    def __post_init__(self) -> None:
        """Raises ValueError for no goals or an invalid probability, ProgramError for an invalid program."""
        if not self.given:
            raise ValueError("there must be at least one goal to plan for")
        masses: dict[tuple[str, bool], list[float]] = {}
        for index, (program, target, probability) in enumerate(self.given):
            if not (probability >= 0 and math.isfinite(probability)):
                raise ValueError(f"the probability of goal {index} must be a number of at least 0, not {probability}")
            compile_program(program)
            masses.setdefault((program, target), []).append(probability)
        merged = [WeightedGoal(*goal, math.fsum(each)) for goal, each in masses.items()]
        self._goals = sorted(merged, key=lambda goal: -goal.probability)

    def plan(self) -> WeightedPlan:
        """The best of several greedy plans: from the most probable goal, then from omitted goals that weigh as much."""
        best = self._candidate(())
        left = [goal for goal in self._goals if goal.probability > 0]
        highest = left[0].probability if left else 0.0
        while left and len(best.satisfied) < len(self._goals):
            first, *others = left
            if max(_mass(left) - best.mass, first.probability - highest) < -ROUNDING:
                break
            found = self._greedy([first, *(goal for goal in self._goals if goal.probability > 0 and goal != first)])
            left = [goal for goal in others if goal not in found.satisfied]
            best = found if found.beats(best) else best
        reached = {goal[:2] for goal in best.satisfied}
        satisfied = tuple(index for index, goal in enumerate(self.given) if goal[:2] in reached)
        actions = (*best.edits, STOP) if satisfied else ()
        return WeightedPlan(actions, satisfied, best.mass, self.budget.spent)

    def _candidate(self, edits: Sequence[Action]) -> _Candidate:
        scene = self.scene
        appearance = self.dynamics.appearance
        for edit in edits:
            scene = appearance.apply(scene, edit, self.dynamics.rules.placement).scene
        satisfied = frozenset(goal for goal in self._goals if compile_program(goal.program)(scene) == goal.target)
        return _Candidate(edits, satisfied, _mass(satisfied))

    def _greedy(self, goals: Sequence[WeightedGoal]) -> _Candidate:
        """A plan that requires each of these goals in turn, where that improves it."""
        required: list[WeightedGoal] = []
        best = _NO_PLAN
        for goal in goals:
            if goal not in best.satisfied and (goal.program, not goal.target) not in [one[:2] for one in required]:
                extended, found = self._with_goal(goal, required, best)
                if found.beats(best):
                    required = extended
                    best = found
        return best

    def _with_goal(
        self, goal: WeightedGoal, required: Sequence[WeightedGoal], best: _Candidate
    ) -> tuple[list[WeightedGoal], _Candidate]:
        """A better plan that satisfies the goal too, and the goals required for it; `best` if there is none.

        Goals of `best` that the plan no longer satisfies are required as well, the most probable first.
        """
        extended = [*required, goal]
        result = best
        for _ in range(MAX_REPAIRS):
            found = self._shortest(extended, len(best.edits))
            if found is None:
                break
            result = found if found.beats(result) else result
            lost = best.satisfied - found.satisfied
            if not lost:
                break
            extended = [*extended, max(lost, key=self._goals.index)]
        return extended, result

    def _shortest(self, required: Sequence[WeightedGoal], least_edits: int) -> _Candidate | None:
        """The shortest plan found that satisfies all these goals; it has at least `least_edits` edits."""
        budget = Budget(self._share())
        try:
            if all(self.search.is_abstractable(goal.program) for goal in required):
                return self._by_class(required, least_edits, budget)
        except _NoRefinementError:
            pass
        except BudgetExhaustedError:
            if len(self._goals) > 1:
                return None
        finally:
            self.budget.spend(budget.spent)
        return self._by_solving(required)

    def _share(self) -> int:
        """The budget of one search: all that is left for a single goal, else a fraction."""
        return self.budget.left // (1 if len(self._goals) == 1 else BUDGET_DIVISOR)

    def _by_class(self, required: Sequence[WeightedGoal], least_edits: int, budget: Budget) -> _Candidate | None:
        """Raises BudgetExhaustedError, and _NoRefinementError where only geometry rules out the nearest goals."""
        programs = tuple(dict.fromkeys(goal.program for goal in required))
        targets = sum(1 << programs.index(goal.program) for goal in required if goal.target)
        reachability = self.search.reachability(programs, targets, self.scene)
        failed = False
        max_edits = min(self.max_edits, least_edits + MAX_EXTRA_EDITS) if least_edits else self.max_edits
        for edit_count in range(least_edits, max_edits + 1):
            found: list[_Candidate] = []
            for goal in reachability.goals_at(edit_count, budget):
                edits = reachability.edits_to(goal, budget)
                failed = failed or edits is None
                found.extend([] if edits is None else [self._candidate(edits)])
                if len(found) + failed == MAX_TIES:
                    break
            if found:
                return max(found, key=lambda candidate: candidate.mass)
            if failed:
                raise _NoRefinementError
        return None

    def _by_solving(self, required: Sequence[WeightedGoal]) -> _Candidate | None:
        """Solves the conjunction of the goals as a task."""
        budget = Budget(self._share())
        targets = tuple((goal.program, goal.target) for goal in required)
        task = Task("", "", *targets[0], self.scene, ProgramGoal(targets))
        solution = self.search.solve(State(task, self.scene, 0), self.max_edits, budget)
        self.budget.spend(solution.scenes)
        return self._candidate(solution.actions[:-1]) if solution.solved else None


_NO_PLAN = _Candidate((), frozenset(), 0.0)


def _mass(goals: Iterable[WeightedGoal]) -> float:
    return math.fsum(goal.probability for goal in goals)
