"""Breadth-first search over scenes, layer by layer, built from the breadth-first layers of each box.

An edit changes one box and boxes do not affect each other, so the distance to a scene is the sum of the distances of
its boxes. This holds for Tower, for Scatter and for abstract boxes; all three use this search.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Generic, Protocol, TypeVar

from lilgym_mp.scene import Box, Scene

Element = TypeVar("Element")


class BoxLayers(Protocol):
    """The breadth-first layers of one box."""

    def layer(self, edits: int) -> Iterable[Box]:
        """The boxes exactly `edits` edits away. The result can be iterated repeatedly."""
        ...


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
        self._source = source
        self._cached: list[Element] = []

    def __iter__(self) -> Iterator[Element]:
        for index in itertools.count():
            if index == len(self._cached):
                try:
                    self._cached.append(next(self._source))
                except StopIteration:
                    return
            yield self._cached[index]


def scenes_at(edits: int, layers: Sequence[BoxLayers]) -> Iterator[Scene]:
    """Every scene exactly `edits` edits away."""
    left_layers, middle_layers, right_layers = layers
    for left_edits in range(edits + 1):
        lefts = left_layers.layer(left_edits)
        for middle_edits in range(edits - left_edits + 1):
            middles = middle_layers.layer(middle_edits)
            rights = right_layers.layer(edits - left_edits - middle_edits)
            for left in lefts:
                for middle in middles:
                    for right in rights:
                        yield Scene((left, middle, right))


def goals_at(
    edits: int, layers: Sequence[BoxLayers], is_goal: Callable[[Scene], bool], budget: Budget
) -> Iterator[Scene]:
    """The goals among `scenes_at(edits, layers)`. Raises BudgetExhaustedError."""
    for scene in scenes_at(edits, layers):
        budget.spend()
        if is_goal(scene):
            yield scene
