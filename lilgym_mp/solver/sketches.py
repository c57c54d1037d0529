"""Scenes without geometry: boxes as the classes of their items under a program's questions.

Every edit of a scene is one of its sketch, so a sketch is never further from a goal than the scene itself; and a
program that is not relational has the same truth in both. The search over sketches therefore says how many edits
are needed at least, and which; `placements` then look for room.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from lilgym_mp.arrays import Int64Array
from lilgym_mp.scene import FOOTPRINT_COUNT, Box, Colour, Item, Shape, Size
from lilgym_mp.solver.aspects import Aspects, Question
from lilgym_mp.solver.item_samples import every_item, sample_number
from lilgym_mp.solver.placements import ItemType

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
        numbers, firsts = _classes(aspects.questions)
        self.by_sample = numbers  # (1323,) the class of each sample
        self._by_sample: list[int] = numbers.tolist()
        self.representatives = [every_item()[first] for first in firsts]
        self.shares: list[int] = np.bincount(numbers).tolist()  # by class: how many of all placements belong to it
        self.item_types = _one_colour_per_footprint(numbers, len(firsts))  # by class

    @cached_property
    def by_item_type(self) -> Int64Array | None:
        """(27,) by look, as actions number them, the class of items of it; None where that hangs on their place."""
        places = self.by_sample.reshape(len(Size), -1, len(Shape), len(Colour))
        if (places != places[:, :1]).any():
            return None
        return places[:, 0].transpose(1, 2, 0).ravel()

    def __len__(self) -> int:
        return len(self.representatives)

    def of(self, item: Item) -> int:
        """The number of the item's class."""
        return self._by_sample[sample_number(item)]


def _classes(questions: Sequence[Question]) -> tuple[Int64Array, list[int]]:
    """The class of each sample, and the first sample of each class; classes are numbered as they come."""
    answers = np.zeros(len(every_item()), np.int64)
    for question in questions:
        _, answers = np.unique(answers * len(every_item()) + question.codes, return_inverse=True)
    _, firsts, classes = np.unique(answers, return_index=True, return_inverse=True)
    order = np.argsort(firsts)
    return np.argsort(order)[classes], firsts[order].tolist()


def _one_colour_per_footprint(classes: Int64Array, count: int) -> list[tuple[ItemType, ...]]:
    """By class: the looks that items of it can have, one colour a kind, small ones first."""
    _, firsts = np.unique(classes * FOOTPRINT_COUNT + _footprints(), return_index=True)
    item_types: list[list[ItemType]] = [[] for _ in range(count)]
    chosen: list[int] = firsts.tolist()
    for item, number in sorted([(every_item()[first], int(classes[first])) for first in chosen], key=_size):
        item_types[number].append((item.shape, item.colour, item.size))
    return [tuple(found) for found in item_types]


def _size(pair: tuple[Item, int]) -> tuple[int, int]:
    return pair[0].size, -pair[0].shape  # a triangle leaves more room than the other shapes of its size


@cache
def _footprints() -> Int64Array:
    """The kind of each sample."""
    return np.array([item.footprint for item in every_item()])


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
