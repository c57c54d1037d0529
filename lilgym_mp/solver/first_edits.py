"""Every first edit of shortest solutions in Scatter, for programs that ask of items only what each is by itself.

Sketches tell which classes of items may be added or removed first. Which actions do that is read from tables of all
edits of a box. What is left to do after it must still find room: in another box it does, if it does now; in the same
box it does, if it does now in a place that the first edit does not touch, and else it is tried.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from functools import partial
from typing import NamedTuple

import numpy as np

from lilgym_mp.actions import AddItem
from lilgym_mp.appearances import PlacementRules, Scatter
from lilgym_mp.appearances.placement import LARGEST_MOVE, SNAP_REACH
from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.scene import (
    BOX_COUNT,
    BOX_PITCH,
    FOOTPRINT_COUNT,
    FOOTPRINT_SIDES,
    SIZE_PIXELS,
    Box,
    Colour,
    Item,
    Scene,
    Shape,
    Size,
)
from lilgym_mp.solver.box_edits import (
    Additions,
    addable_item_types,
    addition_numbers,
    additions,
    frame_of,
    removal_numbers,
    removed,
)
from lilgym_mp.solver.placements import BoxEdit, Placements
from lilgym_mp.solver.reach import FaceReach, SeenBy, Split, Triple
from lilgym_mp.solver.room import Refuted, room_for
from lilgym_mp.solver.search import Budget
from lilgym_mp.solver.sketches import Sketch, SketchEdit, Sketcher, SketchLayers

MOST_GOALS = 40  # sketches of goals, at one number of edits, for which room is sought
MOST_RESTS = 8  # ways to go on after a first edit that are looked at
MOST_TRIED = 60  # first edits of a kind after which room for the rest is sought one by one
SKETCH_COST = 5  # threes of faces that can be looked at in the time that a new sketch takes
CLEARANCE = SNAP_REACH + LARGEST_MOVE + 1  # pixels between items over which neither changes where the other goes

Rest = tuple[SketchEdit, ...]  # what is left to do to a box's sketch, in any order


class Firsts(NamedTuple):
    """Actions that begin to give a box a face."""

    actions: frozenset[int]
    complete: bool  # whether all that do so are among them


NO_FIRSTS = Firsts(frozenset(), complete=True)


class ReachableSketches:
    """What the boxes of a scene can become, in the eyes of some programs, and whether there is room for it."""

    def __init__(
        self,
        scatter: Scatter,
        rules: PlacementRules,
        placements: Sequence[Placements],
        scene: Scene,
        sketcher: Sketcher,
        seen: SeenBy,
    ) -> None:
        self._new_box = partial(_ReachableBox, scatter, rules, placements, sketcher, seen)
        self._boxes = [self._new_box(index, scene.boxes[index]) for index in range(BOX_COUNT)]

    @property
    def reaches(self) -> list[FaceReach]:
        return [box.reach for box in self._boxes]

    def with_box(self, index: int, box: Box) -> ReachableSketches:
        """The same with another box at `index`."""
        other = copy(self)
        other._boxes = [*self._boxes]
        other._boxes[index] = self._new_box(index, box)
        return other

    def some_room(self, goals: Iterable[tuple[Split, Triple]], budget: Budget) -> Refuted | None:
        """None where a box triple of the goals can be had, else whether that is proven. Raises BudgetSpentError."""
        refuted = Refuted.PROVEN
        for split, triple in goals:
            found = self._refuted(split, triple, budget)
            if found is None:
                return None
            refuted = refuted if found is Refuted.PROVEN else found
        return refuted

    def edits_to(self, split: Split, triple: Triple, budget: Budget) -> list[BoxEdit] | None:
        """Edits after which the boxes have these faces, as many as the split says; None where none were found.

        Raises BudgetSpentError.
        """
        found: list[BoxEdit] = []
        for box, edits, face in zip(self._boxes, split, triple, strict=True):
            room = box.room(edits, face, budget)
            if isinstance(room, Refuted):
                return None
            found.extend(room)
        return found

    def firsts(self, goals: Iterable[tuple[Split, Triple]], budget: Budget) -> Firsts:
        """The actions that begin ways to any of these faces. Raises BudgetSpentError."""
        actions: set[int] = set()
        complete = True
        looked_at: set[tuple[int, int, int]] = set()
        for split, triple in goals:
            refuted = self._refuted(split, triple, budget)
            complete = complete and refuted is not Refuted.OPEN
            for index, box in enumerate(self._boxes if refuted is None else ()):
                key = (index, split[index], triple[index])
                if key not in looked_at:
                    looked_at.add(key)
                    found = box.firsts(split[index], triple[index], budget)
                    actions |= found.actions
                    complete = complete and found.complete
        return Firsts(frozenset(actions), complete)

    def _refuted(self, split: Split, triple: Triple, budget: Budget) -> Refuted | None:
        """None where there is room in each box for what gives it its face."""
        refuted = [box.refuted(split[index], triple[index], budget) for index, box in enumerate(self._boxes)]
        return Refuted.PROVEN if Refuted.PROVEN in refuted else next(filter(None, refuted), None)


class _ReachableBox:
    """One box of the scene."""

    def __init__(
        self,
        scatter: Scatter,
        rules: PlacementRules,
        placements: Sequence[Placements],
        sketcher: Sketcher,
        seen: SeenBy,
        index: int,
        box: Box,
    ) -> None:
        self._scatter = scatter
        self._rules = rules
        self._placements = placements[index]
        self._index = index
        self._box = box
        self._sketcher = sketcher
        self._numbers = [sketcher.classes.of(item) for item in box.items]
        sketch = sketcher.arranged(self._numbers)
        self._layers: SketchLayers = sketcher.layers(box)
        self.reach: FaceReach = seen.reach(("sketch", sketch), self._layers, SKETCH_COST)
        self._rooms: dict[tuple[int, int], tuple[BoxEdit, ...] | Refuted] = {}  # by edits and face
        self._firsts: dict[tuple[int, int], Firsts] = {}

    # Room

    def room(self, edits: int, face: int, budget: Budget) -> tuple[BoxEdit, ...] | Refuted:
        """Edits, as many as that, which give the box the face."""
        if not edits:
            return ()
        found = self._rooms.get((edits, face))
        if found is None:
            found = self._rooms[edits, face] = self._new_room(self._goals(edits, face, budget), budget)
        return found

    def _goals(self, edits: int, face: int, budget: Budget) -> Sequence[Box]:
        return self.reach.level(edits, budget)[face]

    def _new_room(self, goals: Sequence[Box], budget: Budget) -> tuple[BoxEdit, ...] | Refuted:
        refuted = Refuted.PROVEN if len(goals) <= MOST_GOALS else Refuted.OPEN
        for goal in goals[:MOST_GOALS]:
            room = self._seek(self._layers.path(goal), self._box, budget)
            if not isinstance(room, Refuted):
                return room
            refuted = refuted if room is Refuted.PROVEN else room
        return refuted

    def _seek(self, edits: Rest, box: Box, budget: Budget, *, reverse: bool = False) -> tuple[BoxEdit, ...] | Refuted:
        return room_for(edits, box, self._placements, self._sketcher, budget, reverse=reverse)

    def refuted(self, edits: int, face: int, budget: Budget) -> Refuted | None:
        """None where there are edits, as many as that, which give the box the face."""
        if edits == 1:
            return None if self.firsts(edits, face, budget).actions else Refuted.PROVEN
        room = self.room(edits, face, budget)
        return room if isinstance(room, Refuted) else None

    # First actions

    def firsts(self, edits: int, face: int, budget: Budget) -> Firsts:
        """The actions that begin to give the box the face in that many edits. Raises BudgetSpentError."""
        if not edits:
            return NO_FIRSTS
        found = self._firsts.get((edits, face))
        if found is None:
            found = self._firsts[edits, face] = self._new_firsts(edits, face, budget)
        return found

    def _new_firsts(self, edits: int, face: int, budget: Budget) -> Firsts:
        goals = self._goals(edits, face, budget)
        if edits == 1:
            wanted = {self._sketcher.sketch(goal) for goal in goals}
            return Firsts(frozenset(self._single_edits(wanted)), complete=True)
        return self._first_of_many(goals, budget)

    def _all_additions(self) -> Additions:
        return additions(self._scatter, self._rules, frame_of(self._rules, self._index), self._box.items)

    def _single_edits(self, wanted: set[Sketch]) -> Iterator[int]:
        """The actions that make one of these sketches."""
        arranged, numbers = self._sketcher.arranged, self._numbers
        for number in range(len(self._sketcher.classes)):
            if arranged((*numbers, number)) in wanted:
                yield from self._actions(self._additions(number), adds=True)
        for position in range(len(numbers)):
            if arranged((*numbers[:position], *numbers[position + 1 :])) in wanted:
                yield from self._actions(self._removals(position), adds=False)

    def _additions(self, item_class: int) -> Int64Array:
        """The additions, counted in this box, of an item of the class."""
        classes = self._sketcher.classes
        if classes.by_item_type is not None:
            item_types = addable_item_types(self._scatter, self._rules, self._box.items)
            return (item_types & (classes.by_item_type == item_class)).ravel().nonzero()[0]
        samples = self._all_additions().samples
        return ((classes.by_sample[samples] == item_class) & (samples >= 0)).nonzero()[0]

    def _removals(self, position: int) -> Int64Array:
        """The cells, counted in this box, from which the item at that position is removed."""
        return (removed(self._scatter.cell, self._box.items) == position).nonzero()[0]

    def _actions(self, numbers: Int64Array, *, adds: bool) -> list[int]:
        """The actions' numbers, from numbers counted in this box."""
        number = addition_numbers if adds else removal_numbers
        found: list[int] = number(self._scatter, self._index, numbers).tolist()
        return found

    def _first_of_many(self, goals: Sequence[Box], budget: Budget) -> Firsts:
        if self._sketcher.ordered:
            return Firsts(frozenset(), complete=False)
        rests: dict[SketchEdit, list[Rest]] = {}
        for goal in goals[:MOST_GOALS]:
            path = [edit if edit.adds else SketchEdit(edit.item_class, 0) for edit in self._layers.path(goal)]
            for edit in dict.fromkeys(path):
                rest = Counter(path)
                rest[edit] -= 1
                rests.setdefault(edit, []).append(tuple(rest.elements()))
        actions: set[int] = set()
        complete = len(goals) <= MOST_GOALS
        for edit, after in rests.items():
            begin = self._begun_by_adding if edit.adds else self._begun_by_removing
            found = begin(edit.item_class, after, budget)
            actions |= found.actions
            complete = complete and found.complete
        return Firsts(frozenset(actions), complete)

    def _begun_by_removing(self, item_class: int, rests: Sequence[Rest], budget: Budget) -> Firsts:
        """The removals of an item of the class after which there is room for one of `rests`."""
        actions: set[int] = set()
        complete = True
        for position, number in enumerate(self._numbers):
            if number == item_class:
                after = self._after(rests, self._box.without(position), budget)
                complete = complete and after is not Refuted.OPEN
                if not isinstance(after, Refuted):
                    actions.update(self._actions(self._removals(position), adds=False))
        return Firsts(frozenset(actions), complete)

    def _begun_by_adding(self, item_class: int, rests: Sequence[Rest], budget: Budget) -> Firsts:
        """The additions of an item of the class after which there is room for one of `rests`.

        Additions of one kind in one cell differ by colour alone, which geometry does not see.
        """
        edits = self._all_additions()
        chosen = np.zeros(edits.samples.shape, np.bool_)
        chosen[self._additions(item_class)] = True
        by_item_type = chosen.reshape(-1, len(Shape), len(Colour), len(Size))
        cells, footprints = by_item_type.any(axis=2).reshape(-1, FOOTPRINT_COUNT).nonzero()
        left, top = edits.x[cells, footprints], edits.y[cells, footprints]
        sides = np.array(FOOTPRINT_SIDES)[footprints]
        squares = np.stack([left, top, left + sides, top + sides], axis=1)
        certain, complete = self._with_room(_Begun(squares, footprints), rests, budget)
        fine = np.zeros((len(edits.valid), FOOTPRINT_COUNT), np.bool_)
        fine[cells[certain], footprints[certain]] = True
        by_item_type &= fine.reshape(-1, len(Shape), 1, len(Size))
        return Firsts(frozenset(self._actions(chosen.nonzero()[0], adds=True)), complete)

    def _with_room(self, begun: _Begun, rests: Sequence[Rest], budget: Budget) -> tuple[BoolArray, bool]:
        """Which additions leave room for one of `rests`, and whether that is known of all."""
        fine = np.zeros(len(begun.footprints), np.bool_)
        for rest in rests[:MOST_RESTS]:
            for reverse in (False, True):
                way = self._seek(rest, self._box, budget, reverse=reverse)
                if not isinstance(way, Refuted) and not fine.all():
                    fine |= self._missed_by(begun.squares, way)
        complete = True
        for tried, index in enumerate((~fine).nonzero()[0].tolist()):
            if tried == MOST_TRIED:
                return fine, False
            if not fine[index]:
                way = self._after(rests, self._box.with_item(begun.item(index)), budget)
                if isinstance(way, Refuted):
                    complete = complete and way is Refuted.PROVEN
                    continue
                fine[index] = True
                if self._missed_by(begun.squares[index : index + 1], way)[0]:  # it is there without the addition
                    fine |= self._missed_by(begun.squares, way)
        return fine, complete

    def _after(self, rests: Sequence[Rest], box: Box, budget: Budget) -> tuple[BoxEdit, ...] | Refuted:
        """Edits of `box` that do one of `rests` to its sketch."""
        refuted = Refuted.PROVEN if len(rests) <= MOST_RESTS else Refuted.OPEN
        for rest in rests[:MOST_RESTS]:
            way = self._seek(rest, box, budget)
            if not isinstance(way, Refuted):
                return way
            refuted = refuted if way is Refuted.PROVEN else way
        return refuted

    def _missed_by(self, squares: Int64Array, way: Sequence[BoxEdit]) -> BoolArray:
        """Which items in these (n, 4) squares change nothing about what the edits do, whether they are there or not."""
        touched = np.array([self._touched(edit) for edit in way])
        left, top, right, bottom = (squares[:, None, side] for side in range(4))
        meets = (left < touched[:, 2]) & (right > touched[:, 0]) & (top < touched[:, 3]) & (bottom > touched[:, 1])
        missed: BoolArray = np.logical_not(meets.any(axis=1))
        return missed

    def _touched(self, edit: BoxEdit) -> tuple[int, int, int, int]:
        """The square, as left, top, right and bottom, that items must stay out of to change nothing about the edit."""
        width, height = self._scatter.cell
        x, y = edit.column * width - self._index * BOX_PITCH, edit.row * height
        if isinstance(edit, AddItem):
            side = SIZE_PIXELS[edit.size]
            return x - CLEARANCE, y - CLEARANCE, x + width + side + CLEARANCE, y + height + side + CLEARANCE
        return x, y, x + width, y + height


class _Begun(NamedTuple):
    """Additions to a box, whatever their colours."""

    squares: Int64Array  # (n, 4) left, top, right, bottom; the latter two exclusive
    footprints: Int64Array  # (n,)

    def item(self, index: int) -> Item:
        """One of them, in some colour."""
        left, top, *_ = self.squares[index].tolist()
        shape, size = divmod(int(self.footprints[index]), len(Size))
        return Item(left, top, Shape(shape), Colour.YELLOW, Size(size))
