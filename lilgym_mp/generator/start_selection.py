"""Start scenes for a statement, and whether its truth can change within the horizon, from a stock of scenes."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice
from typing import NamedTuple

from lilgym_mp.generator.scene_sampling import EDIT_LIMIT, chains
from lilgym_mp.scene import Scene

Truth = Callable[[Scene], bool]
Number = int  # of a scene in a stock


class StartScene(NamedTuple):
    """A start scene, the statement's truth in it, and by how many edits that is known to change."""

    scene: Scene
    label: bool
    edits: int


class NumberedFamily(NamedTuple):
    """As `scenes.Family`, by the numbers of the scenes."""

    parent: Number
    children: tuple[Number, ...]
    edits: int | None


@dataclass(frozen=True)
class ScenePool:
    """Many chains of scenes of one appearance."""

    scenes: tuple[Scene, ...]
    chains: tuple[tuple[NumberedFamily, ...], ...]

    @classmethod
    def sample(cls, appearance: str, rng: random.Random, size: int) -> ScenePool:
        """A stock of `size` chains."""
        numbers: dict[Scene, Number] = {}
        numbered = tuple(
            tuple(
                NumberedFamily(
                    numbers.setdefault(family.parent, len(numbers)),
                    tuple(numbers.setdefault(child, len(numbers)) for child in family.children),
                    family.edits,
                )
                for family in chain.families
            )
            for chain in islice(chains(appearance, rng), size)
        )
        return cls(tuple(numbers), numbered)


class TruthTable:
    """A statement's truth in every scene of a stock, by number."""

    def __init__(self, stock: ScenePool, truth: Truth) -> None:
        self.stock = stock
        self.values = [truth(scene) for scene in stock.scenes]

    @property
    def share(self) -> float:
        """The share of scenes where the statement is true."""
        return sum(self.values) / len(self.values)

    def edits_from_empty(self) -> int | None:
        """The fewest edits after which a scene grown from the empty one makes it true; an upper bound."""
        best: int | None = None
        for chain in self.stock.chains:
            for parent, children, edits in chain:
                if edits is None or (best is not None and edits >= best):
                    break
                if self.values[parent]:
                    best = edits
                elif any(self.values[child] for child in children) and edits < EDIT_LIMIT:
                    best = edits + 1
        return best

    def neighbours(self, rng: random.Random) -> Iterator[tuple[StartScene, StartScene]]:
        """Pairs of scenes one edit apart of which the statement tells one from the other, in random order."""
        return self._pairs(rng, 1, lambda family: [(family.parent, child) for child in family.children])

    def twins(self, rng: random.Random) -> Iterator[tuple[StartScene, StartScene]]:
        """The same for scenes that are equally full and differ in one item: two edits apart."""
        return self._pairs(rng, 2, lambda family: list(combinations(family.children, 2)))

    def _pairs(
        self, rng: random.Random, edits: int, couples: Callable[[NumberedFamily], Sequence[tuple[Number, Number]]]
    ) -> Iterator[tuple[StartScene, StartScene]]:
        for chain in self._shuffled_chains(rng):
            for family in chain:
                for one, other in couples(family):
                    if self.values[one] != self.values[other] and any(self.stock.scenes[one].items()):
                        yield self._start(one, edits), self._start(other, edits)

    def _start(self, number: Number, edits: int) -> StartScene:
        return StartScene(self.stock.scenes[number], self.values[number], edits)

    def _shuffled_chains(self, rng: random.Random) -> list[tuple[NumberedFamily, ...]]:
        return rng.sample(self.stock.chains, len(self.stock.chains))


def start_scenes(truths: TruthTable, rng: random.Random, is_clear: Truth) -> list[StartScene]:
    """A pair of neighbours and a pair of twins (or neighbours again), the true scene of each pair first.

    Only scenes that `is_clear` accepts; empty when there are not two such pairs.
    """
    chosen: list[StartScene] = []
    for source in (truths.neighbours, truths.twins, truths.neighbours):
        if len(chosen) < 4:
            chosen += next(_fresh_pairs(source(rng), chosen, is_clear), ())
    return chosen if len(chosen) == 4 else []


def _fresh_pairs(
    pairs: Iterator[tuple[StartScene, StartScene]], chosen: Sequence[StartScene], is_clear: Truth
) -> Iterator[list[StartScene]]:
    taken = {start.scene for start in chosen}
    for pair in pairs:
        if all(start.scene not in taken and is_clear(start.scene) for start in pair):
            yield sorted(pair, key=lambda start: not start.label)
