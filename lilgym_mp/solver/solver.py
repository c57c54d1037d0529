"""The solver: chooses the search for the appearance, and how many edits the rest of the horizon allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any

from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP
from lilgym_mp.scene.appearances import UnsupportedAppearance, part_of
from lilgym_mp.scene.choices import checked_count
from lilgym_mp.solver.class_search import Reachability, program_goal
from lilgym_mp.solver.layered_search import Budget, BudgetExhaustedError
from lilgym_mp.solver.scatter_search import ScatterSearch
from lilgym_mp.solver.solution import ActionSet, Solution, not_found, solved
from lilgym_mp.solver.tower_search import TowerSearch
from lilgym_mp.solver.weighted_goals import (
    PLAN_BUDGET,
    Search,
    WeightedGoal,
    WeightedPlan,
    WeightedPlanner,
)

__all__ = ["SEARCHES", "Solver", "UnsupportedAppearance"]

SEARCHES: dict[str, Callable[[Any, Dynamics], Search]] = {"tower": TowerSearch, "scatter": ScatterSearch}
CACHE_SIZE = 4_096  # action sets


class Solver:
    """Finds shortest solutions of the tasks of one MDP. Results do not depend on earlier calls."""

    def __init__(self, dynamics: Dynamics, budget: int | None = None) -> None:
        """Prepares the search of the appearance.

        Args:
            dynamics: The MDP's rules.
            budget: How many scenes a call may examine; None is the default of the appearance.

        Raises:
            ValueError: For a budget below 1.
            UnsupportedAppearance: For an appearance without a search (a ValueError).
        """
        self.dynamics = dynamics
        appearance = dynamics.appearance
        self._search = part_of(appearance.name, "expert", SEARCHES)(appearance, dynamics)
        given = self._search.budget if budget is None else budget
        self.budget = checked_count("budget", given, of=" of scenes or None")

    def solve(self, task: Task) -> Solution:
        """A shortest solution from the task's start.

        Args:
            task: The task.
        """
        return self.solve_from(self.dynamics.start(task))

    def solve_from(self, state: State) -> Solution:
        """A shortest solution from any state of an episode.

        Args:
            state: The state; its `steps` count against the horizon.

        Raises:
            ValueError: If no action is left.
        """
        return self._search.solve(state, self._max_edits(state), Budget(self.budget))

    def distance(self, state: State) -> int | None:
        """The length of the shortest solution found with the whole horizon left, STOP included; None without one.

        Args:
            state: The state; its `steps` do not count.
        """
        return self.solve_from(state._replace(steps=0)).steps or None

    def solve_distant(self, state: State, min_edits: int) -> Solution:
        """A solution proven shortest, if it is long: much faster than `solve_from` for many scenes of one program.

        Args:
            state: The state; its `steps` count against the horizon.
            min_edits: The fewest edits of solutions to look for.

        Returns:
            NOT_FOUND with a lower bound of the edits if it has fewer, for a program that relates items in Scatter, or
            with an exhausted budget.

        Raises:
            ValueError: If no action is left.
        """
        budget = Budget(self.budget)
        edits = 0
        reachability = self._reachability(state)
        if reachability is None:
            return not_found(0, budget)
        with suppress(BudgetExhaustedError):
            for edits in range(self._max_edits(state) + 1):
                for goal in reachability.goals_at(edits, budget):
                    found = reachability.edits_to(goal, budget) if edits >= min_edits else None
                    return not_found(edits, budget) if found is None else solved((*found, STOP), edits, budget)
        return not_found(edits, budget)

    @lru_cache(CACHE_SIZE)  # noqa: B019 (of the class, so that solvers can be pickled)
    def optimal_actions(self, state: State) -> ActionSet:
        """The first actions of shortest solutions.

        Args:
            state: The state; its `steps` count against the horizon.

        Raises:
            ValueError: If no action is left.
        """
        max_edits = self._max_edits(state)
        budget = Budget(self.budget)
        if state.task.solved_by(state.scene):
            return ActionSet((self.dynamics.appearance.encode(STOP),), complete=True, steps=1)
        reachability = self._reachability(state) if self._search.is_exhaustive else None
        if reachability is not None:
            with suppress(BudgetExhaustedError):
                found = reachability.first_actions(max_edits, budget)
                if found is not None:
                    return found
        return self._search.first_actions_by_trial(state, max_edits, budget)

    def plan_for(self, goals: Sequence[WeightedGoal], scene: Scene, edits_left: int) -> WeightedPlan:
        """The plan found with the highest total probability of satisfied goals, then with the fewest actions.

        A single goal is solved as by `solve`, several with at most PLAN_BUDGET.

        Args:
            goals: Programs with their targets and probabilities; those of equal goals are added.
            scene: The scene to start from.
            edits_left: Edits allowed before STOP; at the start of an episode, `horizon - 1`.

        Raises:
            ValueError: For no goals, a negative probability or negative `edits_left`.
            ProgramError: For an invalid program.
        """
        if edits_left < 0:
            raise ValueError(f"edits_left must be at least 0, not {edits_left}")
        budget = self.budget if len(goals) == 1 else min(self.budget, PLAN_BUDGET)
        return WeightedPlanner(self._search, self.dynamics, goals, scene, edits_left, Budget(budget)).plan()

    def _reachability(self, state: State) -> Reachability | None:
        """The reachable classes if they determine success, else None."""
        goal = program_goal(state.task)
        if goal is None or not all(map(self._search.is_abstractable, goal[0])):
            return None
        return self._search.reachability(*goal, state.scene)

    def _max_edits(self, state: State) -> int:
        """The most edits that leave one action for STOP."""
        left = self.dynamics.horizon - state.steps
        if left < 1:
            raise ValueError(f"no action is left: {state.steps} of {self.dynamics.horizon} were taken")
        return left - 1
