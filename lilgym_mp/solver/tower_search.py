"""Exact search for Tower.

A box has only 121 states, the possible stacks of blocks, so the breadth-first layers of each are computed once and
serve every task. Only the program remains to be evaluated, scene by scene, nearest first.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache, partial

from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, Box, Colour, Item, Scene
from lilgym_mp.scene.actions import STOP, AddBlock, RemoveBlock
from lilgym_mp.scene.appearances import PlacementRules, Tower
from lilgym_mp.solver.class_search import (
    NO_ACTIONS,
    ClassSpace,
    FirstActions,
    Reachability,
    class_space,
    program_goal,
)
from lilgym_mp.solver.layered_search import Budget, BudgetExhaustedError, Layers, goals_at
from lilgym_mp.solver.solution import ActionSet, Solution, not_found, solved, unsolvable

BoxEdit = AddBlock | RemoveBlock

MAX_EXHAUSTIVE_EDITS = 4  # edits; up to this distance, evaluating every scene is faster than finding box classes

_EDITS = (*(AddBlock(0, colour) for colour in Colour), RemoveBlock(0))
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


class _TowerBox:
    """The `BoxReachability` of Tower, where every path is feasible."""

    def __init__(self, index: int, layers: Layers[BoxEdit], space: ClassSpace) -> None:
        self._index = index
        self._layers = layers
        self.reachable = space.reachable(layers)

    def refinement(self, edits: int, box_class: int, budget: Budget) -> Sequence[BoxEdit]:
        after, *_ = self.reachable.layer(edits, budget)[box_class]
        return _path(self._layers, after, self._index)

    def failure(self, edits: int, box_class: int, budget: Budget) -> None:
        return None

    def first_actions(self, edits: int, box_class: int, budget: Budget) -> FirstActions:
        if not edits:
            return NO_ACTIONS
        goals = self.reachable.layer(edits, budget)[box_class]
        return FirstActions(frozenset(_ACTIONS[self._index][self._layers.path(goal)[0]] for goal in goals))


class TowerSearch:
    """Shortest solutions, always proven."""

    is_exhaustive = True  # every action is tried
    budget = 2_000_000  # scenes examined by default; more than there are

    def __init__(self, tower: Tower, dynamics: Dynamics) -> None:
        self._tower = tower
        self._placement = dynamics.rules.placement

    def solve(self, state: State, max_edits: int, budget: Budget) -> Solution:
        """A shortest solution with at most `max_edits` edits before STOP."""
        edits = 0
        try:
            for edits in range(max_edits + 1):
                find = self._solution_by_class if edits > MAX_EXHAUSTIVE_EDITS else self._solution_by_scene
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
        return None if goal is None else [*itertools.chain(*map(_path, layers, goal.boxes, range(BOX_COUNT)))]

    def _solution_by_class(self, state: State, edits: int, budget: Budget) -> list[BoxEdit] | None:
        """The same by box classes, where boxes are interchangeable."""
        goal = program_goal(state.task)
        if goal is None or not class_space(goal[0]).classes.separable:
            return self._solution_by_scene(state, edits, budget)
        reachability = self.reachability(*goal, state.scene)
        nearest = next(reachability.goals_at(edits, budget), None)
        return None if nearest is None else reachability.edits_to(nearest, budget)

    def first_actions_by_trial(self, state: State, max_edits: int, budget: Budget) -> ActionSet:
        """Every first action of a shortest solution; boxes may be edited in any order."""
        layers = self._layers(state.scene)
        with suppress(BudgetExhaustedError):
            for edits in range(1, max_edits + 1):
                goals = goals_at(edits, layers, state.task.solved_by, budget)
                paths = (path for goal in goals for path in map(_path, layers, goal.boxes, range(BOX_COUNT)))
                found = {self._tower.encode(path[0]) for path in paths if path}
                if found:
                    return ActionSet(tuple(sorted(found)), complete=True, steps=edits + 1)
            return ActionSet((), complete=True, steps=0)
        return ActionSet((), complete=False, steps=0)

    def is_abstractable(self, program: str) -> bool:
        """Whether the classes of reachable boxes determine the program's value."""
        return True

    def reachability(self, programs: tuple[str, ...], targets: int, scene: Scene) -> Reachability:
        """What can be reached from the scene, with the scenes that give the programs the targets as goals."""
        space = class_space(programs)
        return Reachability(space, targets, [_TowerBox(*each, space) for each in enumerate(self._layers(scene))])

    def _layers(self, scene: Scene) -> list[Layers[BoxEdit]]:
        return [stack_layers(self._tower, self._placement, box.items) for box in scene.boxes]


def _path(layers: Layers[BoxEdit], after: Box, index: int) -> tuple[BoxEdit, ...]:
    """The edits of box `index` that lead to `after`."""
    return tuple(edit._replace(box=index) for edit in layers.path(after))
