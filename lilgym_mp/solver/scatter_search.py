"""Search for Scatter: in abstract boxes for what must change, then under the exact rules for edits that change it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cache, partial

import numpy as np

from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, Scene
from lilgym_mp.scene.actions import STOP
from lilgym_mp.scene.appearances import Scatter
from lilgym_mp.solver.abstraction import AbstractEdit, Abstraction
from lilgym_mp.solver.box_editor import BoxEdit, BoxEditor
from lilgym_mp.solver.class_search import Reachability, class_space, program_goal
from lilgym_mp.solver.first_actions import ScatterBox
from lilgym_mp.solver.layered_search import Budget, BudgetExhaustedError, Layers, LazyList, goals_at
from lilgym_mp.solver.pruned_layers import SuccessorGenerator, heuristic_signature
from lilgym_mp.solver.refinement import NoRefinement, Refinement, Refiner, first_found
from lilgym_mp.solver.solution import ActionSet, Solution, Status, not_found, solved, unsolvable

MAX_GOALS = 40  # abstract goals at one distance that are refined
MAX_EXTRA_EDITS = 2  # distances tried beyond the abstract distance before the pruned search takes over


class ScatterSearch:
    """Solutions that are proven shortest if possible, and otherwise the best found."""

    budget = 300_000  # scenes examined by default

    def __init__(self, scatter: Scatter, dynamics: Dynamics) -> None:
        self._scatter = scatter
        self._placement = dynamics.rules.placement
        self._editors = [BoxEditor(scatter, self._placement, index) for index in range(BOX_COUNT)]
        self.is_exhaustive = all(editor.is_exhaustive for editor in self._editors)

    def solve(self, state: State, max_edits: int, budget: Budget) -> Solution:
        """A shortest solution with at most `max_edits` edits before STOP."""
        if state.task.solved_by(state.scene):
            return solved((STOP,), 0, budget)
        goal = program_goal(state.task)
        if goal is None:
            return not_found(1, budget, "Scatter tasks can be solved only if success depends on their program alone")
        search = _TaskSearch(self._editors, class_space(goal[0]).abstraction, state, max_edits, budget)
        try:
            actions = search.solution()
        except BudgetExhaustedError:
            return not_found(search.least_edits, budget)
        if actions is not None:
            return solved((*actions, STOP), search.least_edits, budget)
        if search.least_edits > max_edits:
            reason = f"no scene within {max_edits} edits has that value"
            return unsolvable(reason, search.least_edits, budget)
        return not_found(search.least_edits, budget)

    def is_abstractable(self, program: str) -> bool:
        """As in `TowerSearch`."""
        return not class_space((program,)).abstraction.features.relational

    def reachability(self, programs: tuple[str, ...], targets: int, scene: Scene) -> Reachability:
        """What can be reached from the scene, with the scenes that give the programs the targets as goals."""
        space = class_space(programs)
        pairs = zip(self._editors, scene.boxes, strict=True)
        return Reachability(space, targets, [ScatterBox(space, editor, box) for editor, box in pairs])

    def first_actions_by_trial(self, state: State, max_edits: int, budget: Budget) -> ActionSet:
        """The first action of a solution; if that has one edit, every other edit that reaches a goal too.

        Marked complete only if that is proven.
        """
        solution = self.solve(state, max_edits, budget)
        found = set(map(self._scatter.encode, solution.actions[:1]))
        complete = solution.status is Status.UNSOLVABLE
        if solution.steps == 2 and self.is_exhaustive:
            complete = solution.proven_optimal
            try:
                for action in np.flatnonzero(self._scatter.legal_mask(state.scene, self._placement))[1:].tolist():
                    budget.spend()
                    after, _ = self._scatter.apply(state.scene, self._scatter.decode(action), self._placement)
                    if state.task.solved_by(after):
                        found.add(action)
            except BudgetExhaustedError:
                complete = False
        return ActionSet(tuple(sorted(found)), complete=complete, steps=solution.steps)


class _TaskSearch:
    """The search from one state. `least_edits` is the lower bound proven so far."""

    def __init__(
        self, editors: Sequence[BoxEditor], abstraction: Abstraction, state: State, max_edits: int, budget: Budget
    ) -> None:
        self._editors = editors
        self._abstraction = abstraction
        self._scene = state.scene
        self._is_goal = state.task.solved_by
        self._max_edits = max_edits
        self._budget = budget
        self.least_edits = 1

    def solution(self) -> list[BoxEdit] | None:
        """The edits of the shortest solution found. Raises BudgetExhaustedError."""
        if self._max_edits < 1:
            return None
        if self._abstraction.features.relational:
            return self._by_single_edit() or self._by_pruned_layers()
        found = self._by_abstraction()
        if found is None and self.least_edits <= self._max_edits:
            found = self._by_pruned_layers()
        return found

    # Search in abstract scenes, with refinement

    def _by_abstraction(self) -> list[BoxEdit] | None:
        layers = [self._abstraction.layers(box) for box in self._scene.boxes]

        @cache
        def refined_box(index: int, path: tuple[AbstractEdit, ...]) -> Refinement | NoRefinement:
            box = self._scene.boxes[index]
            editor = self._editors[index]
            return Refiner(path, box, editor, self._abstraction, self._budget).first()

        def refined(goal: Scene) -> list[BoxEdit] | NoRefinement:
            edits: list[BoxEdit] = []
            for index, after in enumerate(goal.boxes):
                found = refined_box(index, layers[index].path(after))
                if isinstance(found, NoRefinement):
                    return found
                edits.extend(found)
            return edits

        nearest = None  # distance of the nearest abstract goal
        for edits in range(1, self._max_edits + 1):
            goals = LazyList(itertools.islice(goals_at(edits, layers, self._is_goal, self._budget), MAX_GOALS))
            found = first_found(map(refined, goals))
            if not isinstance(found, NoRefinement):
                return found
            count = len(list(goals))
            if count and nearest is None:
                nearest = edits
            is_proof = nearest is None or edits < nearest + 2  # two edits more can reach a nearer abstract goal, too
            if found is NoRefinement.INFEASIBLE and count < MAX_GOALS and self.least_edits == edits and is_proof:
                self.least_edits = edits + 1
            if nearest is not None and edits - nearest == MAX_EXTRA_EDITS:
                break
        return None

    # Search in scenes

    def _by_single_edit(self) -> list[BoxEdit] | None:
        """A single edit that reaches a goal. If all edits were tried and none does, raises the lower bound to 2."""
        for index, box in enumerate(self._scene.boxes):
            for edit, after in self._successors(index)(box):
                if self._is_goal(self._scene.with_box(index, after)):
                    return [edit]
        if all(editor.is_exhaustive for editor in self._editors):
            self.least_edits = max(self.least_edits, 2)
        return None

    def _by_pruned_layers(self) -> list[BoxEdit] | None:
        """At each distance, scenes that need removals only come first: they are few, and often suffice."""
        signature = partial(heuristic_signature, self._abstraction.features, self._abstraction.classes)
        pairs = [(box, self._successors(index)) for index, box in enumerate(self._scene.boxes)]
        by_removals = [Layers(box, successors.removals) for box, successors in pairs]
        by_any_edits = [Layers(box, successors, signature) for box, successors in pairs]
        for edits in range(self.least_edits, self._max_edits + 1):
            for layers in (by_removals, by_any_edits):
                goal = next(goals_at(edits, layers, self._is_goal, self._budget), None)
                if goal is not None:
                    return [edit for layer, box in zip(layers, goal.boxes, strict=True) for edit in layer.path(box)]
        return None

    def _successors(self, index: int) -> SuccessorGenerator:
        return SuccessorGenerator(self._editors[index], self._abstraction.classes, self._budget)
