"""Tower solved exactly: a box has so few stacks that what each can become is listed once, whatever the task.

Boxes do not affect each other, so a scene's distance is the sum of its boxes' distances, and only the truth of the
statement is left to find out, scene by scene, nearest first.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

from lilgym_mp.actions import STOP, Action, AddBlock, RemoveBlock
from lilgym_mp.appearances import PlacementRules, Tower
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, Box, Colour, Item, Scene
from lilgym_mp.solver.faces import Face, face_of
from lilgym_mp.solver.search import BoxLayers, Budget, BudgetSpentError, goals_after
from lilgym_mp.solver.solution import ActionSet, Solution, judged_by_program, not_found, solved, unsolvable

BoxEdit = AddBlock | RemoveBlock

MOST_NEAR_EDITS = 4  # up to which looking at every scene is quicker than telling faces

_EDITS: tuple[BoxEdit, ...] = (*(AddBlock(0, colour) for colour in Colour), RemoveBlock(0))


@dataclass(frozen=True, slots=True)
class StackLayers:
    """What a stack can become, by the number of edits, and the edits to it."""

    layers: tuple[tuple[Box, ...], ...]
    paths: dict[tuple[Item, ...], tuple[BoxEdit, ...]]  # by the items of what it becomes; edits of box 0

    def layer(self, edits: int) -> Sequence[Box]:
        return self.layers[edits] if edits < len(self.layers) else ()

    def path(self, after: Box, index: int) -> tuple[BoxEdit, ...]:
        """The edits that make the stack `after` when it stands in box `index`: stacks form a tree, so the only way."""
        return tuple(edit._replace(box=index) for edit in self.paths[after.items])


@cache
def stack_layers(tower: Tower, placement: PlacementRules, stack: tuple[Item, ...]) -> StackLayers:
    """What the stack of these items can become."""
    start, *_ = tower.check_scene(Scene((Box(stack), Box(), Box()))).boxes
    layers: list[tuple[Box, ...]] = [(start,)]
    paths: dict[tuple[Item, ...], tuple[BoxEdit, ...]] = {stack: ()}
    while layers[-1]:
        found: list[Box] = []
        for box in layers[-1]:
            for edit, after in _edited(tower, placement, box):
                if after.items not in paths:
                    paths[after.items] = (*paths[box.items], edit)
                    found.append(after)
        layers.append(tuple(found))
    return StackLayers(tuple(layers[:-1]), paths)


def _edited(tower: Tower, placement: PlacementRules, box: Box) -> Iterator[tuple[BoxEdit, Box]]:
    scene = Scene((box, Box(), Box()))
    for edit in _EDITS:
        after, invalid = tower.apply(scene, edit, placement)
        if invalid is None:
            yield edit, after.boxes[0]


class FaceLayers:
    """Of what a stack can become, by the number of edits, the first with each face."""

    def __init__(self, layers: StackLayers, face: Face) -> None:
        seen: set[Hashable] = set()
        self._layers = [tuple(self._new(boxes, face, seen)) for boxes in layers.layers]

    def _new(self, boxes: Sequence[Box], face: Face, seen: set[Hashable]) -> Iterator[Box]:
        for box in boxes:
            value = face(box)
            if value not in seen:
                seen.add(value)
                yield box

    def layer(self, edits: int) -> Sequence[Box]:
        return self._layers[edits] if edits < len(self._layers) else ()


class TowerSearch:
    """Shortest solutions by looking at every scene, nearest first."""

    budget = 2_000_000  # more than there are scenes

    def __init__(self, tower: Tower, dynamics: Dynamics) -> None:
        self._tower = tower
        self._placement = dynamics.rules.placement

    def solve(self, state: State, most_edits: int, budget: Budget) -> Solution:
        layers = self._layers(state.scene)
        edits = 0
        try:
            for edits, goals in self._goals(state, layers, most_edits, budget):
                for goal in goals:
                    actions = (edit for path in _paths(layers, goal) for edit in path)
                    return solved((*actions, STOP), edits, budget)
        except BudgetSpentError:
            return not_found(edits, budget)
        return unsolvable(f"no scene within {most_edits} edits has that value", most_edits + 1, budget)

    def _goals(
        self, state: State, layers: list[StackLayers], most_edits: int, budget: Budget
    ) -> Iterator[tuple[int, Iterator[Scene]]]:
        """By number of edits, goals: all that are near; of those further off one of each kind, where kinds are told."""
        is_goal = state.task.solved_by
        for edits in range(min(most_edits, MOST_NEAR_EDITS) + 1):
            yield edits, goals_after(edits, layers, is_goal, budget)
        further = range(MOST_NEAR_EDITS + 1, most_edits + 1)
        face = face_of(state.task.program) if further and judged_by_program(state.task) else None
        kinds: Sequence[BoxLayers] = layers if face is None else [FaceLayers(layer, face) for layer in layers]
        for edits in further:
            yield edits, goals_after(edits, kinds, is_goal, budget)

    def first_actions(self, state: State, most_edits: int, budget: Budget) -> ActionSet:
        """Every first action of a shortest solution; boxes may be edited in any order."""
        layers = self._layers(state.scene)
        found: set[Action] = set()
        edits = 0
        complete = True
        try:
            for edits in range(most_edits + 1):
                for goal in goals_after(edits, layers, state.task.solved_by, budget):
                    found.update(path[0] for path in _paths(layers, goal) if path)
                    if not edits:
                        found.add(STOP)
                if found:
                    break
        except BudgetSpentError:
            complete = False
        numbers = tuple(sorted(map(self._tower.encode, found)))
        return ActionSet(numbers, complete=complete, steps=edits + 1 if found else 0)

    def _layers(self, scene: Scene) -> list[StackLayers]:
        return [stack_layers(self._tower, self._placement, box.items) for box in scene.boxes]


def _paths(layers: list[StackLayers], goal: Scene) -> list[tuple[BoxEdit, ...]]:
    """By box, the edits to the goal."""
    return [layers[index].path(goal.boxes[index], index) for index in range(BOX_COUNT)]
