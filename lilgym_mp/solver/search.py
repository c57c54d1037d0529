"""Scenes in the order of how many edits they are away, put together from what each box can become.

An edit changes one box, so a scene is as many edits away as its boxes are together. That holds for towers, for
scattered items, and for sketches of them; this search serves all three.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Generic, Protocol, TypeVar

from lilgym_mp.scene import Box, Scene

Element = TypeVar("Element")


class BoxLayers(Protocol):
    """What one box can become."""

    def layer(self, edits: int) -> Iterable[Box]:
        """The boxes that take exactly that many edits; may be gone over again and again."""
        ...


class BudgetSpentError(Exception):
    """The search has looked at as many scenes as it may."""


class Budget:
    """How many scenes a search may still look at."""

    def __init__(self, scenes: int) -> None:
        self.scenes_left = scenes
        self.scenes_looked_at = 0

    def spend(self, scenes: int = 1) -> None:
        """Raises BudgetSpentError when none are left."""
        if self.scenes_left < scenes:
            raise BudgetSpentError
        self.scenes_left -= scenes
        self.scenes_looked_at += scenes


class Growing(Generic[Element]):
    """A sequence that is made as far as it is looked at, once."""

    def __init__(self, source: Iterator[Element]) -> None:
        self._source = source
        self._made: list[Element] = []

    def __iter__(self) -> Iterator[Element]:
        for index in itertools.count():
            if index == len(self._made):
                try:
                    self._made.append(next(self._source))
                except StopIteration:
                    return
            yield self._made[index]


def scenes_after(edits: int, layers: Sequence[BoxLayers]) -> Iterator[Scene]:
    """Every scene that takes exactly that many edits."""
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


def goals_after(
    edits: int, layers: Sequence[BoxLayers], is_goal: Callable[[Scene], bool], budget: Budget
) -> Iterator[Scene]:
    """Those of `scenes_after` that are goals. Raises BudgetSpentError."""
    for scene in scenes_after(edits, layers):
        budget.spend()
        if is_goal(scene):
            yield scene
