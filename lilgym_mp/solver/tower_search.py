"""Exact search for Tower.

A box has only 121 states, the possible stacks of blocks, so the breadth-first layers of each are computed once and
serve every task. Only the program remains to be evaluated, scene by scene, nearest first.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

from lilgym_mp.actions import STOP, Action, AddBlock, RemoveBlock
from lilgym_mp.appearances import PlacementRules, Tower
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, Box, Colour, Item, Scene
from lilgym_mp.solver.box_classes import BoxClasses
from lilgym_mp.solver.class_search import ClassSpace, ClassTriple, EditCounts, class_space, class_triples_at
from lilgym_mp.solver.goals import has_program_goal, programs_of, target_bits
from lilgym_mp.solver.layered_search import BoxLayers, Budget, BudgetExhaustedError, goals_at
from lilgym_mp.solver.solution import ActionSet, Solution, not_found, solved, unsolvable

BoxEdit = AddBlock | RemoveBlock

MAX_EXHAUSTIVE_EDITS = 4  # edits; up to this distance, evaluating every scene is faster than finding box classes

_EDITS: tuple[BoxEdit, ...] = (*(AddBlock(0, colour) for colour in Colour), RemoveBlock(0))
_ACTIONS = [{edit: Tower().encode(edit._replace(box=index)) for edit in _EDITS} for index in range(BOX_COUNT)]  # by box


@dataclass(frozen=True, slots=True)
class StackLayers:
    """The breadth-first layers of a stack, and the paths to the stacks in them."""

    layers: tuple[tuple[Box, ...], ...]
    paths: dict[tuple[Item, ...], tuple[BoxEdit, ...]]  # keyed by the items of the stack; edits of box 0

    def layer(self, edits: int) -> Sequence[Box]:
        return self.layers[edits] if edits < len(self.layers) else ()

    def first_edit(self, after: Box) -> BoxEdit:
        """The first edit, of box 0, on the path to `after`, which must differ from the start."""
        return self.paths[after.items][0]

    def path(self, after: Box, index: int) -> tuple[BoxEdit, ...]:
        """The shortest path to `after` for a stack in box `index`; it is unique, as edits connect stacks in a tree."""
        return tuple(edit._replace(box=index) for edit in self.paths[after.items])


@cache
def stack_layers(tower: Tower, placement: PlacementRules, stack: tuple[Item, ...]) -> StackLayers:
    start, *_ = tower.check_scene(Scene((Box(stack), Box(), Box()))).boxes
    layers: list[tuple[Box, ...]] = [(start,)]
    paths: dict[tuple[Item, ...], tuple[BoxEdit, ...]] = {stack: ()}
    while layers[-1]:
        found: list[Box] = []
        for box in layers[-1]:
            for edit, after in _successors(tower, placement, box):
                if after.items not in paths:
                    paths[after.items] = (*paths[box.items], edit)
                    found.append(after)
        layers.append(tuple(found))
    return StackLayers(tuple(layers[:-1]), paths)


def _successors(tower: Tower, placement: PlacementRules, box: Box) -> Iterator[tuple[BoxEdit, Box]]:
    scene = Scene((box, Box(), Box()))
    for edit in _EDITS:
        after, invalid = tower.apply(scene, edit, placement)
        if invalid is None:
            yield edit, after.boxes[0]


class ClassLayers:
    """The layers of a stack without repetitions: the first box of each class."""

    def __init__(self, layers: StackLayers, classes: BoxClasses) -> None:
        seen: set[int] = set()
        self._layers = [tuple(self._new(boxes, classes, seen)) for boxes in layers.layers]

    def _new(self, boxes: Sequence[Box], classes: BoxClasses, seen: set[int]) -> Iterator[Box]:
        for box in boxes:
            box_class = classes.of(box)
            if box_class not in seen:
                seen.add(box_class)
                yield box

    def layer(self, edits: int) -> Sequence[Box]:
        return self._layers[edits] if edits < len(self._layers) else ()


class TowerReachability:
    """The box classes that can be reached from a scene, and how."""

    def __init__(self, layers: Sequence[StackLayers], scene: Scene, space: ClassSpace) -> None:
        self._layers = layers
        boxes = zip(scene.boxes, layers, strict=True)
        self.reachable = [space.reachable(("stack", box.items), layer) for box, layer in boxes]

    def edits_to(self, edit_counts: EditCounts, triple: ClassTriple, budget: Budget) -> list[BoxEdit]:
        """Edits that lead to boxes of these classes, `edit_counts` in each box. Raises BudgetExhaustedError."""
        found: list[BoxEdit] = []
        for index, (edits, box_class) in enumerate(zip(edit_counts, triple, strict=True)):
            after, *_ = self.reachable[index].layer(edits, budget)[box_class]
            found.extend(self._layers[index].path(after, index))
        return found

    def first_actions(self, goals: Sequence[Collection[tuple[int, int]]], budget: Budget) -> set[int]:
        """The first actions on shortest paths to goals: by box, pairs of edits and class."""
        found: set[int] = set()
        for index, (layers, reachable) in enumerate(zip(self._layers, self.reachable, strict=True)):
            ends = [reachable.layer(edits, budget)[box_class] for edits, box_class in goals[index] if edits]
            found.update(_ACTIONS[index][layers.first_edit(box)] for boxes in ends for box in boxes)
        return found


class TowerSearch:
    """Shortest solutions, always proven."""

    budget = 2_000_000  # more than there are scenes

    def __init__(self, tower: Tower, dynamics: Dynamics) -> None:
        self._tower = tower
        self._placement = dynamics.rules.placement

    def solve(self, state: State, max_edits: int, budget: Budget) -> Solution:
        layers = self._layers(state.scene)
        edits = 0
        try:
            for edits, goals in self._goals(state, layers, max_edits, budget):
                for goal in goals:
                    actions = (edit for path in _paths(layers, goal) for edit in path)
                    return solved((*actions, STOP), edits, budget)
        except BudgetExhaustedError:
            return not_found(edits, budget)
        return unsolvable(f"no scene within {max_edits} edits has that value", max_edits + 1, budget)

    def _goals(
        self, state: State, layers: list[StackLayers], max_edits: int, budget: Budget
    ) -> Iterator[tuple[int, Iterator[Scene]]]:
        """Goals by distance: all near ones; farther away, one for each class triple if the programs are separable."""
        is_goal = state.task.solved_by
        for edits in range(min(max_edits, MAX_EXHAUSTIVE_EDITS) + 1):
            yield edits, goals_at(edits, layers, is_goal, budget)
        farther = range(MAX_EXHAUSTIVE_EDITS + 1, max_edits + 1)
        pruned: Sequence[BoxLayers] = layers
        if farther and has_program_goal(state.task):
            classes = BoxClasses(programs_of(state.task))
            pruned = [ClassLayers(layer, classes) for layer in layers] if classes.separable else layers
        for edits in farther:
            yield edits, goals_at(edits, pruned, is_goal, budget)

    def first_actions(self, state: State, max_edits: int, budget: Budget) -> ActionSet:
        """Every first action of a shortest solution; boxes may be edited in any order."""
        if state.task.solved_by(state.scene):
            return ActionSet((self._tower.encode(STOP),), complete=True, steps=1)
        find = self._first_actions_by_class if has_program_goal(state.task) else self._first_actions_by_scene
        try:
            for edits in range(1, max_edits + 1):
                found = find(state, edits, budget)
                if found:
                    return ActionSet(tuple(sorted(found)), complete=True, steps=edits + 1)
        except BudgetExhaustedError:
            return ActionSet((), complete=False, steps=0)
        return ActionSet((), complete=True, steps=0)

    def _first_actions_by_class(self, state: State, edits: int, budget: Budget) -> set[int]:
        """The first actions of solutions with that many edits, given that no solution has fewer."""
        programs, targets = programs_of(state.task), target_bits(state.task)
        space = class_space(programs)
        reachability = self.reachability(programs, state.scene)
        goals: list[set[tuple[int, int]]] = [set() for _ in range(BOX_COUNT)]  # by box
        for edit_counts, triple in class_triples_at(edits, reachability.reachable, budget):
            if space.truths(triple) == targets:
                for box_goals, goal in zip(goals, zip(edit_counts, triple, strict=True), strict=True):
                    box_goals.add(goal)
        return reachability.first_actions(goals, budget)

    def _first_actions_by_scene(self, state: State, edits: int, budget: Budget) -> set[int]:
        layers = self._layers(state.scene)
        goals = goals_at(edits, layers, state.task.solved_by, budget)
        return {self._tower.encode(path[0]) for goal in goals for path in _paths(layers, goal) if path}

    def is_abstractable(self, program: str) -> bool:
        return True

    def reachability(self, programs: tuple[str, ...], scene: Scene) -> TowerReachability:
        return TowerReachability(self._layers(scene), scene, class_space(programs))

    def edited(self, scene: Scene, edits: Sequence[Action]) -> Scene:
        for edit in edits:
            scene = self._tower.apply(scene, edit, self._placement).scene
        return scene

    def _layers(self, scene: Scene) -> list[StackLayers]:
        return [stack_layers(self._tower, self._placement, box.items) for box in scene.boxes]


def _paths(layers: list[StackLayers], goal: Scene) -> list[tuple[BoxEdit, ...]]:
    """The edits of each box that lead to the goal."""
    return [layers[index].path(goal.boxes[index], index) for index in range(BOX_COUNT)]
