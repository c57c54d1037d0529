"""Search over box classes: how many edits each box needs to reach each class, and which class triples are goals.

A program's value depends only on the classes of the three boxes, and the distance to a scene is the sum of the
distances of its boxes. So the nearest goals are found among the few class triples instead of all scenes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Box, Scene
from lilgym_mp.solver.box_classes import BoxClasses
from lilgym_mp.solver.layered_search import Budget, Layers

CACHE_SIZE = 512  # tuples of programs
MAX_CACHED_TRUTHS = 200_000  # class triples, for one tuple of programs

EditCounts = tuple[int, int, int]  # edits by box
ClassTriple = tuple[int, int, int]  # class by box


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
        found: dict[int, list[Box]] = {}
        for box in boxes:
            box_class = self._classes.of(box)
            if box_class not in self._seen:
                found.setdefault(box_class, []).append(box)
        self._seen |= found.keys()
        return found


class ClassSpace:
    """The abstract state space of some programs, whose states are class triples. Caches what is computed about it."""

    def __init__(self, programs: tuple[str, ...]) -> None:
        self.classes = BoxClasses(programs)
        self._programs = [(compile_program(program), 1 << index) for index, program in enumerate(programs)]
        self._truths: dict[ClassTriple, int] = {}
        self._reachable: dict[Layers[Any], ReachableClasses] = {}
        self.retained: dict[str, Any] = {}  # objects to which the cached reachable classes refer

    def reachable(self, layers: Layers[Any], box_cost: int = 1) -> ReachableClasses:
        """The reachable classes of the box that has these layers.

        `box_cost`: the budget spent on finding the class of a box, in units of class triples examined.
        """
        found = self._reachable.get(layers)
        if found is None:
            found = self._reachable[layers] = ReachableClasses(layers, self.classes, box_cost)
        return found

    def truths(self, triple: ClassTriple) -> int:
        """The programs' values for boxes of these classes as a bit mask; bit i is the value of program i."""
        found = self._truths.get(triple)
        if found is None:
            if len(self._truths) >= MAX_CACHED_TRUTHS:
                self._truths.clear()
            found = self._truths[triple] = self._evaluate(triple)
        return found

    def goals_at(
        self, edits: int, reachable: Sequence[ReachableClasses], targets: int, budget: Budget
    ) -> Iterator[tuple[EditCounts, ClassTriple]]:
        """Every class triple exactly `edits` edits away for which the programs have the values `targets`, a bit mask;
        with the edits of each box. Raises BudgetExhaustedError."""
        left, middle, right = reachable
        for left_edits in range(edits + 1):
            lefts = left.layer(left_edits, budget)
            for middle_edits in range(edits - left_edits + 1 if lefts else 0):
                middles = middle.layer(middle_edits, budget)
                rights = right.layer(edits - left_edits - middle_edits, budget) if middles else ()
                edit_counts = (left_edits, middle_edits, edits - left_edits - middle_edits)
                budget.spend(len(lefts) * len(middles) * len(rights))
                for first in lefts:
                    for second in middles:
                        for third in rights:
                            if self.truths((first, second, third)) == targets:
                                yield edit_counts, (first, second, third)

    def _evaluate(self, triple: ClassTriple) -> int:
        first, second, third = triple
        if self.classes.separable and not first <= second <= third:  # then the order of the boxes does not matter
            first, second, third = sorted(triple)
            return self.truths((first, second, third))
        boxes = self.classes.representatives
        scene = Scene((boxes[first], boxes[second], boxes[third]))
        return sum([bit for program, bit in self._programs if program(scene)])


class_space = lru_cache(maxsize=CACHE_SIZE)(ClassSpace)
