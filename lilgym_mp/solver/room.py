"""Room for what a sketch asks: edits of a box, under the exact rules of placement, that do what its sketch does."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from lilgym_mp.scene import Box, Item
from lilgym_mp.solver.placements import BoxEdit, ItemType, Placed, Placements
from lilgym_mp.solver.search import Budget
from lilgym_mp.solver.sketches import SketchEdit, Sketcher

MOST_TRIES = 2_000  # placements tried for one box


class Refuted(Enum):
    """Why no way was found to turn a box into what its sketch asks for."""

    PROVEN = "there is none"
    OPEN = "not all were tried"


class _TriesSpentError(Exception):
    """As many placements were tried as may be."""


def room_for(
    edits: tuple[SketchEdit, ...],
    box: Box,
    placements: Placements,
    sketcher: Sketcher,
    budget: Budget,
    *,
    reverse: bool = False,
) -> tuple[BoxEdit, ...] | Refuted:
    """The first edits found that do to the box what `edits` do to its sketch. Raises BudgetSpentError.

    `reverse`: whether cells are tried from the last one on.
    """
    try:
        found = next(iter(_Ways(edits, box, placements, sketcher, budget, reverse=reverse)), None)
    except _TriesSpentError:
        return Refuted.OPEN
    if found is not None:
        return found
    return Refuted.PROVEN if len(edits) == 1 and placements.complete else Refuted.OPEN


class _Ways:
    """Tries edits of a box that follow those of its sketch."""

    def __init__(
        self,
        edits: tuple[SketchEdit, ...],
        box: Box,
        placements: Placements,
        sketcher: Sketcher,
        budget: Budget,
        *,
        reverse: bool,
    ) -> None:
        self._order = -1 if reverse else 1
        self._edits = edits
        self._box = box
        self._placements = placements
        self._sketcher = sketcher
        self._budget = budget
        self._tries_left = MOST_TRIES

    def __iter__(self) -> Iterator[tuple[BoxEdit, ...]]:
        for ordered in self._orders(self._edits):
            yield from self._follow(self._box, ordered)

    def _orders(self, edits: tuple[SketchEdit, ...]) -> Iterator[tuple[SketchEdit, ...]]:
        """Orders to try: where programs see no order, removals first, for room, then what has the fewest places,
        or else the most."""
        if self._sketcher.ordered or len(edits) < 2:
            yield edits
            return
        shares = self._sketcher.classes.shares
        removals = tuple(edit for edit in edits if not edit.adds)
        additions = sorted((edit for edit in edits if edit.adds), key=lambda edit: shares[edit.item_class])
        yield (*removals, *additions)
        if len({edit.item_class for edit in additions}) > 1:
            yield (*removals, *reversed(additions))

    def _follow(self, box: Box, edits: tuple[SketchEdit, ...]) -> Iterator[tuple[BoxEdit, ...]]:
        if not edits:
            yield ()
            return
        for edit, after in self._tried(box, edits[0]):
            for rest in self._follow(after, edits[1:]):
                yield (edit, *rest)

    def _tried(self, box: Box, edit: SketchEdit) -> Iterator[Placed]:
        return self._additions(box, edit.item_class) if edit.adds else self._removals(box, edit)

    def _removals(self, box: Box, edit: SketchEdit) -> Iterator[Placed]:
        for position in self._removable(box, edit):
            self._spend()
            placed = self._placements.removed(box, position)
            if placed is not None:
                yield placed

    def _removable(self, box: Box, edit: SketchEdit) -> list[int]:
        """The positions whose removal makes the same sketch."""
        numbers = [self._sketcher.classes.of(item) for item in box.items]
        alike = [position for position, number in enumerate(numbers) if number == edit.item_class]
        if not self._sketcher.ordered:
            return alike
        assert edit.position is not None
        wanted = _without(numbers, edit.position)
        return [position for position in alike if _without(numbers, position) == wanted]

    def _additions(self, box: Box, item_class: int) -> Iterator[Placed]:
        """Additions of an item of that class, first where it would be of it if it stayed at its cell's corner."""
        classes = self._sketcher.classes
        later: list[tuple[ItemType, int, int]] = []
        corners = self._placements.corners(box)[:: self._order]
        for item_type in classes.item_types[item_class]:
            for x, y in corners:
                if classes.by_item_type is not None or classes.of(Item(x, y, *item_type)) == item_class:
                    yield from self._addition(box, item_type, x, y, item_class)
                else:
                    later.append((item_type, x, y))
        for item_type, x, y in later:
            yield from self._addition(box, item_type, x, y, item_class)

    def _addition(self, box: Box, item_type: ItemType, x: int, y: int, item_class: int) -> Iterator[Placed]:
        self._spend()
        placed = self._placements.added(box, item_type, x, y)
        if placed is not None and self._sketcher.classes.of(placed.box.items[-1]) == item_class:
            yield placed

    def _spend(self) -> None:
        if self._tries_left <= 0:
            raise _TriesSpentError
        self._tries_left -= 1
        self._budget.spend()


def _without(numbers: list[int], position: int) -> list[int]:
    return numbers[:position] + numbers[position + 1 :]
