"""Abstract boxes: a box without geometry, as the classes of its items under a program's item features.

Every edit of a box is also an edit of its abstraction, so abstract distances are lower bounds; and a program that is
not relational has the same value in an abstract scene as in every scene that it abstracts. A search over abstract
scenes therefore finds how few edits can suffice and which; `refinement` turns them into actions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from lilgym_mp.scene import FOOTPRINT_COUNT, Box, Item
from lilgym_mp.scene.arrays import Int64Array
from lilgym_mp.solver.box_editor import ItemType
from lilgym_mp.solver.canonical_items import canonical_index, canonical_items
from lilgym_mp.solver.layered_search import Layers
from lilgym_mp.solver.program_features import ItemFeature, ProgramFeatures

AbstractBox = tuple[int, ...]  # the class of each item; sorted unless order matters


class AbstractEdit(NamedTuple):
    """The addition of an item of a class, or the removal of the item at a position."""

    item_class: int
    position: int | None  # None: an addition

    @property
    def adds(self) -> bool:
        """Whether it adds an item; else it removes the one at `position`."""
        return self.position is None


class ItemClasses:
    """The equivalence classes of items with equal feature values."""

    def __init__(self, features: ProgramFeatures) -> None:
        classes, firsts = _classes(features.item_features)
        self.by_canonical_item = classes  # (1323,)
        self._by_canonical_item: list[int] = classes.tolist()
        self.representatives = [canonical_items()[first] for first in firsts]  # by class
        self.canonical_counts: list[int] = np.bincount(classes).tolist()  # number of canonical items of each class
        self.item_types = _one_colour_per_footprint(classes, len(firsts))  # by class

    def __len__(self) -> int:
        return len(self.representatives)

    def of(self, item: Item) -> int:
        """The item's class."""
        return self._by_canonical_item[canonical_index(item)]


def _classes(features: Sequence[ItemFeature]) -> tuple[Int64Array, list[int]]:
    """The class of each canonical item, and the first canonical item of each class, by which classes are ordered."""
    combined = np.zeros(len(canonical_items()), np.int64)
    for feature in features:
        _, combined = np.unique(combined * len(canonical_items()) + feature.values, return_inverse=True)
    _, firsts, classes = np.unique(combined, return_index=True, return_inverse=True)
    order = np.argsort(firsts)
    return np.argsort(order)[classes], firsts[order].tolist()


def _one_colour_per_footprint(classes: Int64Array, count: int) -> list[tuple[ItemType, ...]]:
    """The item types that items of each class can have, one colour for each footprint, small ones first."""
    _, firsts = np.unique(classes * FOOTPRINT_COUNT + _footprints(), return_index=True)
    item_types: list[list[ItemType]] = [[] for _ in range(count)]
    chosen: list[int] = firsts.tolist()
    pairs = [(canonical_items()[first], int(classes[first])) for first in chosen]
    # Triangles first: they leave more space than other shapes of their size.
    for item, item_class in sorted(pairs, key=lambda pair: (pair[0].size, -pair[0].shape)):
        item_types[item_class].append((item.shape, item.colour, item.size))
    return [tuple(found) for found in item_types]


@cache
def _footprints() -> Int64Array:
    """(1323,) the footprint of each canonical item."""
    return np.array([item.footprint for item in canonical_items()])


class Abstraction:
    """The abstraction of boxes under some features."""

    def __init__(self, features: ProgramFeatures) -> None:
        self.features = features
        self.classes = ItemClasses(features)
        self.order_matters = features.order_matters
        self.representative = cache(self._representative)
        self._layers = cache(self._layers_of)

    def abstract(self, box: Box) -> AbstractBox:
        """The classes of a box's items, sorted unless their order matters."""
        return self.from_classes([self.classes.of(item) for item in box.items])

    def from_classes(self, item_classes: Sequence[int]) -> AbstractBox:
        """The abstract box with items of these classes."""
        return tuple(item_classes if self.order_matters else sorted(item_classes))

    def _representative(self, abstract_box: AbstractBox) -> Box:
        """A box with this abstraction. Its items may overlap."""
        return Box(tuple([self.classes.representatives[item_class] for item_class in abstract_box]))

    def layers(self, box: Box) -> Layers[AbstractEdit]:
        """The layers of the box's abstraction as representative boxes, shared by all boxes that have it."""
        return self._layers(self.abstract(box))

    def _layers_of(self, abstract_box: AbstractBox) -> Layers[AbstractEdit]:
        return Layers(self.representative(abstract_box), self._successors)

    def _successors(self, box: Box) -> Iterator[tuple[AbstractEdit, Box]]:
        abstract_box = tuple([self.classes.of(item) for item in box.items])
        for position, item_class in enumerate(abstract_box):
            after = abstract_box[:position] + abstract_box[position + 1 :]
            yield AbstractEdit(item_class, position), self.representative(after)
        for item_class in range(len(self.classes)):
            after = self.from_classes((*abstract_box, item_class))
            yield AbstractEdit(item_class, None), self.representative(after)
