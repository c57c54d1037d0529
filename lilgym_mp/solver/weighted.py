"""Plans for what one is not sure of: of several readings of a statement, as many as one plan can satisfy."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from lilgym_mp.actions import STOP, Action
from lilgym_mp.programs import compile_program
from lilgym_mp.rules import State
from lilgym_mp.scene import Scene
from lilgym_mp.solver.joint import joint_task
from lilgym_mp.solver.reach import FaceReach, Split, Triple, seen_by, triples_after
from lilgym_mp.solver.search import Budget, BudgetSpentError
from lilgym_mp.solver.solution import Solution

PLAN_BUDGET = 20_000  # scenes, or threes of faces, looked at for a plan
SEARCHES = 24  # the share of what is left of the budget that one search may spend is one in this many
MOST_EXTRA_EDITS = 3  # for one more goal
MOST_REPAIRS = 4  # searches for a way that satisfies one more goal and loses none
MOST_WAYS = 4  # equally short ones that are compared
ROUNDING = 1e-12  # by which sums of the same probabilities in another order may differ


class WeightedGoal(NamedTuple):
    """A program that is to have the value `target`, and how probable it is that this is what is wanted."""

    program: str
    target: bool
    probability: float


@dataclass(frozen=True, slots=True)
class WeightedPlan:
    """Actions that satisfy some of the goals."""

    actions: tuple[Action, ...]  # edits, then STOP; empty where no goal was found to be in reach
    satisfied: tuple[int, ...]  # which of the goals hold where STOP is taken, ascending
    mass: float  # the sum of their probabilities
    scenes: int  # looked at by the search

    @property
    def steps(self) -> int:
        """Actions, STOP included; 0 without a plan."""
        return len(self.actions)


class Reachable(Protocol):
    """What the boxes of a scene can become, in the eyes of some programs."""

    @property
    def reaches(self) -> Sequence[FaceReach]: ...

    def edits_to(self, split: Split, triple: Triple, budget: Budget) -> Sequence[Action] | None:
        """Edits after which the boxes have these faces, as many as the split says; None where none were found.

        Raises BudgetSpentError.
        """
        ...


class Asked(Protocol):
    """What planning asks of the search of an appearance."""

    def by_faces(self, program: str) -> bool:
        """Whether the faces of what boxes can become settle the program's truth."""
        ...

    def reachable(self, programs: tuple[str, ...], scene: Scene) -> Reachable: ...
    def solve(self, state: State, most_edits: int, budget: Budget) -> Solution: ...
    def after(self, scene: Scene, edits: Sequence[Action]) -> Scene:
        """The scene after edits that are all valid."""
        ...


def checked_goals(goals: Sequence[WeightedGoal]) -> Sequence[WeightedGoal]:
    """Raises ValueError for no goals or a probability that is none, ProgramError for what is no program."""
    if not goals:
        raise ValueError("there must be at least one goal to plan for")
    for index, goal in enumerate(goals):
        if not (goal.probability >= 0 and math.isfinite(goal.probability)):
            raise ValueError(f"the probability of goal {index} must be a number of at least 0, not {goal.probability}")
        compile_program(goal.program)
    return goals


class _Goal(NamedTuple):
    """A program and target, with the probability of all goals that name them."""

    program: str
    target: bool
    probability: float

    @property
    def opposite(self) -> tuple[str, bool]:
        return self.program, not self.target

    def holds(self, scene: Scene) -> bool:
        return compile_program(self.program)(scene) == self.target


class _Way(NamedTuple):
    """Edits, and what they satisfy."""

    edits: Sequence[Action]
    satisfied: frozenset[_Goal]
    mass: float

    def has(self, goal: WeightedGoal) -> bool:
        return any(goal[:2] == mine[:2] for mine in self.satisfied)

    def beats(self, other: _Way) -> bool:
        """Whether it satisfies more, or as much in fewer edits."""
        gain = self.mass - other.mass
        return gain > ROUNDING or (gain > -ROUNDING and len(self.edits) < len(other.edits))


class _NoRoomError(Exception):
    """No room was found for any of the nearest goals."""


class PlanSearch:
    """The search for a plan from one scene.

    Goals, the most probable first, are required one after the other, where what is required so far does not satisfy
    them anyway. Most readings of a statement are nearly the same, so few need to be required at all.
    """

    def __init__(
        self, asked: Asked, goals: Sequence[WeightedGoal], scene: Scene, most_edits: int, budget: Budget
    ) -> None:
        masses: dict[tuple[str, bool], list[float]] = {}
        for program, target, probability in goals:
            masses.setdefault((program, target), []).append(probability)
        merged = [_Goal(program, target, math.fsum(masses[program, target])) for program, target in masses]
        self._given = goals
        self._goals = sorted(merged, key=lambda goal: -goal.probability)
        self._asked = asked
        self._scene = scene
        self._most_edits = most_edits
        self._budget = budget

    def plan(self) -> WeightedPlan:
        """The best of what is planned from the most probable goal, and from others that outweigh what came of it."""
        best = self._way(())
        left = [goal for goal in self._goals if goal.probability > 0]
        most = left[0].probability if left else 0.0
        while left and len(best.satisfied) < len(self._goals):
            first, *others = left
            if max(_mass(left) - best.mass, first.probability - most) < -ROUNDING:
                break
            found = self._planned([first, *(goal for goal in self._goals if goal.probability > 0 and goal != first)])
            left = [goal for goal in others if goal not in found.satisfied]
            best = found if found.beats(best) else best
        satisfied = tuple(index for index, goal in enumerate(self._given) if best.has(goal))
        actions = (*best.edits, STOP) if satisfied else ()
        return WeightedPlan(actions, satisfied, best.mass, self._budget.scenes_looked_at)

    def _way(self, edits: Sequence[Action]) -> _Way:
        scene = self._asked.after(self._scene, edits)
        satisfied = frozenset(goal for goal in self._goals if goal.holds(scene))
        return _Way(edits, satisfied, _mass(satisfied))

    def _planned(self, goals: Sequence[_Goal]) -> _Way:
        """A plan that satisfies the first of these goals that can be, and of the others what it can."""
        required: list[_Goal] = []
        best = _NOTHING
        for goal in goals:
            if goal not in best.satisfied and goal.opposite not in [(one.program, one.target) for one in required]:
                wanted, found = self._with(goal, required, best)
                if found.beats(best):
                    required, best = wanted, found
        return best

    def _with(self, goal: _Goal, required: Sequence[_Goal], best: _Way) -> tuple[list[_Goal], _Way]:
        """A better way that satisfies the goal too, and what was required for it; `best` when there is none.

        What it loses of what `best` satisfies is required as well, the most probable first.
        """
        wanted, found = [*required, goal], best
        for _ in range(MOST_REPAIRS):
            way = self._way_to(wanted, len(best.edits))
            if way is None:
                break
            found = way if way.beats(found) else found
            lost = best.satisfied - way.satisfied
            if not lost:
                break
            wanted = [*wanted, max(lost, key=self._goals.index)]
        return wanted, found

    def _way_to(self, wanted: Sequence[_Goal], least_edits: int) -> _Way | None:
        """A shortest way that was found to satisfy all of these goals; `least_edits` are needed at least."""
        budget = Budget(self._share())
        try:
            if all(self._asked.by_faces(goal.program) for goal in wanted):
                return self._by_faces(wanted, least_edits, budget)
        except _NoRoomError:
            pass
        except BudgetSpentError:
            if len(self._goals) > 1:
                return None
        finally:
            self._budget.spend(budget.scenes_looked_at)
        return self._solved(wanted)

    def _share(self) -> int:
        """How much of the budget one search may spend: all for the only goal, else enough for others to follow."""
        return self._budget.scenes_left // (1 if len(self._goals) == 1 else SEARCHES)

    def _by_faces(self, wanted: Sequence[_Goal], least_edits: int, budget: Budget) -> _Way | None:
        """Raises BudgetSpentError, or _NoRoomError where only geometry is in the way of the nearest goals."""
        programs = tuple(dict.fromkeys(goal.program for goal in wanted))
        seen = seen_by(programs)
        goal_truths = sum(1 << programs.index(goal.program) for goal in wanted if goal.target)
        reachable = self._asked.reachable(programs, self._scene)
        missed = False
        most_edits = min(self._most_edits, least_edits + MOST_EXTRA_EDITS) if least_edits else self._most_edits
        for edits in range(least_edits, most_edits + 1):
            found: list[_Way] = []
            for split, triple in triples_after(edits, reachable.reaches, budget):
                if seen.truths(triple) == goal_truths:
                    way = reachable.edits_to(split, triple, budget)
                    missed = missed or way is None
                    found.extend([] if way is None else [self._way(way)])
                    if len(found) + missed == MOST_WAYS:
                        break
            if found:
                return max(found, key=lambda way: way.mass)
            if missed:
                raise _NoRoomError
        return None

    def _solved(self, wanted: Sequence[_Goal]) -> _Way | None:
        """As the expert solves tasks."""
        budget = Budget(self._share())
        task = joint_task([(goal.program, goal.target) for goal in wanted], self._scene)
        solution = self._asked.solve(State(task, self._scene, 0), self._most_edits, budget)
        self._budget.spend(solution.scenes)
        return self._way(solution.actions[:-1]) if solution.solved else None


_NOTHING = _Way((), frozenset(), 0.0)


def _mass(goals: Iterable[_Goal]) -> float:
    return math.fsum(goal.probability for goal in goals)
