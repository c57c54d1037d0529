"""Exact search for Tower.

A box has only 121 states, the possible stacks of blocks, so the breadth-first layers of each are computed once and
serve every task. Only the goal remains to be evaluated, nearest first: in each scene, then for each class triple.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from functools import cache, partial

from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.programs.task import Goal
from lilgym_mp.scene import BOX_COUNT, Box, Colour, Item, Scene
from lilgym_mp.scene.actions import STOP, AddBlock, RemoveBlock
from lilgym_mp.scene.appearances import PlacementRules, Tower
from lilgym_mp.solver.class_search import NO_ACTIONS, ClassSpace, FirstActions, Reachability, class_space
from lilgym_mp.solver.layered_search import Budget, BudgetExhaustedError, Layers, goals_at
from lilgym_mp.solver.solution import ActionSet, Solution, not_found, solved

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


class _TowerBox:
    """The `BoxReachability` of Tower, where every path is feasible."""

    def __init__(self, index: int, layers: Layers[BoxEdit], space: ClassSpace) -> None:
        self._index, self._layers = index, layers
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

    def solve(self, goal: Goal, scene: Scene, max_edits: int, budget: Budget) -> Solution:
        edits, layers = 0, self._layers(scene)
        try:
            for edits in range(min(max_edits, MAX_EXHAUSTIVE_EDITS) + 1):
                nearest = next(goals_at(edits, layers, goal.reached_in, budget), None)
                if nearest is not None:
                    paths = map(_path, layers, nearest.boxes, range(BOX_COUNT))
                    return solved((*itertools.chain(*paths), STOP), edits, budget)
        except BudgetExhaustedError:
            return not_found(edits, budget)
        return self.reachability(goal, scene).solution(max_edits, budget, least_edits=edits + 1)

    def first_actions_by_trial(self, goal: Goal, scene: Scene, max_edits: int, budget: Budget) -> ActionSet:
        """None, since the classes of reachable boxes give them within the budget."""
        return ActionSet((), complete=False, steps=0)

    def reachability(self, goal: Goal, scene: Scene) -> Reachability:
        space = class_space(goal)
        return Reachability(space, [_TowerBox(*each, space) for each in enumerate(self._layers(scene))])

    def _layers(self, scene: Scene) -> list[Layers[BoxEdit]]:
        return [stack_layers(self._tower, self._placement, box.items) for box in scene.boxes]


def _path(layers: Layers[BoxEdit], after: Box, index: int) -> list[BoxEdit]:
    """The edits of box `index` that lead to `after`."""
    return [edit._replace(box=index) for edit in layers.path(after)]
