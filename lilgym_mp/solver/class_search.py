"""Search over box classes: how many edits each box needs to reach each class, and which class triples are goals.

A program's value depends only on the classes of the three boxes, and the distance to a scene is the sum of the
distances of its boxes. So the nearest goals are found among the few class triples instead of all scenes.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache, cached_property, lru_cache
from typing import Any, NamedTuple, Protocol

from lilgym_mp.programs import compile_program
from lilgym_mp.programs.static_types import may_fail
from lilgym_mp.programs.task import ProgramGoal, Task
from lilgym_mp.scene import BOX_COUNT, Box, Scene
from lilgym_mp.scene.arrays import Strings
from lilgym_mp.scene.grouping import grouped
from lilgym_mp.solver.abstraction import Abstraction
from lilgym_mp.solver.box_classes import BoxClasses
from lilgym_mp.solver.layered_search import Budget, Layers
from lilgym_mp.solver.program_features import program_features
from lilgym_mp.solver.refinement import NoRefinement
from lilgym_mp.solver.solution import ActionSet

CACHE_SIZE = 512  # tuples of programs
MAX_CACHED_TRUTHS = 200_000  # class triples, for one tuple of programs

EditCounts = tuple[int, int, int]  # edits by box
ClassTriple = tuple[int, int, int]  # class by box
ClassGoal = tuple[EditCounts, ClassTriple]


def program_goal(task: Task) -> tuple[Strings, int] | None:
    """The programs in the task's goal and, as a bit mask, their targets; bit i is the target of program i.

    None if success does not depend on program values alone, as e.g. in `corpus.matching`.
    """
    if not isinstance(task.goal, ProgramGoal):
        return None
    programs, targets = zip(*task.goal.targets, strict=True)
    return programs, sum(1 << index for index, target in enumerate(targets) if target)


class ReachableClasses:
    """The classes that one box can reach, in breadth-first layers; extended on demand and shared by all searches."""

    def __init__(self, layers: Layers[Any], classes: BoxClasses, box_cost: int) -> None:
        self._box_layers = layers
        self._classes = classes
        self._box_cost = box_cost
        self._layers: list[dict[int, list[Box]]] = []
        self._seen: set[int] = set()

    def layer(self, edits: int, budget: Budget) -> Mapping[int, Sequence[Box]]:
        """The classes whose nearest boxes are exactly `edits` edits away, each with all these boxes.

        Each budget pays for each layer once, whether or not an earlier search has computed it: results must not
        depend on earlier searches. Raises BudgetExhaustedError.
        """
        for number in range(budget.layers_paid.get(self, 0), edits + 1):
            boxes = tuple(self._box_layers.layer(number))
            budget.spend_each(len(boxes), self._box_cost)
            budget.layers_paid[self] = number + 1
            if number == len(self._layers):
                self._layers.append(self._new_layer(boxes))
        return self._layers[edits]

    def _new_layer(self, boxes: Sequence[Box]) -> dict[int, list[Box]]:
        classes = ((self._classes.of(box), box) for box in boxes)
        found = grouped((box_class, box) for box_class, box in classes if box_class not in self._seen)
        self._seen |= found.keys()
        return found


class ClassSpace:
    """The abstract state space of some programs, whose states are class triples. Caches what is computed about it."""

    def __init__(self, programs: Strings) -> None:
        self._programs = programs
        self._compiled = [(compile_program(program), 1 << index) for index, program in enumerate(programs)]
        self.truths = lru_cache(MAX_CACHED_TRUTHS)(self._evaluate)
        self.reachable = cache(self._reachable)

    @cached_property
    def classes(self) -> BoxClasses:
        """Classes of boxes that no program can tell apart."""
        return BoxClasses(self._programs)

    @cached_property
    def _is_symmetric(self) -> bool:
        """Whether the order of the boxes does not matter; it can where `Any` and `All` stop before a box that fails."""
        return self.classes.separable and not any(may_fail(program.tree, {}) for program, _ in self._compiled)

    @cached_property
    def abstraction(self) -> Abstraction:
        """The abstraction of Scatter boxes under the features of all the programs."""
        return Abstraction(program_features(*(program.tree for program, _ in self._compiled)))

    def _reachable(self, layers: Layers[Any], box_cost: int = 1) -> ReachableClasses:
        """The reachable classes of the box that has these layers.

        `box_cost`: the budget spent on finding the class of a box, in units of class triples examined.
        """
        return ReachableClasses(layers, self.classes, box_cost)

    def _evaluate(self, triple: ClassTriple) -> int:
        """The programs' values for boxes of these classes as a bit mask; bit i is the value of program i."""
        first, second, third = triple
        if self._is_symmetric and not first <= second <= third:
            first, second, third = sorted(triple)
            return self.truths((first, second, third))
        boxes = self.classes.representatives
        scene = Scene((boxes[first], boxes[second], boxes[third]))
        return sum([bit for program, bit in self._compiled if program(scene)])


class_space = lru_cache(maxsize=CACHE_SIZE)(ClassSpace)


class FirstActions(NamedTuple):
    """First actions on shortest paths to a goal."""

    actions: frozenset[int]
    complete: bool = True  # whether all of them are included

    @classmethod
    def union(cls, parts: Iterable[FirstActions], *, complete: bool = True) -> FirstActions:
        """The actions of all parts; complete if all parts are, and `complete`."""
        actions: set[int] = set()
        for part in parts:
            actions |= part.actions
            complete = complete and part.complete
        return cls(frozenset(actions), complete)


NO_ACTIONS = FirstActions(frozenset())


class BoxReachability(Protocol):
    """The classes that one box can reach, whether `edits` edits can lead there, and how."""

    reachable: ReachableClasses

    def refinement(self, edits: int, box_class: int, budget: Budget) -> Sequence[Any] | NoRefinement:
        """Actions that turn the box into one of a class within so many edits, or why there are none."""
        ...

    def failure(self, edits: int, box_class: int, budget: Budget) -> NoRefinement | None:
        """Why `refinement` would fail, or None where it succeeds."""
        ...

    def first_actions(self, edits: int, box_class: int, budget: Budget) -> FirstActions:
        """Indices of actions that begin a refinement."""
        ...


class Reachability:
    """The class triples that can be reached from a scene, and how. Methods raise BudgetExhaustedError."""

    def __init__(self, space: ClassSpace, targets: int, boxes: Sequence[BoxReachability]) -> None:
        self._space = space
        self._targets = targets
        self._boxes = boxes

    def goals_at(self, edits: int, budget: Budget) -> Iterator[ClassGoal]:
        """The class triples exactly `edits` edits away with the targets, and the edits of each box."""
        left, middle, right = (box.reachable for box in self._boxes)
        for left_edits in range(edits + 1):
            lefts = left.layer(left_edits, budget)
            for middle_edits in range(edits - left_edits + 1 if lefts else 0):
                middles = middle.layer(middle_edits, budget)
                rights = right.layer(edits - left_edits - middle_edits, budget) if middles else ()
                edit_counts = (left_edits, middle_edits, edits - left_edits - middle_edits)
                budget.spend(len(lefts) * len(middles) * len(rights))
                for triple in itertools.product(lefts, middles, rights):
                    if self._space.truths(triple) == self._targets:
                        yield edit_counts, triple

    def edits_to(self, goal: ClassGoal, budget: Budget) -> list[Any] | None:
        """Edits that lead to the goal; None if none were found."""
        found: list[Any] = []
        for box, edits, box_class in zip(self._boxes, *goal, strict=True):
            refinement = box.refinement(edits, box_class, budget)
            if isinstance(refinement, NoRefinement):
                return None
            found.extend(refinement)
        return found

    def first_actions(self, max_edits: int, budget: Budget) -> ActionSet | None:
        """The first actions on shortest paths to the nearest goals; None if these are not known to be feasible."""
        for edits in range(1, max_edits + 1):
            goals = list(self.goals_at(edits, budget))
            if goals:
                found = FirstActions.union(self._first_actions(goals, budget))
                actions = tuple(sorted(found.actions))
                return ActionSet(actions, complete=found.complete, steps=edits + 1) if actions else None
        return ActionSet((), complete=True, steps=0)

    def _first_actions(self, goals: Iterable[ClassGoal], budget: Budget) -> Iterator[FirstActions]:
        seen: set[tuple[int, int, int]] = set()
        for edit_counts, triple in goals:
            each = zip(self._boxes, edit_counts, triple, strict=True)
            failures = [box.failure(edits, box_class, budget) for box, edits, box_class in each]
            if any(failures):
                yield FirstActions(frozenset(), complete=NoRefinement.INFEASIBLE in failures)
                continue
            for key in zip(range(BOX_COUNT), edit_counts, triple, strict=True):
                if key not in seen:
                    seen.add(key)
                    index, edits, box_class = key
                    yield self._boxes[index].first_actions(edits, box_class, budget)
