"""Edits of Scatter boxes, and heuristic signatures for breadth-first layers of them.

For relational programs, and for goals whose abstraction has no refinement. Boxes with equal heuristic signatures, i.e.
with items alike in class and in the classes of related items, are treated as duplicates, and only the first is kept.
This finds solutions quickly but proves nothing about those it does not find.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from typing import Any

from lilgym_mp.programs.values import BoxView
from lilgym_mp.programs.words import Word
from lilgym_mp.scene import Box, Colour, Shape, Size
from lilgym_mp.solver.abstraction import ItemClasses
from lilgym_mp.solver.box_editor import BoxEditor, EditedBox
from lilgym_mp.solver.layered_search import Budget
from lilgym_mp.solver.program_features import ProgramFeatures

FOOTPRINTS = tuple((shape, size) for size in Size for shape in Shape)  # small ones first: they leave most space


@dataclass
class SuccessorGenerator:
    """Generates the edits of a box, with one colour for each item class that an addition can have."""

    _editor: BoxEditor
    _classes: ItemClasses
    _budget: Budget

    def __call__(self, box: Box) -> Iterator[EditedBox]:
        """Every removal, then every addition. Raises BudgetExhaustedError."""
        yield from self.removals(box)
        yield from self.additions(box)

    def removals(self, box: Box) -> Iterator[EditedBox]:
        """The box without each of its items in turn; each tried costs one of the budget."""
        for position in range(len(box.items)):
            self._budget.spend()
            edited = self._editor.removed(box, position)
            if edited is not None:
                yield edited

    def additions(self, box: Box) -> Iterator[EditedBox]:
        """The box with each item added at each corner; each tried costs one of the budget."""
        for shape, size in FOOTPRINTS:
            for x, y in self._editor.corners:
                self._budget.spend()
                edited = self._editor.added(box, (shape, Colour.YELLOW, size), x, y)
                if edited is not None:
                    yield from self._recoloured(edited)

    def _recoloured(self, edited: EditedBox) -> Iterator[EditedBox]:
        """The addition in one colour for each item class; geometry does not depend on colour."""
        edit, box = edited
        *others, item = box.items
        seen: set[int] = set()
        for colour in Colour:
            recoloured = item._replace(colour=colour)
            item_class = self._classes.of(recoloured)
            if item_class not in seen:
                seen.add(item_class)
                yield EditedBox(edit._replace(colour=colour), Box((*others, recoloured)))


def heuristic_signature(features: ProgramFeatures, classes: ItemClasses, box: Box) -> Hashable:
    """The likely inputs of a program from a box: each item's class and size, and the classes of related items."""
    view = BoxView(box)
    item_classes = [classes.of(item) for item in box.items]
    sizes = [item.size for item in box.items]  # they limit what can be placed next to an item
    relations = [_relation_values(word, view, item_classes) for word in features.relations]
    rows = list(zip(item_classes, sizes, *relations, strict=True))
    is_tower = features.tests_towers and view.is_tower()
    return (is_tower, tuple(rows if features.order_matters else sorted(rows)))


def _relation_values(word: Word, box: BoxView, item_classes: list[int]) -> list[Any]:
    """For each item: the classes of the items that the word relates to it, or its value; else the item's position."""
    types = [parameter.type.name for parameter in word.parameters]
    if types == ["item", "item"]:
        related = [[y for y in box if y is not x and word.function(x, y)] for x in box]
    elif word.depends_on == "box" and word.parameters[0].type.mapped:
        related = map(word.function, box)
    elif word.depends_on == "box" and types == ["item"]:
        return list(map(word.function, box))
    else:
        return [(item.left, item.top) for item in box]
    return [tuple(sorted(item_classes[other.index] for other in others)) for others in related]
