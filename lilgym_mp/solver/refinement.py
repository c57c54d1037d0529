"""Refinement: finds edits of a box, under the exact rules of placement, for a sequence of abstract edits."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from lilgym_mp.scene import Box, Item
from lilgym_mp.solver.abstraction import AbstractEdit, Abstraction
from lilgym_mp.solver.box_editor import BoxEdit, BoxEditor, EditedBox, ItemType
from lilgym_mp.solver.layered_search import Budget

MAX_TRIES = 2_000  # edits tried per refinement

Refinement = tuple[BoxEdit, ...]


class NoRefinement(Enum):
    """Why no refinement was found."""

    INFEASIBLE = "proven: there is none"
    UNDECIDED = "not all placements were tried"


class _TriesExhaustedError(Exception):
    """MAX_TRIES is reached."""


def refine(
    path: tuple[AbstractEdit, ...],
    box: Box,
    editor: BoxEditor,
    abstraction: Abstraction,
    budget: Budget,
    *,
    reverse: bool = False,
) -> Refinement | NoRefinement:
    """The first edits found that do to the box what `path` does to its abstraction. Raises BudgetExhaustedError.

    `reverse`: whether to try cells in reverse order.
    """
    try:
        found = next(iter(_Refiner(path, box, editor, abstraction, budget, reverse=reverse)), None)
    except _TriesExhaustedError:
        return NoRefinement.UNDECIDED
    if found is not None:
        return found
    return NoRefinement.INFEASIBLE if len(path) == 1 and editor.is_exhaustive else NoRefinement.UNDECIDED


class _Refiner:
    """Depth-first search for refinements."""

    def __init__(
        self,
        path: tuple[AbstractEdit, ...],
        box: Box,
        editor: BoxEditor,
        abstraction: Abstraction,
        budget: Budget,
        *,
        reverse: bool,
    ) -> None:
        self._path = path
        self._box = box
        self._editor = editor
        self._abstraction = abstraction
        self._budget = budget
        self._step = -1 if reverse else 1
        self._tries_left = MAX_TRIES

    def __iter__(self) -> Iterator[Refinement]:
        for path in self._orders():
            yield from self._refinements(self._box, path)

    def _orders(self) -> Iterator[tuple[AbstractEdit, ...]]:
        """Orders of the edits to try. If any order will do: removals first, to make space, then additions by rising
        or falling number of canonical items in their class, as a proxy for how many placements they have."""
        if self._abstraction.order_matters or len(self._path) < 2:
            yield self._path
            return
        counts = self._abstraction.classes.canonical_counts
        removals = tuple(edit for edit in self._path if not edit.adds)
        additions = sorted((edit for edit in self._path if edit.adds), key=lambda edit: counts[edit.item_class])
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
            edited = self._editor.removed(box, position)
            if edited is not None:
                yield edited

    def _removable(self, box: Box, edit: AbstractEdit) -> list[int]:
        """The positions of items whose removal leads to the same abstract box as the edit."""
        item_classes = [self._abstraction.classes.of(item) for item in box.items]
        candidates = [position for position, item_class in enumerate(item_classes) if item_class == edit.item_class]
        if not self._abstraction.order_matters:
            return candidates
        assert edit.position is not None
        after = _without(item_classes, edit.position)
        return [position for position in candidates if _without(item_classes, position) == after]

    def _additions(self, box: Box, item_class: int) -> Iterator[EditedBox]:
        """Additions of an item of that class, first those that would have it at their cell's corner."""
        classes = self._abstraction.classes
        later: list[tuple[ItemType, int, int]] = []
        corners = self._editor.corners(box)[:: self._step]
        for item_type in classes.item_types[item_class]:
            for x, y in corners:
                if classes.by_item_type is not None or classes.of(Item(x, y, *item_type)) == item_class:
                    yield from self._addition(box, item_type, x, y, item_class)
                else:
                    later.append((item_type, x, y))
        for item_type, x, y in later:
            yield from self._addition(box, item_type, x, y, item_class)

    def _addition(self, box: Box, item_type: ItemType, x: int, y: int, item_class: int) -> Iterator[EditedBox]:
        self._spend()
        edited = self._editor.added(box, item_type, x, y)
        if edited is not None and self._abstraction.classes.of(edited.box.items[-1]) == item_class:
            yield edited

    def _spend(self) -> None:
        if self._tries_left <= 0:
            raise _TriesExhaustedError
        self._tries_left -= 1
        self._budget.spend()


def _without(item_classes: list[int], position: int) -> list[int]:
    return item_classes[:position] + item_classes[position + 1 :]
