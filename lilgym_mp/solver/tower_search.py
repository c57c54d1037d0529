"""Exact search for Tower.

A box has only 121 states, the possible stacks of blocks, so the breadth-first layers of each are computed once and
serve every task. Only the program remains to be evaluated, scene by scene, nearest first.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import cache, partial

from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_COUNT, Box, Colour, Item, Scene
from lilgym_mp.scene.actions import STOP, AddBlock, RemoveBlock
from lilgym_mp.scene.appearances import PlacementRules, Tower
from lilgym_mp.solver.class_search import ClassSpace, ClassTriple, EditCounts, class_space
from lilgym_mp.solver.goals import has_program_goal, programs_of, target_bits
from lilgym_mp.solver.layered_search import Budget, BudgetExhaustedError, Layers, goals_at
from lilgym_mp.solver.solution import ActionSet, Solution, not_found, solved, unsolvable

BoxEdit = AddBlock | RemoveBlock

MAX_EXHAUSTIVE_EDITS = 4  # edits; up to this distance, evaluating every scene is faster than finding box classes

_EDITS: tuple[BoxEdit, ...] = (*(AddBlock(0, colour) for colour in Colour), RemoveBlock(0))
_ACTIONS = [{edit: Tower().encode(edit._replace(box=index)) for edit in _EDITS} for index in range(BOX_COUNT)]  # by box


@cache
def stack_layers(tower: Tower, placement: PlacementRules, stack: tuple[Item, ...]) -> Layers[BoxEdit]:
    """The layers of a stack, with paths as edits of box 0; paths are unique, as edits connect stacks in a tree."""
    start, *_ = tower.check_scene(Scene((Box(stack), Box(), Box()))).boxes
    return Layers(start, partial(_successors, tower, placement))


def _successors(tower: Tower, placement: PlacementRules, box: Box) -> Iterator[tuple[BoxEdit, Box]]:
    scene = Scene((box, Box(), Box()))
    for edit in _EDITS:
        after, invalid = tower.apply(scene, edit, placement)
        if invalid is None:
            yield edit, after.boxes[0]


class TowerReachability:
    """The box classes that can be reached from a scene, and how."""

    def __init__(self, layers: Sequence[Layers[BoxEdit]], space: ClassSpace) -> None:
        self._layers = layers
        self.reachable = list(map(space.reachable, layers))

    def edits_to(self, edit_counts: EditCounts, triple: ClassTriple, budget: Budget) -> list[BoxEdit]:
        """Edits that lead to boxes of these classes, `edit_counts` in each box. Raises BudgetExhaustedError."""
        found: list[BoxEdit] = []
        for index, (edits, box_class) in enumerate(zip(edit_counts, triple, strict=True)):
            after, *_ = self.reachable[index].layer(edits, budget)[box_class]
            found.extend(_path(self._layers[index], after, index))
        return found

    def first_actions(self, goals: Sequence[Collection[tuple[int, int]]], budget: Budget) -> set[int]:
        """The first actions on shortest paths to goals: by box, pairs of edits and class."""
        found: set[int] = set()
        for index, (layers, reachable) in enumerate(zip(self._layers, self.reachable, strict=True)):
            ends = [reachable.layer(edits, budget)[box_class] for edits, box_class in goals[index] if edits]
            found.update(_ACTIONS[index][layers.path(box)[0]] for boxes in ends for box in boxes)
        return found


class TowerSearch:
    """Shortest solutions, always proven."""

    budget = 2_000_000  # scenes examined by default; more than there are

    def __init__(self, tower: Tower, dynamics: Dynamics) -> None:
        self._tower = tower
        self._placement = dynamics.rules.placement

    def solve(self, state: State, max_edits: int, budget: Budget) -> Solution:
        edits = 0
        try:
            for edits in range(max_edits + 1):
                by_class = edits > MAX_EXHAUSTIVE_EDITS and _is_separable(state.task)
                find = self._solution_by_class if by_class else self._solution_by_scene
                actions = find(state, edits, budget)
                if actions is not None:
                    return solved((*actions, STOP), edits, budget)
        except BudgetExhaustedError:
            return not_found(edits, budget)
        return unsolvable(f"no scene within {max_edits} edits has that value", max_edits + 1, budget)

    def _solution_by_scene(self, state: State, edits: int, budget: Budget) -> list[BoxEdit] | None:
        """A solution with that many edits, given that no solution has fewer."""
        layers = self._layers(state.scene)
        goal = next(goals_at(edits, layers, state.task.solved_by, budget), None)
        return None if goal is None else [edit for path in _paths(layers, goal) for edit in path]

    def _solution_by_class(self, state: State, edits: int, budget: Budget) -> list[BoxEdit] | None:
        reachability = self.reachability(programs_of(state.task), state.scene)
        goal = next(self._class_goals(state, reachability, edits, budget), None)
        return None if goal is None else reachability.edits_to(*goal, budget)

    def _class_goals(
        self, state: State, reachability: TowerReachability, edits: int, budget: Budget
    ) -> Iterator[tuple[EditCounts, ClassTriple]]:
        space = class_space(programs_of(state.task))
        return space.goals_at(edits, reachability.reachable, target_bits(state.task), budget)

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
        reachability = self.reachability(programs_of(state.task), state.scene)
        goals: list[set[tuple[int, int]]] = [set() for _ in range(BOX_COUNT)]  # by box
        for edit_counts, triple in self._class_goals(state, reachability, edits, budget):
            for box_goals, goal in zip(goals, zip(edit_counts, triple, strict=True), strict=True):
                box_goals.add(goal)
        return reachability.first_actions(goals, budget)

    def _first_actions_by_scene(self, state: State, edits: int, budget: Budget) -> set[int]:
        layers = self._layers(state.scene)
        goals = goals_at(edits, layers, state.task.solved_by, budget)
        return {self._tower.encode(path[0]) for goal in goals for path in _paths(layers, goal) if path}

    def is_abstractable(self, program: str) -> bool:
        """Whether the classes of reachable boxes determine the program's value."""
        return True

    def reachability(self, programs: tuple[str, ...], scene: Scene) -> TowerReachability:
        return TowerReachability(self._layers(scene), class_space(programs))

    def _layers(self, scene: Scene) -> list[Layers[BoxEdit]]:
        return [stack_layers(self._tower, self._placement, box.items) for box in scene.boxes]


def _paths(layers: list[Layers[BoxEdit]], goal: Scene) -> list[tuple[BoxEdit, ...]]:
    """The edits of each box that lead to the goal."""
    return [_path(layers[index], goal.boxes[index], index) for index in range(BOX_COUNT)]


def _path(layers: Layers[BoxEdit], after: Box, index: int) -> tuple[BoxEdit, ...]:
    """The edits of box `index` that lead to `after`."""
    return tuple(edit._replace(box=index) for edit in layers.path(after))


def _is_separable(task: Task) -> bool:
    return has_program_goal(task) and class_space(programs_of(task)).classes.separable
