"""Scenes without geometry: boxes as the classes of their items under a program's questions.

Every edit of a scene is one of its sketch, so a sketch is never further from a goal than the scene itself; and a
program that is not relational has the same truth in both. The search over sketches therefore says how many edits
are needed at least, and which; `placements` then look for room.
"""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Sequence
from functools import cache
from typing import NamedTuple

from lilgym_mp.programs.functions.items import MARGIN, WIDE_MARGIN
from lilgym_mp.scene import BOX_SIDE, Box, Colour, Item, Shape, Size
from lilgym_mp.solver.aspects import Aspects
from lilgym_mp.solver.placements import Look

Sketch = tuple[int, ...]  # the class of each item; sorted unless order matters


class SketchEdit(NamedTuple):
    """Add an item of a class, or remove the item at a position of the sketch."""

    item_class: int
    position: int | None  # None: add

    @property
    def adds(self) -> bool:
        return self.position is None


class ItemClasses:
    """The classes that a program's questions sort items into, and one item of each."""

    def __init__(self, aspects: Aspects) -> None:
        self._questions = aspects.questions
        self._numbers: dict[Hashable, int] = {}
        self._known: dict[Item, int] = {}
        self.representatives: list[Item] = []
        self.looks: list[tuple[Look, ...]] = []  # by class: looks that items of it can have, one colour a kind
        self.shares: list[int] = []  # by class: how many of all placements belong to it
        self._sort_every_item()

    def _sort_every_item(self) -> None:
        every = every_item()
        answers = list(zip(*(map(ask, every) for ask in self._questions), strict=True)) or [()] * len(every)
        members: dict[Hashable, list[Item]] = {}
        for item, answer in zip(every, answers, strict=True):
            members.setdefault(answer, []).append(item)
        for answer, items in members.items():
            self._number(answer, items)

    def _number(self, answer: Hashable, items: Sequence[Item]) -> int:
        kinds = {(item.shape, item.size): (item.shape, item.colour, item.size) for item in reversed(items)}
        number = self._numbers[answer] = len(self.representatives)
        self.representatives.append(items[0])
        self.looks.append(tuple(sorted(kinds.values(), key=lambda look: look[2])))
        self.shares.append(len(items))
        return number

    def __len__(self) -> int:
        return len(self.representatives)

    def of(self, item: Item) -> int:
        """The number of the item's class."""
        number = self._known.get(item)
        if number is None:
            answer = tuple(ask(item) for ask in self._questions)
            number = self._numbers.get(answer)
            if number is None:
                number = self._number(answer, [item])
            self._known[item] = number
        return number


@cache
def every_item() -> tuple[Item, ...]:
    """One item for each look and each way to lie to the walls: touching, within either margin, or in the open."""
    items: list[Item] = []
    for size in Size:
        last = BOX_SIDE - size.pixels
        near = (0, MARGIN, WIDE_MARGIN)
        places = (last // 2, *near, *(last - distance for distance in near))
        looks = itertools.product(places, places, Shape, Colour)
        items.extend(Item(x, y, shape, colour, size) for x, y, shape, colour in looks)
    return tuple(items)


class Sketcher:
    """Makes sketches, and scenes that stand for them."""

    def __init__(self, aspects: Aspects) -> None:
        self.aspects = aspects
        self.classes = ItemClasses(aspects)
        self.ordered = aspects.ordered
        self._boxes: dict[Sketch, Box] = {}
        self._layers: dict[Sketch, SketchLayers] = {}

    def sketch(self, box: Box) -> Sketch:
        return self.arranged([self.classes.of(item) for item in box.items])

    def arranged(self, numbers: Sequence[int]) -> Sketch:
        return tuple(numbers if self.ordered else sorted(numbers))

    def box(self, sketch: Sketch) -> Box:
        """A box that programs cannot tell from those with that sketch. Its items may overlap."""
        box = self._boxes.get(sketch)
        if box is None:
            representatives = self.classes.representatives
            box = self._boxes[sketch] = Box(tuple([representatives[number] for number in sketch]))
        return box

    def layers(self, box: Box) -> SketchLayers:
        sketch = self.sketch(box)
        found = self._layers.get(sketch)
        if found is None:
            found = self._layers[sketch] = SketchLayers(self, sketch)
        return found


class SketchLayers:
    """What a sketch of a box can become, by the number of edits."""

    def __init__(self, sketcher: Sketcher, start: Sketch) -> None:
        self._sketcher = sketcher
        self._layers: list[list[Sketch]] = [[start]]
        self._boxes: list[list[Box]] = [[sketcher.box(start)]]
        self._paths: dict[tuple[Item, ...], tuple[SketchEdit, ...]] = {self._boxes[0][0].items: ()}

    def layer(self, edits: int) -> Sequence[Box]:
        while len(self._layers) <= edits:
            self._add_layer()
        return self._boxes[edits]

    def path(self, box: Box) -> tuple[SketchEdit, ...]:
        """Edits that make the sketch whose box this is."""
        return self._paths[box.items]

    def _add_layer(self) -> None:
        sketcher = self._sketcher
        found: list[Sketch] = []
        for sketch in self._layers[-1]:
            path = self._paths[sketcher.box(sketch).items]
            for edit, after in self._edited(sketch):
                items = sketcher.box(after).items
                if items not in self._paths:
                    self._paths[items] = (*path, edit)
                    found.append(after)
        self._layers.append(found)
        self._boxes.append([sketcher.box(sketch) for sketch in found])

    def _edited(self, sketch: Sketch) -> list[tuple[SketchEdit, Sketch]]:
        arranged = self._sketcher.arranged
        added = [
            (SketchEdit(number, None), arranged((*sketch, number))) for number in range(len(self._sketcher.classes))
        ]
        removed = [
            (SketchEdit(number, position), sketch[:position] + sketch[position + 1 :])
            for position, number in enumerate(sketch)
        ]
        return removed + added
