"""Refinement: finds edits of a box, under the exact rules of placement, for a sequence of abstract edits."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import TypeVar

from lilgym_mp.scene import Box, Item
from lilgym_mp.solver.abstraction import AbstractEdit, Abstraction
from lilgym_mp.solver.box_editor import BoxEdit, BoxEditor, EditedBox, ItemType
from lilgym_mp.solver.layered_search import Budget

MAX_TRIES = 2_000  # edits tried per refinement

Refinement = tuple[BoxEdit, ...]
Found = TypeVar("Found")


class NoRefinement(Enum):
    """Why no refinement was found."""

    INFEASIBLE = "proven: there is none"
    UNDECIDED = "not all placements were tried"


class _TriesExhaustedError(Exception):
    """MAX_TRIES is reached."""


def first_found(results: Iterable[Found | NoRefinement], *, complete: bool = True) -> Found | NoRefinement:
    """The first result that is not a failure; else INFEASIBLE if `complete` and all are infeasible, or UNDECIDED."""
    failure = NoRefinement.INFEASIBLE if complete else NoRefinement.UNDECIDED
    for result in results:
        if not isinstance(result, NoRefinement):
            return result
        failure = failure if result is NoRefinement.INFEASIBLE else result
    return failure


@dataclass
class Refiner:
    """Depth-first search for edits that do to the box what `path` does to its abstraction."""

    path: tuple[AbstractEdit, ...]
    box: Box
    editor: BoxEditor
    abstraction: Abstraction
    budget: Budget
    step: int = 1  # through the cells; -1: in reverse order
    tries_left: int = MAX_TRIES

    def first(self) -> Refinement | NoRefinement:
        """The first edits found. Raises BudgetExhaustedError."""
        try:
            found = next((each for path in self._orders() for each in self._refinements(self.box, path)), None)
        except _TriesExhaustedError:
            return NoRefinement.UNDECIDED
        if found is not None:
            return found
        is_proof = len(self.path) == 1 and self.editor.is_exhaustive
        return NoRefinement.INFEASIBLE if is_proof else NoRefinement.UNDECIDED

    def _orders(self) -> Iterator[tuple[AbstractEdit, ...]]:
        """Orders of the edits to try. If any order will do: removals first, to make space, then additions by rising
        or falling number of canonical items in their class, as a proxy for how many placements they have."""
        if self.abstraction.order_matters or len(self.path) < 2:
            yield self.path
            return
        counts = self.abstraction.classes.canonical_counts
        removals = tuple(edit for edit in self.path if not edit.adds)
        additions = sorted((edit for edit in self.path if edit.adds), key=lambda edit: counts[edit.item_class])
        yield (*removals, *additions)
        if len({edit.item_class for edit in additions}) > 1:
            yield (*removals, *reversed(additions))

    def _refinements(self, box: Box, path: tuple[AbstractEdit, ...]) -> Iterator[Refinement]:
        if not path:
            yield ()
            return
        first, *_ = path
        for edit, after in self._additions(box, first.item_class) if first.adds else self._removals(box, first):
            for rest in self._refinements(after, path[1:]):
                yield (edit, *rest)

    def _removals(self, box: Box, edit: AbstractEdit) -> Iterator[EditedBox]:
        for position in self._removable(box, edit):
            self._spend()
            edited = self.editor.removed(box, position)
            if edited is not None:
                yield edited

    def _removable(self, box: Box, edit: AbstractEdit) -> list[int]:
        """The positions of items whose removal leads to the same abstract box as the edit."""
        item_classes = [self.abstraction.classes.of(item) for item in box.items]
        candidates = [position for position, item_class in enumerate(item_classes) if item_class == edit.item_class]
        if not self.abstraction.order_matters:
            return candidates
        assert edit.position is not None
        after = _without(item_classes, edit.position)
        return [position for position in candidates if _without(item_classes, position) == after]

    def _additions(self, box: Box, item_class: int) -> Iterator[EditedBox]:
        """Additions of an item of that class, first those that would have it at their cell's corner."""
        classes = self.abstraction.classes
        later: list[tuple[ItemType, int, int]] = []
        corners = self.editor.corners[:: self.step]
        for item_type in classes.item_types[item_class]:
            for x, y in corners:
                if classes.of(Item(x, y, *item_type)) == item_class:
                    yield from self._addition(box, item_type, x, y, item_class)
                else:
                    later.append((item_type, x, y))
        for item_type, x, y in later:
            yield from self._addition(box, item_type, x, y, item_class)

    def _addition(self, box: Box, item_type: ItemType, x: int, y: int, item_class: int) -> Iterator[EditedBox]:
        self._spend()
        edited = self.editor.added(box, item_type, x, y)
        if edited is not None and self.abstraction.classes.of(edited.box.items[-1]) == item_class:
            yield edited

    def _spend(self) -> None:
        if self.tries_left <= 0:
            raise _TriesExhaustedError
        self.tries_left -= 1
        self.budget.spend()


def _without(item_classes: list[int], position: int) -> list[int]:
    return item_classes[:position] + item_classes[position + 1 :]
