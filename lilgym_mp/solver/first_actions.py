"""Reachable box classes of Scatter scenes, and all first actions on shortest paths to them.

For programs that are not relational. Abstract paths say which classes of items may be added or removed first; tables
of all edits of a box say which actions do that. The rest of the path must still be feasible after the first action.
Other boxes are unaffected. In the same box, the rest stays feasible if it has a refinement that the first action does
not affect; otherwise a refinement is searched for in the edited box.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from lilgym_mp.scene import (
    BOX_PITCH,
    FOOTPRINT_COUNT,
    FOOTPRINT_SIDES,
    SIZE_PIXELS,
    Box,
    Colour,
    Item,
    Shape,
    Size,
)
from lilgym_mp.scene.actions import AddItem
from lilgym_mp.scene.appearances.scatter.geometry import LARGEST_MOVE, SNAP_REACH
from lilgym_mp.scene.arrays import BoolArray, Int64Array
from lilgym_mp.solver import edit_tables
from lilgym_mp.solver.abstraction import AbstractBox, AbstractEdit
from lilgym_mp.solver.box_editor import BoxEdit, BoxEditor
from lilgym_mp.solver.class_search import NO_ACTIONS, ClassSpace, FirstActions
from lilgym_mp.solver.layered_search import Budget
from lilgym_mp.solver.refinement import NoRefinement, Refinement, Refiner, first_found

MAX_GOALS = 40  # abstract boxes of one class, at one distance, that are refined
MAX_REMAINDERS = 8  # remainders of paths after a first edit that are refined
MAX_CHECKED = 60  # additions of one item class after which the rest of the path is refined one by one
ABSTRACT_BOX_COST = 5  # budget spent on finding the class of an abstract box, in class triples
CLEARANCE = SNAP_REACH + LARGEST_MOVE + 1  # pixels between items beyond which neither affects the other's placement

Remainder = tuple[AbstractEdit, ...]  # what remains of an abstract path after its first edit, in any order


class ScatterBox:
    """The `BoxReachability` of Scatter. Methods raise BudgetExhaustedError."""

    def __init__(self, space: ClassSpace, editor: BoxEditor, box: Box) -> None:
        self.editor = editor
        self._box = box
        self._abstraction = abstraction = space.abstraction
        self._item_classes = [abstraction.classes.of(item) for item in box.items]
        self._layers = abstraction.layers(box)
        self.reachable = space.reachable(self._layers, ABSTRACT_BOX_COST)
        self._refinements: dict[tuple[int, int], Refinement | NoRefinement] = {}  # by edits and class
        self._first_actions: dict[tuple[int, int], FirstActions] = {}  # by edits and class

    # Feasibility

    def refinement(self, edits: int, box_class: int, budget: Budget) -> Refinement | NoRefinement:
        """`edits` edits that lead to a box of the class."""
        found = self._refinements.get((edits, box_class))
        if found is None:
            paths = list(map(self._layers.path, self._goals(edits, box_class, budget)))
            found = self._refinements[edits, box_class] = self._refine_any(paths, MAX_GOALS, self._box, budget)
        return found

    def failure(self, edits: int, box_class: int, budget: Budget) -> NoRefinement | None:
        """None if `edits` edits can lead to a box of the class, else why not."""
        if edits == 1:
            return None if self.first_actions(edits, box_class, budget).actions else NoRefinement.INFEASIBLE
        found = self.refinement(edits, box_class, budget)
        return found if isinstance(found, NoRefinement) else None

    def _goals(self, edits: int, box_class: int, budget: Budget) -> Sequence[Box]:
        return self.reachable.layer(edits, budget)[box_class]

    def _refine_any(
        self, paths: Sequence[Remainder], limit: int, box: Box, budget: Budget
    ) -> Refinement | NoRefinement:
        """The first refinement found of one of the paths, of which at most `limit` are tried."""
        results = (Refiner(path, box, self.editor, self._abstraction, budget).first() for path in paths[:limit])
        return first_found(results, complete=len(paths) <= limit)

    # First actions

    def first_actions(self, edits: int, box_class: int, budget: Budget) -> FirstActions:
        """The first actions on paths of `edits` edits to boxes of the class."""
        if not edits:
            return NO_ACTIONS
        found = self._first_actions.get((edits, box_class))
        if found is None:
            goals = self._goals(edits, box_class, budget)
            if edits == 1:
                found = FirstActions(frozenset(self._actions_to(set(map(self._abstraction.abstract, goals)))))
            else:
                found = self._first_of_many(goals, budget)
            self._first_actions[edits, box_class] = found
        return found

    def _actions_to(self, goals: set[AbstractBox]) -> Iterator[int]:
        """The actions that lead to one of these abstract boxes."""
        from_classes = self._abstraction.from_classes
        item_classes = self._item_classes
        for item_class in range(len(self._abstraction.classes)):
            if from_classes((*item_classes, item_class)) in goals:
                yield from self._addition_actions(self._additions(item_class))
        for position in range(len(item_classes)):
            if from_classes((*item_classes[:position], *item_classes[position + 1 :])) in goals:
                yield from self._removal_actions(position)

    def _addition_table(self) -> edit_tables.AdditionTable:
        return edit_tables.addition_table(self.editor.scatter, self.editor.rules, self.editor.index, self._box.items)

    def _additions(self, item_class: int) -> Int64Array:
        """The additions of items of the class, as indices in the addition table."""
        classes = self._abstraction.classes
        canonical = self._addition_table().canonical
        return ((classes.by_canonical_item[canonical] == item_class) & (canonical >= 0)).nonzero()[0]

    def _addition_actions(self, additions: Int64Array) -> list[int]:
        return edit_tables.addition_actions(self.editor.scatter, self.editor.index, additions)

    def _removal_actions(self, position: int) -> list[int]:
        return edit_tables.removal_actions(self.editor.scatter, self.editor.index, self._box.items, position)

    def _first_of_many(self, goals: Sequence[Box], budget: Budget) -> FirstActions:
        if self._abstraction.order_matters:
            return FirstActions(frozenset(), complete=False)
        remainders: dict[AbstractEdit, list[Remainder]] = {}  # by first edit
        for goal in goals[:MAX_GOALS]:
            path = [edit if edit.adds else AbstractEdit(edit.item_class, 0) for edit in self._layers.path(goal)]
            for edit in dict.fromkeys(path):
                remainder = Counter(path)
                remainder[edit] -= 1
                remainders.setdefault(edit, []).append(tuple(remainder.elements()))
        found = (
            (self._first_additions if edit.adds else self._first_removals)(edit.item_class, after, budget)
            for edit, after in remainders.items()
        )
        return FirstActions.union(found, complete=len(goals) <= MAX_GOALS)

    def _first_removals(self, item_class: int, remainders: Sequence[Remainder], budget: Budget) -> FirstActions:
        """The removals of an item of the class after which one of `remainders` is feasible."""
        actions: set[int] = set()
        complete = True
        for position in (position for position, other in enumerate(self._item_classes) if other == item_class):
            found = self._refine_any(remainders, MAX_REMAINDERS, self._box.without(position), budget)
            if isinstance(found, NoRefinement):
                complete = complete and found is NoRefinement.INFEASIBLE
            else:
                actions.update(self._removal_actions(position))
        return FirstActions(frozenset(actions), complete)

    def _first_additions(self, item_class: int, remainders: Sequence[Remainder], budget: Budget) -> FirstActions:
        """The additions of an item of the class after which one of `remainders` is feasible.

        Feasibility does not depend on colour, so it is checked once for each cell and footprint.
        """
        table = self._addition_table()
        chosen = np.zeros(table.canonical.shape, bool)
        chosen[self._additions(item_class)] = True
        by_item_type = chosen.reshape(-1, len(Shape), len(Colour), len(Size))
        possible = by_item_type.any(axis=2).reshape(-1, FOOTPRINT_COUNT)
        places = table.places[possible]
        footprints = possible.nonzero()[1]
        feasible = possible.copy()
        feasible[possible], complete = self._feasible_additions(places, footprints, remainders, budget)
        by_item_type &= feasible.reshape(-1, len(Shape), 1, len(Size))
        return FirstActions(frozenset(self._addition_actions(chosen.nonzero()[0])), complete)

    def _feasible_additions(
        self, places: Int64Array, footprints: Int64Array, remainders: Sequence[Remainder], budget: Budget
    ) -> tuple[BoolArray, bool]:
        """(n,) after which additions one of `remainders` is known to be feasible, and whether this is exact.

        `places`: (n, 2) and `footprints`: (n,) of the added items.
        """
        squares = np.hstack([places, places + np.array(FOOTPRINT_SIDES)[footprints, None]])
        feasible = np.zeros(len(footprints), bool)
        for remainder in remainders[:MAX_REMAINDERS]:
            for step in (1, -1):
                found = Refiner(remainder, self._box, self.editor, self._abstraction, budget, step).first()
                if not isinstance(found, NoRefinement) and not feasible.all():
                    feasible |= self._unaffected(found, squares)
        complete = True
        for checked, index in enumerate((~feasible).nonzero()[0].tolist()):
            if checked == MAX_CHECKED:
                return feasible, False
            if not feasible[index]:
                left, top = places[index].tolist()
                shape, size = divmod(int(footprints[index]), len(Size))
                box = self._box.with_item(Item(left, top, Shape(shape), Colour.YELLOW, Size(size)))
                found = self._refine_any(remainders, MAX_REMAINDERS, box, budget)
                if isinstance(found, NoRefinement):
                    complete = complete and found is NoRefinement.INFEASIBLE
                    continue
                feasible[index] = True
                if self._unaffected(found, squares[index : index + 1])[0]:  # also feasible without the addition
                    feasible |= self._unaffected(found, squares)
        return feasible, complete

    def _unaffected(self, edits: Sequence[BoxEdit], squares: Int64Array) -> BoolArray:
        """(n,) whether the edits have the same result with and without an item in each square.

        `squares`: (n, 4) left, top, right and bottom, the last two exclusive.
        """
        regions = np.array([self._region(edit) for edit in edits])
        left, top, right, bottom = (squares[:, None, side] for side in range(4))
        overlaps = (left < regions[:, 2]) & (right > regions[:, 0]) & (top < regions[:, 3]) & (bottom > regions[:, 1])
        return ~np.any(overlaps, axis=1)

    def _region(self, edit: BoxEdit) -> tuple[int, int, int, int]:
        """The region (left, top, right, bottom); items outside it do not affect the edit."""
        width, height = self.editor.scatter.cell
        x = edit.column * width - self.editor.index * BOX_PITCH
        y = edit.row * height
        if isinstance(edit, AddItem):
            side = SIZE_PIXELS[edit.size]
            return x - CLEARANCE, y - CLEARANCE, x + width + side + CLEARANCE, y + height + side + CLEARANCE
        return x, y, x + width, y + height
