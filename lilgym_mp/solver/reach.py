"""What can be reached, as faces: for each box which faces it can have after how many edits.

A scene's truth hangs on the faces of its boxes, and its distance is the sum of theirs. So the nearest goals are found
among a handful of faces, whatever the number of boxes that have them.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Box, Scene
from lilgym_mp.solver.faces import BoxFaces
from lilgym_mp.solver.search import BoxLayers, Budget

KEPT_PROGRAMS = 512  # of which, or of collections of which, what was found out is kept
MOST_TRIPLES = 200_000  # of faces, of which the truth is kept, a collection of programs

Split = tuple[int, int, int]  # edits by box
Triple = tuple[int, int, int]  # the number of a face by box


class FaceReach:
    """The faces that one box can come to have."""

    def __init__(self, layers: BoxLayers, faces: BoxFaces, box_cost: int) -> None:
        self._layers = layers
        self._faces = faces
        self._box_cost = box_cost
        self._levels: list[dict[int, list[Box]]] = []
        self._seen: set[int] = set()

    def level(self, edits: int, budget: Budget) -> Mapping[int, Sequence[Box]]:
        """The faces that take that many edits at least, each with every box that has it after as many.

        Raises BudgetSpentError.
        """
        while len(self._levels) <= edits:
            self._levels.append(self._new_level(len(self._levels), budget))
        return self._levels[edits]

    def _new_level(self, edits: int, budget: Budget) -> dict[int, list[Box]]:
        found: dict[int, list[Box]] = {}
        for box in self._layers.layer(edits):
            budget.spend(self._box_cost)
            number = self._faces.number(box)
            if number not in self._seen:
                found.setdefault(number, []).append(box)
        self._seen |= found.keys()
        return found


class SeenBy:
    """What some programs see of scenes, kept for all scenes that they are asked about."""

    def __init__(self, programs: tuple[str, ...]) -> None:
        self.faces = BoxFaces(programs)
        self._programs = [(compile_program(program), 1 << number) for number, program in enumerate(programs)]
        self._truths: dict[Triple, int] = {}
        self._reaches: dict[Hashable, FaceReach] = {}
        self.kept: dict[str, Any] = {}  # what an appearance must keep as long as the reaches

    def reach(self, key: Hashable, layers: BoxLayers, box_cost: int = 1) -> FaceReach:
        """The reach of a box that `key` tells from all others.

        `box_cost`: how many threes of faces can be looked at in the time that a new box takes.
        """
        found = self._reaches.get(key)
        if found is None:
            found = self._reaches[key] = FaceReach(layers, self.faces, box_cost)
        return found

    def truths(self, triple: Triple) -> int:
        """Which of the programs are true of boxes with these faces, the first as the lowest bit."""
        found = self._truths.get(triple)
        if found is None:
            if len(self._truths) >= MOST_TRIPLES:
                self._truths.clear()
            found = self._truths[triple] = self._new_truths(triple)
        return found

    def _new_truths(self, triple: Triple) -> int:
        first, second, third = triple
        if self.faces.told and not first <= second <= third:  # boxes that are asked one by one may change places
            first, second, third = sorted(triple)
            return self.truths((first, second, third))
        boxes = self.faces.boxes
        return self.truths_of(Scene((boxes[first], boxes[second], boxes[third])))

    def truths_of(self, scene: Scene) -> int:
        """`truths` for a scene."""
        return sum([bit for program, bit in self._programs if program(scene)])


@lru_cache(maxsize=KEPT_PROGRAMS)
def seen_by(programs: tuple[str, ...]) -> SeenBy:
    return SeenBy(programs)


def triples_after(edits: int, reaches: Sequence[FaceReach], budget: Budget) -> Iterator[tuple[Split, Triple]]:
    """Every three faces that take exactly that many edits at least. Raises BudgetSpentError."""
    left, middle, right = reaches
    for left_edits in range(edits + 1):
        lefts = left.level(left_edits, budget)
        if not lefts:
            continue
        for middle_edits in range(edits - left_edits + 1):
            middles = middle.level(middle_edits, budget)
            rights = right.level(edits - left_edits - middle_edits, budget) if middles else ()
            split = (left_edits, middle_edits, edits - left_edits - middle_edits)
            budget.spend(len(lefts) * len(middles) * len(rights))
            for first in lefts:
                for second in middles:
                    for third in rights:
                        yield split, (first, second, third)
