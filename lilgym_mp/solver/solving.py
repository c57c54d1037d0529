"""One solver for every appearance: what remains of the horizon, and which search to ask."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, Protocol

from lilgym_mp.actions import Action
from lilgym_mp.appearances import Scatter, Tower
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import Scene
from lilgym_mp.solver.joint import judged_by_program, programs_of, truths_wanted
from lilgym_mp.solver.scatter import ScatterSearch
from lilgym_mp.solver.search import Budget
from lilgym_mp.solver.solution import ActionSet, Solution
from lilgym_mp.solver.tower import TowerSearch
from lilgym_mp.solver.weighted import PLAN_BUDGET, PlanSearch, Reachable, WeightedGoal, WeightedPlan, checked_goals
from lilgym_mp.task import Task


class Search(Protocol):
    """A way to solve the tasks of one appearance; `budget` is how many scenes it looks at by default."""

    budget: int

    def solve(self, state: State, most_edits: int, budget: Budget) -> Solution: ...
    def first_actions(self, state: State, most_edits: int, budget: Budget) -> ActionSet: ...
    def by_faces(self, program: str) -> bool: ...
    def reachable(self, programs: tuple[str, ...], scene: Scene) -> Reachable: ...
    def after(self, scene: Scene, edits: Sequence[Action]) -> Scene: ...


KEPT_SETS = 4_096  # of first actions, the last ones asked for

SEARCHES: Mapping[type, Callable[[Any, Dynamics], Search]] = {Tower: TowerSearch, Scatter: ScatterSearch}


class Solver:
    """Shortest solutions of the tasks of one MDP. It keeps nothing between calls but answers to the same question."""

    def __init__(self, dynamics: Dynamics, budget: int | None = None) -> None:
        """`budget`: scenes looked at per call, at most; None is the appearance's own.

        Raises ValueError for a budget below 1 and for an appearance that the expert does not know.
        """
        self.dynamics = dynamics
        appearance = dynamics.appearance
        if type(appearance) not in SEARCHES:
            choices = ", ".join(sorted(kind.__name__.lower() for kind in SEARCHES))
            raise ValueError(f"no expert for appearance {appearance.name!r}; choose from {choices}")
        self._search = SEARCHES[type(appearance)](appearance, dynamics)
        self.budget = self._search.budget if budget is None else budget
        self._sets: dict[Hashable, ActionSet] = {}  # by programs, what they should be, scene and edits left
        if isinstance(self.budget, bool) or not isinstance(self.budget, int) or self.budget < 1:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ValueError(f"budget must be a positive whole number of scenes or None, not {budget!r}")

    def solve(self, task: Task) -> Solution:
        """A shortest way to success from the task's start."""
        return self.solve_from(self.dynamics.start(task))

    def solve_from(self, state: State) -> Solution:
        """A shortest way to success from any state of an episode; `state.steps` counts against the horizon.

        Raises ValueError when the horizon is over.
        """
        return self._search.solve(state, self._most_edits(state), Budget(self.budget))

    def optimal_actions(self, state: State) -> ActionSet:
        """The first actions of shortest solutions. Raises ValueError when the horizon is over."""
        most_edits = self._most_edits(state)
        if not judged_by_program(state.task):
            return self._search.first_actions(state, most_edits, Budget(self.budget))
        key = (programs_of(state.task), truths_wanted(state.task), state.scene, most_edits)
        found = self._sets.get(key)
        if found is None:
            if len(self._sets) >= KEPT_SETS:
                del self._sets[next(iter(self._sets))]
            found = self._sets[key] = self._search.first_actions(state, most_edits, Budget(self.budget))
        return found

    def optimal_sets(self, states: Sequence[State]) -> list[ActionSet]:
        """`optimal_actions` of each state, in their order; those of one program are found together.

        That is quicker, as what a program sees of boxes is found out once and kept while it is among the last ones
        asked about. Raises ValueError when a state's horizon is over.
        """
        found: list[ActionSet | None] = [None] * len(states)
        for index in sorted(range(len(states)), key=lambda index: states[index].task.program):
            found[index] = self.optimal_actions(states[index])
        return [actions for actions in found if actions is not None]

    def plan_for(
        self, goals: Sequence[WeightedGoal], scene: Scene, edits_left: int, budget: int | None = None
    ) -> WeightedPlan:
        """Actions that satisfy as much probability of the goals as was found, and of equal plans the shortest.

        `edits_left`: edits that may be made before STOP, `horizon - 1` at the start. `budget`: scenes, or threes of
        box faces, looked at; None is this solver's own for a single goal, which is then solved as `solve` does, and
        PLAN_BUDGET for several. Goals of the same program and target add up.

        Raises ValueError for no goals, a probability below 0, edits below 0 or a budget below 1, ProgramError for
        what is no program.
        """
        goals = checked_goals(goals)
        if edits_left < 0:
            raise ValueError(f"edits_left must be at least 0, not {edits_left}")
        if budget is None:
            budget = self.budget if len(goals) == 1 else min(self.budget, PLAN_BUDGET)
        elif budget < 1:
            raise ValueError(f"budget must be a positive whole number of scenes or None, not {budget!r}")
        return PlanSearch(self._search, goals, scene, edits_left, Budget(budget)).plan()

    def _most_edits(self, state: State) -> int:
        """How many edits leave an action for STOP."""
        left = self.dynamics.horizon - state.steps
        if left < 1:
            raise ValueError(f"no action is left: {state.steps} of {self.dynamics.horizon} were taken")
        return left - 1
