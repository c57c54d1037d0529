"""Scatter solved: first what must change, by sketches, then where there is room for it, under the exact rules."""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from lilgym_mp.actions import STOP, Action
from lilgym_mp.appearances import Scatter
from lilgym_mp.programs import compile_program
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, Box, Item, Scene
from lilgym_mp.solver.aspects import aspects, joined
from lilgym_mp.solver.box_edits import addition_numbers, additions, frame_of, removal_numbers, removed
from lilgym_mp.solver.first_edits import ReachableSketches
from lilgym_mp.solver.joint import judged_by_program, programs_of, truths_wanted
from lilgym_mp.solver.neighbours import NeighbourLayers, Neighbours, Profile
from lilgym_mp.solver.placements import BoxEdit, Placements
from lilgym_mp.solver.reach import seen_by, triples_after
from lilgym_mp.solver.room import Refuted, room_for
from lilgym_mp.solver.search import Budget, BudgetSpentError, goals_after
from lilgym_mp.solver.sketches import ItemClasses, SketchEdit, Sketcher, SketchLayers
from lilgym_mp.solver.solution import ActionSet, Solution, Status, not_found, solved, unsolvable

KEPT_SKETCHERS = 256  # programs
MOST_GOALS = 40  # sketches of goals, at one number of edits, for which room is sought
TRIAL_BUDGET = 100_000  # scenes looked at to find first edits one by one
MOST_DETOURS = 2  # edits beyond the fewest a sketch needs, before the search without sketches takes over


# By box, its items and the edits of its sketch: what `room_for` found, which many goals and states share.
Rooms = dict[tuple[int, tuple[Item, ...], tuple[SketchEdit, ...]], tuple[BoxEdit, ...] | Refuted]


@lru_cache(maxsize=KEPT_SKETCHERS)
def sketcher_of(programs: tuple[str, ...]) -> Sketcher:
    """The sketches for some programs together, shared by all tasks that have them."""
    return Sketcher(joined([aspects(compile_program(program).tree) for program in programs]))


class ScatterSearch:
    """Shortest solutions where that can be proven, else the best found."""

    budget = 300_000

    def __init__(self, scatter: Scatter, dynamics: Dynamics) -> None:
        self._scatter = scatter
        placement = dynamics.rules.placement
        self._placements = [Placements(scatter, placement, index) for index in range(BOX_COUNT)]
        self._placement = placement
        self._complete = all(placements.complete for placements in self._placements)

    def solve(self, state: State, most_edits: int, budget: Budget) -> Solution:
        if state.task.solved_by(state.scene):
            return solved((STOP,), 0, budget)
        if not judged_by_program(state.task):
            return not_found(1, budget, "success is not the truth of its program, by which Scatter tasks are solved")
        search = _TaskSearch(self._placements, state, most_edits, budget, {})
        try:
            actions = search.solution()
        except BudgetSpentError:
            return not_found(search.least_edits, budget)
        if actions is not None:
            return solved((*actions, STOP), search.least_edits, budget)
        if search.least_edits > most_edits:
            reason = f"no scene within {most_edits} edits has that value"
            return unsolvable(reason, search.least_edits, budget)
        return not_found(search.least_edits, budget)

    def by_faces(self, program: str) -> bool:
        return not sketcher_of((program,)).aspects.relational

    def reachable(self, programs: tuple[str, ...], scene: Scene) -> ReachableSketches:
        seen = seen_by(programs)
        sketcher: Sketcher = seen.kept.setdefault("sketcher", sketcher_of(programs))  # its layers made the reaches
        return ReachableSketches(self._scatter, self._placement, self._placements, scene, sketcher, seen)

    def after(self, scene: Scene, edits: Sequence[Action]) -> Scene:
        """The scene after edits that are all valid."""
        for edit in edits:
            scene = self._scatter.apply(scene, edit, self._placement).scene
        return scene

    def first_actions(self, state: State, most_edits: int, budget: Budget) -> ActionSet:
        """Every edit that starts a shortest solution; complete where that is certain."""
        if state.task.solved_by(state.scene):
            return ActionSet((self._scatter.encode(STOP),), complete=True, steps=1)
        sketched = judged_by_program(state.task) and all(map(self.by_faces, programs_of(state.task)))
        found = self._firsts_by_faces(state, most_edits, budget) if sketched and self._complete else None
        return self._firsts_by_trial(state, most_edits, budget) if found is None else found

    def _firsts_by_faces(self, state: State, most_edits: int, budget: Budget) -> ActionSet | None:
        """None where the nearest goals that sketches show have no room."""
        programs, wanted = programs_of(state.task), truths_wanted(state.task)
        seen, reachable = seen_by(programs), self.reachable(programs, state.scene)
        try:
            for edits in range(1, most_edits + 1):
                triples = triples_after(edits, reachable.reaches, budget)
                goals = [(split, triple) for split, triple in triples if seen.truths(triple) == wanted]
                if goals:
                    found = reachable.firsts(goals, budget)
                    numbers = tuple(sorted(found.actions))
                    return ActionSet(numbers, complete=found.complete, steps=edits + 1) if numbers else None
        except BudgetSpentError:
            return None
        return ActionSet((), complete=True, steps=0)

    def _firsts_by_trial(self, state: State, most_edits: int, budget: Budget) -> ActionSet:
        """Every edit from which as many edits remain as a shortest solution leaves, found one by one."""
        solution = self.solve(state, most_edits, budget)
        if solution.steps < 2:
            actions = tuple(map(self._scatter.encode, solution.actions))
            return ActionSet(actions, complete=solution.status is not Status.NOT_FOUND, steps=solution.steps)
        remaining = solution.steps - 2
        found = {self._scatter.encode(solution.actions[0])}
        certain = solution.proven_optimal and self._complete
        budget = Budget(min(budget.scenes_left, TRIAL_BUDGET))
        trial = _Trial(self, state, remaining, budget)
        try:
            for index, numbers, box in self._edits(state.scene, sketcher_of(programs_of(state.task)).classes):
                answer = trial.begins_shortest(index, box)
                if answer:
                    found.update(numbers)
                certain = certain and answer is not None
        except BudgetSpentError:
            certain = False
        return ActionSet(tuple(sorted(found)), complete=certain, steps=solution.steps)

    def _edits(self, scene: Scene, classes: ItemClasses) -> Iterator[tuple[int, Sequence[int], Box]]:
        """The index of a box, actions on it that the program cannot tell apart, and the box after them."""
        for index, box in enumerate(scene.boxes):
            for numbers, after in self._box_edits(index, box, classes):
                yield index, numbers, after

    def _box_edits(self, index: int, box: Box, classes: ItemClasses) -> Iterator[tuple[Sequence[int], Box]]:
        if not self._complete:
            for edit, after in self._placements[index].every(box):
                yield [self._scatter.encode(edit)], after
            return
        brought = additions(self._scatter, self._placement, frame_of(self._placement, index), box.items)
        taken = removed(self._scatter.cell, box.items)
        alike: dict[Hashable, list[int]] = {}
        for number in (brought.samples >= 0).nonzero()[0].tolist():
            item = brought.item(number)
            alike.setdefault((item.x, item.y, item.footprint, classes.of(item)), []).append(number)
        for numbers in alike.values():
            actions: list[int] = addition_numbers(self._scatter, index, np.array(numbers)).tolist()
            yield actions, box.with_item(brought.item(numbers[0]))
        for position in range(len(box.items)):
            cells: list[int] = removal_numbers(self._scatter, index, (taken == position).nonzero()[0]).tolist()
            if cells:
                yield cells, box.without(position)

    def search(self, state: State, most_edits: int, budget: Budget, rooms: Rooms) -> _TaskSearch:
        return _TaskSearch(self._placements, state, most_edits, budget, rooms)


class _Trial:
    """Tells of edits of a scene, one by one, whether as few edits remain after them as may."""

    def __init__(self, search: ScatterSearch, state: State, remaining: int, budget: Budget) -> None:
        self._search = search
        self._state = state
        self._remaining = remaining
        self._budget = budget
        self._rooms: Rooms = {}
        programs = programs_of(state.task)
        self._by_faces = judged_by_program(state.task) and all(map(search.by_faces, programs))
        self._seen, self._wanted = seen_by(programs), truths_wanted(state.task)
        self._reachable = search.reachable(programs, state.scene) if self._by_faces else None

    def begins_shortest(self, index: int, box: Box) -> bool | None:
        """Whether a goal is that many edits off once the box at `index` is `box`; None when that is not known.

        Raises BudgetSpentError.
        """
        self._budget.spend()
        task, scene, steps = self._state
        after = State(task, scene.with_box(index, box), steps + 1)
        if self._remaining == 0:
            return task.solved_by(after.scene)
        if self._reachable is None:
            return None
        return self._nearest_by_faces(self._reachable.with_box(index, box), after)

    def _nearest_by_faces(self, reachable: ReachableSketches, after: State) -> bool | None:
        for edits in range(1, self._remaining + 1):
            triples = triples_after(edits, reachable.reaches, self._budget)
            goals = [(split, triple) for split, triple in triples if self._seen.truths(triple) == self._wanted]
            if goals:
                room = reachable.some_room(goals, self._budget)
                if room is Refuted.PROVEN and edits < self._remaining:  # with more edits there may be other ways
                    return self._nearest_by_sketches(after)
                return None if room is Refuted.OPEN else room is None
        return False

    def _nearest_by_sketches(self, after: State) -> bool | None:
        search = self._search.search(after, self._remaining, self._budget, self._rooms)
        if search.by_sketches() is not None:
            return True
        return False if search.least_edits > self._remaining else None


class _Level(NamedTuple):
    """What came of all goals that take the same number of edits."""

    found: list[BoxEdit] | None
    goals: int
    refuted: Refuted


class _TaskSearch:
    """The search from one state. `least_edits` grows as shorter solutions are ruled out."""

    def __init__(
        self, placements: Sequence[Placements], state: State, most_edits: int, budget: Budget, rooms: Rooms
    ) -> None:
        self._placements = placements
        self._rooms = rooms
        self._boxes = state.scene.boxes
        self._is_goal = state.task.solved_by
        self._most_edits = most_edits
        self._budget = budget
        self._sketcher = sketcher_of(programs_of(state.task))
        self.relational = self._sketcher.aspects.relational
        self.least_edits = 1

    def solution(self) -> list[BoxEdit] | None:
        """Edits to a goal, as few as were found. Raises BudgetSpentError."""
        if self._most_edits < 1:
            return None
        if self.relational:
            return self._by_one_edit() or self._by_neighbours()
        found = self.by_sketches()
        if found is None and self.least_edits <= self._most_edits:
            found = self._by_neighbours()
        return found

    # Sketches first

    def by_sketches(self) -> list[BoxEdit] | None:
        layers = [self._sketcher.layers(box) for box in self._boxes]
        nearest = None  # edits to the nearest sketch of a goal
        for edits in range(1, self._most_edits + 1):
            level = self._level(edits, layers)
            if level.found is not None:
                return level.found
            if level.refuted is Refuted.PROVEN and self.least_edits == edits:
                self.least_edits = edits + 1
            if level.goals and nearest is None:
                nearest = edits
            if nearest is not None and edits - nearest == MOST_DETOURS:
                break
        return None

    def _level(self, edits: int, layers: Sequence[SketchLayers]) -> _Level:
        """Seeks room for the sketches of goals that take that many edits."""
        goals = 0
        refuted = Refuted.PROVEN
        found_goals = goals_after(edits, layers, self._is_goal, self._budget)
        for goals, goal in enumerate(itertools.islice(found_goals, MOST_GOALS), start=1):
            found = self._realised(goal, layers)
            if not isinstance(found, Refuted):
                return _Level(found, goals, Refuted.OPEN)
            if found is Refuted.OPEN or goals == MOST_GOALS:
                refuted = Refuted.OPEN
        return _Level(None, goals, refuted)

    def _realised(self, goal: Scene, layers: Sequence[SketchLayers]) -> list[BoxEdit] | Refuted:
        """Edits that make the scene look like the goal's sketch."""
        edits: list[BoxEdit] = []
        for index, box in enumerate(self._boxes):
            found = self._room(index, box, layers[index].path(goal.boxes[index]))
            if isinstance(found, Refuted):
                return found
            edits.extend(found)
        return edits

    def _room(self, index: int, box: Box, edits: tuple[SketchEdit, ...]) -> tuple[BoxEdit, ...] | Refuted:
        if not edits:
            return ()
        key = (index, box.items, edits)
        found = self._rooms.get(key)
        if found is None:
            found = room_for(edits, box, self._placements[index], self._sketcher, self._budget)
            self._rooms[key] = found
        return found

    # Without sketches

    def _by_one_edit(self) -> list[BoxEdit] | None:
        """A single edit to a goal; when there is none, and every edit was tried, `least_edits` says so."""
        left, middle, right = self._boxes
        for index, box in enumerate(self._boxes):
            for edit, after in self._neighbours(index)(box):
                boxes = [left, middle, right]
                boxes[index] = after
                if self._is_goal(Scene((boxes[0], boxes[1], boxes[2]))):
                    return [edit]
        if all(placements.complete for placements in self._placements):
            self.least_edits = max(self.least_edits, 2)
        return None

    def _by_neighbours(self) -> list[BoxEdit] | None:
        """At each number of edits removals alone come first: they are few, and often all that it takes."""
        profile = Profile(self._sketcher.aspects, self._sketcher.classes)
        neighbours = [self._neighbours(index) for index in range(BOX_COUNT)]
        pairs = list(zip(self._boxes, neighbours, strict=True))
        removals = [NeighbourLayers(box, edited.removals, _items) for box, edited in pairs]
        everything = [NeighbourLayers(box, edited, profile) for box, edited in pairs]
        for edits in range(self.least_edits, self._most_edits + 1):
            for layers in (removals, everything):
                goal = next(goals_after(edits, layers, self._is_goal, self._budget), None)
                if goal is not None:
                    return [edit for layer, box in zip(layers, goal.boxes, strict=True) for edit in layer.path(box)]
        return None

    def _neighbours(self, index: int) -> Neighbours:
        return Neighbours(self._placements[index], self._sketcher.classes, self._budget)


def _items(box: Box) -> tuple[Item, ...]:
    return box.items
