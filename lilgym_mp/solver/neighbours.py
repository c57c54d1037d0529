"""Scattered boxes by the number of edits, one of each kind that a program is likely to tell apart.

For programs that ask what items are to each other, and for goals whose sketch found no room. Boxes alike in their
items' classes and in who is related to whom are taken for equal, and the first of them stands for all: quick, and
good at finding solutions, but no proof that there are none.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from typing import Any

from lilgym_mp.programs import box_functions
from lilgym_mp.programs.values import BoxView
from lilgym_mp.programs.words import Word
from lilgym_mp.scene import Box, Colour, Item, Shape, Size
from lilgym_mp.solver.aspects import Aspects
from lilgym_mp.solver.placements import BoxEdit, Placed, Placements
from lilgym_mp.solver.search import Budget, Growing
from lilgym_mp.solver.sketches import ItemClasses

KINDS = tuple((shape, size) for size in Size for shape in Shape)  # small ones first: they leave most room


class Neighbours:
    """Edits of boxes that may matter to a program: of colours that it cannot tell apart, one."""

    def __init__(self, placements: Placements, classes: ItemClasses, budget: Budget) -> None:
        self._placements = placements
        self._classes = classes
        self._budget = budget

    def __call__(self, box: Box) -> Iterator[Placed]:
        """Every removal, then every addition that is tried. Raises BudgetSpentError."""
        yield from self.removals(box)
        yield from self.additions(box)

    def removals(self, box: Box) -> Iterator[Placed]:
        for position in range(len(box.items)):
            self._budget.spend()
            placed = self._placements.removed(box, position)
            if placed is not None:
                yield placed

    def additions(self, box: Box) -> Iterator[Placed]:
        corners = self._placements.corners(box)
        for shape, size in KINDS:
            for x, y in corners:
                self._budget.spend()
                placed = self._placements.added(box, (shape, Colour.YELLOW, size), x, y)
                if placed is not None:
                    yield from self._in_each_colour(placed)

    def _in_each_colour(self, placed: Placed) -> Iterator[Placed]:
        """The addition in one colour for each class; geometry does not depend on it."""
        edit, box = placed
        *others, item = box.items
        seen: set[int] = set()
        for colour in Colour:
            painted = item._replace(colour=colour)
            number = self._classes.of(painted)
            if number not in seen:
                seen.add(number)
                yield Placed(edit._replace(colour=colour), Box((*others, painted)))


class NeighbourLayers:
    """What a box can become by some kind of edits, by their number: one box for each profile."""

    def __init__(
        self, box: Box, neighbours: Callable[[Box], Iterator[Placed]], profile: Callable[[Box], Hashable]
    ) -> None:
        self._neighbours = neighbours
        self._profile = profile
        self._layers: list[Iterable[Box]] = [[box]]
        self._paths: dict[tuple[Item, ...], tuple[BoxEdit, ...]] = {box.items: ()}
        self._profiles: set[Hashable] = {profile(box)}

    def layer(self, edits: int) -> Iterable[Box]:
        while len(self._layers) <= edits:
            self._layers.append(Growing(self._next_layer(self._layers[-1])))
        return self._layers[edits]

    def path(self, box: Box) -> tuple[BoxEdit, ...]:
        return self._paths[box.items]

    def _next_layer(self, boxes: Iterable[Box]) -> Iterator[Box]:
        for box in boxes:
            path = self._paths[box.items]
            for edit, after in self._neighbours(box):
                profile = self._profile(after)
                if profile not in self._profiles:
                    self._profiles.add(profile)
                    self._paths[after.items] = (*path, edit)
                    yield after


class Profile:
    """What a program is likely to see of a box: each item's class and size, and the classes of those related to it."""

    def __init__(self, aspects: Aspects, classes: ItemClasses) -> None:
        self._aspects = aspects
        self._classes = classes

    def __call__(self, box: Box) -> Hashable:
        numbers = [self._classes.of(item) for item in box.items]
        sizes = [item.size for item in box.items]  # what can lie beside an item hangs on it
        try:
            related = [_related(word, box, numbers) for word in self._aspects.relations]
        except box_functions.FallbackError:  # more items than relations are looked at for
            return box.items
        rows = list(zip(numbers, sizes, *related, strict=True))
        tower = self._aspects.towers and box_functions.is_tower(box)
        return (tower, tuple(rows if self._aspects.ordered else sorted(rows)))


def _related(word: Word, box: Box, numbers: list[int]) -> list[Any]:
    """By item, what the word says of it, in terms of classes; its place where the word is of another kind."""
    if word.depends_on == "box" and word.parameters[0].type.mapped:
        masks = box_functions.vectorised_relation(word)(box)
        return [tuple(sorted(_chosen(numbers, masks[position]))) for position in range(len(numbers))]
    kinds = [parameter.type.name for parameter in word.parameters]
    if word.depends_on == "box" and kinds == ["item"]:
        mask = box_functions.vectorised_test(word, ())(box)
        return [mask >> position & 1 for position in range(len(numbers))]
    if kinds == ["item", "item"]:
        return _pairs(word, box, numbers)
    return [(item.x, item.y) for item in box.items]


def _chosen(numbers: list[int], mask: int) -> list[int]:
    return [number for position, number in enumerate(numbers) if mask >> position & 1]


def _pairs(word: Word, box: Box, numbers: list[int]) -> list[Any]:
    """By item, the classes of the others for which a truth about two items holds."""
    members = BoxView(box).members
    return [tuple(sorted(numbers[y.index] for y in members if y is not x and word.function(x, y))) for x in members]
