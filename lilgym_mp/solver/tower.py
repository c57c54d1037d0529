"""Tower solved exactly: a box has so few stacks that what each can become is listed once, whatever the task.

Boxes do not affect each other, so a scene's distance is the sum of its boxes' distances, and only the truth of the
statement is left to find out, scene by scene, nearest first.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

from lilgym_mp.actions import STOP, Action, AddBlock, RemoveBlock
from lilgym_mp.appearances import PlacementRules, Tower
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, Box, Colour, Item, Scene
from lilgym_mp.solver.faces import BoxFaces
from lilgym_mp.solver.joint import judged_by_program, programs_of, truths_wanted
from lilgym_mp.solver.reach import SeenBy, Split, Triple, seen_by, triples_after
from lilgym_mp.solver.search import BoxLayers, Budget, BudgetSpentError, goals_after
from lilgym_mp.solver.solution import ActionSet, Solution, not_found, solved, unsolvable

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

    def first(self, after: Box) -> BoxEdit:
        """The first edit, of box 0, on the way to `after`, which must be another stack."""
        return self.paths[after.items][0]

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

    def __init__(self, layers: StackLayers, faces: BoxFaces) -> None:
        seen: set[int] = set()
        self._layers = [tuple(self._new(boxes, faces, seen)) for boxes in layers.layers]

    def _new(self, boxes: Sequence[Box], faces: BoxFaces, seen: set[int]) -> Iterator[Box]:
        for box in boxes:
            value = faces.number(box)
            if value not in seen:
                seen.add(value)
                yield box

    def layer(self, edits: int) -> Sequence[Box]:
        return self._layers[edits] if edits < len(self._layers) else ()


class ReachableStacks:
    """What the boxes of a scene can become, in the eyes of some programs."""

    def __init__(self, layers: Sequence[StackLayers], scene: Scene, seen: SeenBy) -> None:
        self._layers = layers
        self.reaches = [seen.reach(("stack", box.items), layer) for box, layer in zip(scene.boxes, layers, strict=True)]

    def edits_to(self, split: Split, triple: Triple, budget: Budget) -> list[BoxEdit]:
        """Edits after which the boxes have these faces, as many as the split says."""
        found: list[BoxEdit] = []
        for index, (edits, face) in enumerate(zip(split, triple, strict=True)):
            found.extend(self._layers[index].path(self.reaches[index].level(edits, budget)[face][0], index))
        return found

    def firsts(self, towards: Sequence[Collection[tuple[int, int]]], budget: Budget) -> set[int]:
        """The actions that begin to give boxes their faces, by box pairs of edits and face."""
        found: set[int] = set()
        for index, (layers, reach) in enumerate(zip(self._layers, self.reaches, strict=True)):
            levels = [reach.level(edits, budget)[face] for edits, face in towards[index] if edits]
            edits = {layers.first(box) for boxes in levels for box in boxes}
            found.update(_NUMBERS[index][edit] for edit in edits)
        return found


_NUMBERS = [{edit: Tower().encode(edit._replace(box=index)) for edit in _EDITS} for index in range(BOX_COUNT)]  # by box


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
        kinds: Sequence[BoxLayers] = layers
        if further and judged_by_program(state.task):
            faces = BoxFaces(programs_of(state.task))
            kinds = [FaceLayers(layer, faces) for layer in layers] if faces.told else layers
        for edits in further:
            yield edits, goals_after(edits, kinds, is_goal, budget)

    def first_actions(self, state: State, most_edits: int, budget: Budget) -> ActionSet:
        """Every first action of a shortest solution; boxes may be edited in any order."""
        if state.task.solved_by(state.scene):
            return ActionSet((self._tower.encode(STOP),), complete=True, steps=1)
        find = self._firsts_by_faces if judged_by_program(state.task) else self._firsts_by_trial
        try:
            for edits in range(1, most_edits + 1):
                found = find(state, edits, budget)
                if found:
                    return ActionSet(tuple(sorted(found)), complete=True, steps=edits + 1)
        except BudgetSpentError:
            return ActionSet((), complete=False, steps=0)
        return ActionSet((), complete=True, steps=0)

    def _firsts_by_faces(self, state: State, edits: int, budget: Budget) -> set[int]:
        """The first actions of solutions with that many edits, if there are none with fewer."""
        programs, wanted = programs_of(state.task), truths_wanted(state.task)
        seen = seen_by(programs)
        reachable = self.reachable(programs, state.scene)
        begun: list[set[tuple[int, int]]] = [set() for _ in range(BOX_COUNT)]
        for split, triple in triples_after(edits, reachable.reaches, budget):
            if seen.truths(triple) == wanted:
                for firsts, towards in zip(begun, zip(split, triple, strict=True), strict=True):
                    firsts.add(towards)
        return reachable.firsts(begun, budget)

    def _firsts_by_trial(self, state: State, edits: int, budget: Budget) -> set[int]:
        layers = self._layers(state.scene)
        goals = goals_after(edits, layers, state.task.solved_by, budget)
        return {self._tower.encode(path[0]) for goal in goals for path in _paths(layers, goal) if path}

    def by_faces(self, program: str) -> bool:
        return True

    def reachable(self, programs: tuple[str, ...], scene: Scene) -> ReachableStacks:
        return ReachableStacks(self._layers(scene), scene, seen_by(programs))

    def after(self, scene: Scene, edits: Sequence[Action]) -> Scene:
        """The scene after edits that are all valid."""
        for edit in edits:
            scene = self._tower.apply(scene, edit, self._placement).scene
        return scene

    def _layers(self, scene: Scene) -> list[StackLayers]:
        return [stack_layers(self._tower, self._placement, box.items) for box in scene.boxes]


def _paths(layers: list[StackLayers], goal: Scene) -> list[tuple[BoxEdit, ...]]:
    """By box, the edits to the goal."""
    return [layers[index].path(goal.boxes[index], index) for index in range(BOX_COUNT)]
