"""Breadth-first search over scenes, layer by layer, built from the breadth-first layers of each box.

An edit changes one box and boxes do not affect each other, so the distance to a scene is the sum of the distances of
its boxes. This holds for Tower, for Scatter and for abstract boxes; all three use this search.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from operator import attrgetter
from typing import Any, Generic, TypeVar

from lilgym_mp.scene import Box, Item, Scene

Element = TypeVar("Element")
Edit = TypeVar("Edit")


class BudgetExhaustedError(Exception):
    """The search has used its whole budget."""


class Budget:
    """Counts the scenes that a search examines, against a limit."""

    def __init__(self, scenes: int) -> None:
        self.left = scenes
        self.spent = 0
        self.layers_paid: dict[object, int] = {}  # number of layers paid for, by what they are layers of

    def spend(self, scenes: int = 1) -> None:
        """Raises BudgetExhaustedError, spending nothing, when fewer than `scenes` are left."""
        if self.left < scenes:
            raise BudgetExhaustedError
        self.left -= scenes
        self.spent += scenes

    def spend_each(self, count: int, cost: int) -> None:
        """Spends `cost` for each of `count`, as far as it lasts. Raises BudgetExhaustedError if not for all."""
        affordable = min(count, self.left // cost)
        self.spend(affordable * cost)
        if affordable < count:
            raise BudgetExhaustedError


class LazyList(Generic[Element]):
    """An iterable that caches the elements of an iterator, which it consumes only on demand."""

    def __init__(self, source: Iterator[Element]) -> None:
        self._elements: Any = itertools.tee(source, 1)[0]

    def __iter__(self) -> Iterator[Element]:
        return self._elements.__copy__()  # another iterator over the same elements


class Layers(Generic[Edit]):
    """The breadth-first layers of one box, extended on demand, with a shortest path to each box in them.

    Of several boxes with equal signatures, by default only equal boxes, the first is kept.
    """

    def __init__(
        self,
        start: Box,
        successors: Callable[[Box], Iterator[tuple[Edit, Box]]],
        signature: Callable[[Box], Hashable] = attrgetter("items"),
    ) -> None:
        self._successors = successors
        self._signature = signature
        self._layers: list[Iterable[Box]] = [(start,)]
        self._paths: dict[tuple[Item, ...], tuple[Edit, ...]] = {start.items: ()}
        self._seen = {signature(start)}

    def layer(self, edits: int) -> Iterable[Box]:
        """The boxes exactly `edits` edits away. The result can be iterated repeatedly."""
        while len(self._layers) <= edits:
            self._layers.append(LazyList(self._next_layer(self._layers[-1])))
        return self._layers[edits]

    def path(self, box: Box) -> tuple[Edit, ...]:
        """The edits that lead to a box of the layers."""
        return self._paths[box.items]

    def _next_layer(self, boxes: Iterable[Box]) -> Iterator[Box]:
        for box in boxes:
            path = self._paths[box.items]
            for edit, after in self._successors(box):
                signature = self._signature(after)
                if signature not in self._seen:
                    self._seen.add(signature)
                    self._paths[after.items] = (*path, edit)
                    yield after


def goals_at(
    edits: int, layers: Sequence[Layers[Any]], is_goal: Callable[[Scene], bool], budget: Budget
) -> Iterator[Scene]:
    """Every scene exactly `edits` edits away that is a goal. Raises BudgetExhaustedError."""
    left_layers, middle_layers, right_layers = layers
    for left_edits in range(edits + 1):
        lefts = left_layers.layer(left_edits)
        for middle_edits in range(edits - left_edits + 1):
            middles = middle_layers.layer(middle_edits)
            rights = right_layers.layer(edits - left_edits - middle_edits)
            for left in lefts:
                for middle in middles:
                    for right in rights:
                        budget.spend()
                        scene = Scene((left, middle, right))
                        if is_goal(scene):
                            yield scene
