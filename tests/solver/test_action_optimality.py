"""Sets of first actions agree with exhaustive trial, and tables of edits with the rules."""

from __future__ import annotations

import random

import numpy as np
import pytest

from lilgym_mp.appearances import Scatter
from lilgym_mp.corpus import load_tasks
from lilgym_mp.rules import Dynamics, Outcome, State
from lilgym_mp.scene import Box, Scene
from lilgym_mp.solver import Solver
from lilgym_mp.solver.canonical_items import canonical_index
from lilgym_mp.solver.edit_tables import (
    addable_item_types,
    addition_actions,
    addition_table,
    frame_x_of,
    removal_actions,
    removal_table,
)
from tests.scenes import LARGE, SMALL, B, K, Y, circle, scene, square, tower, triangle
from tests.solver.tasks import edits_by_trial, mdp, task

CONFIGURATIONS = [(appearance, start) for appearance in ("tower", "scatter") for start in ("scratch", "flipit")]


def strayed(dynamics: Dynamics, state: State, edits: int, seed: int) -> State:
    """The state after `edits` random legal edits."""
    rng = random.Random(seed)
    for _ in range(edits):
        number = rng.choice(dynamics.legal_mask(state).nonzero()[0][1:].tolist())
        state = dynamics.step(state, dynamics.appearance.decode(number)).state
    return state


def least_steps(dynamics: Dynamics, state: State) -> int:
    """Steps of a shortest solution, from a new solver with an empty cache."""
    return Solver(dynamics).solve_from(state).steps


@pytest.mark.parametrize(("appearance", "start"), CONFIGURATIONS)
def test_sets__agree_with_exhaustive_trial(appearance: str, start: str):
    dynamics = mdp(appearance)
    solver = Solver(dynamics)
    max_edits, stride = (3, 9) if appearance == "tower" else (1, 11)
    checked = 0
    for number, one in enumerate(load_tasks("builtin", appearance, start, "train")[: 20 * stride : stride]):
        state = strayed(dynamics, dynamics.start(one), number % 4, number)
        edits, firsts = edits_by_trial(dynamics, state, max_edits)
        found = solver.optimal_actions(state)
        if edits is None:
            assert found.steps == 0 or found.steps > max_edits + 1, one.id
        else:
            checked += 1
            assert (set(found.actions), found.complete, found.steps) == (firsts, True, edits + 1), one.id
    assert checked > 5


NO_WALL = "count(filter_obj(all_items, lambda x: is_black(x) and not is_touching_wall(x))) == 2"
CROWDED_BOX = "exist(filter_obj(all_boxes, lambda b: count(filter_obj(b, is_blue)) >= 3))"
CORNERS = "count(filter_obj(all_items, lambda x: is_small(x) and is_touching_corner(x))) == 2"
FEWER = "exist(filter_obj(all_boxes, lambda b: count(b) == 1)) and count(all_items) >= 5"
FULL = scene(
    left=[circle(0, 0, LARGE, B), square(40, 0, LARGE, K), triangle(0, 40, LARGE, Y), square(70, 70, LARGE, B)],
    middle=[circle(20, 20, SMALL, B), square(60, 60, colour=K), circle(61, 5, colour=B)],
    right=[triangle(70, 70, LARGE, B), square(0, 80, colour=Y)],
)


@pytest.mark.parametrize("rules", ["paper", "release"])
@pytest.mark.parametrize("program", [NO_WALL, CROWDED_BOX, CORNERS, FEWER])
@pytest.mark.parametrize("start", [scene(), FULL], ids=["empty", "full"])
def test_sets__of_longer_solutions_hold_the_actions_that_reduce_the_distance(rules: str, program: str, start: Scene):
    """On a sample of the actions in the set and of the others."""
    dynamics = mdp("scatter", rules)
    state = dynamics.start(task(program, start, target=not task(program).truth(start)))
    found = Solver(dynamics).optimal_actions(state)
    assert found.steps == least_steps(dynamics, state)
    if found.steps < 2:
        return
    legal: list[int] = dynamics.legal_mask(state).nonzero()[0][1:].tolist()
    assert set(found.actions) <= set(legal)
    others = [number for number in legal if number not in found.actions]
    rng = random.Random(0)
    for number in [*rng.sample(found.actions, min(12, len(found.actions))), *rng.sample(others, min(12, len(others)))]:
        transition = dynamics.step(state, dynamics.appearance.decode(number))
        assert transition.outcome is Outcome.CONTINUES
        shorter = least_steps(dynamics, transition.state) == found.steps - 1
        assert shorter == (number in found.actions) or (shorter and not found.complete), number


@pytest.mark.parametrize("appearance", ["tower", "scatter"])
def test_optimal_sets__equal_single_calls(appearance: str):
    dynamics = mdp(appearance)
    tasks = load_tasks("builtin", appearance, "flipit", "dev")[:12]
    states = [strayed(dynamics, dynamics.start(one), seed, seed) for seed in range(3) for one in tasks]
    assert Solver(dynamics).optimal_sets(states) == [Solver(dynamics).optimal_actions(state) for state in states]


@pytest.mark.parametrize("appearance", ["tower", "scatter"])
def test_sets__depend_on_the_edits_left(appearance: str):
    dynamics = mdp(appearance)
    solver = Solver(dynamics)
    far = dynamics.start(task("count(all_items) == 5"))
    assert solver.optimal_actions(far).steps == 6
    assert solver.optimal_actions(far._replace(steps=6)).steps == 6
    found = solver.optimal_actions(far._replace(steps=7))
    assert (found.actions, found.complete, found.steps) == ((), True, 0)


@pytest.mark.parametrize("rules", ["paper", "release"])
@pytest.mark.parametrize("grid", [(19, 5), (38, 10), (19, 1)])
def test_edit_tables__agree_with_the_rules(rules: str, grid: tuple[int, int]):
    dynamics = mdp("scatter", rules, grid=grid)
    scatter, placement = dynamics.appearance, dynamics.rules.placement
    assert isinstance(scatter, Scatter)
    rng = random.Random(0)
    for seed, one in enumerate(load_tasks("builtin", "scatter", "flipit", "train")[:160:20]):
        state = strayed(dynamics, dynamics.start(one), seed % 5, seed)
        for index, box in enumerate(state.scene.boxes):
            table = addition_table(scatter, placement, frame_x_of(placement, index), box.items)
            removed = removal_table(scatter.cell, box.items)
            addable = addable_item_types(scatter, placement, box.items).ravel()
            adds = addition_actions(scatter, index, np.arange(len(addable))).tolist()
            removals = removal_actions(scatter, index, np.arange(len(removed))).tolist()
            for number in rng.sample(adds, 60):
                after, invalid = scatter.apply(state.scene, scatter.decode(number), placement)
                canonical = table.canonical[number - adds[0]]
                assert addable[number - adds[0]] == (invalid is None)
                if invalid:
                    assert canonical == -1
                else:
                    item = after.boxes[index].items[-1]
                    assert (table.item(number - adds[0]), canonical) == (item, canonical_index(item))
            for number in rng.sample(removals, 5):
                after, invalid = scatter.apply(state.scene, scatter.decode(number), placement)
                position = removed[number - removals[0]]
                assert (after.boxes[index] if not invalid else None) == (
                    box.without(int(position)) if position >= 0 else None
                )


def test_removal_table__takes_stacks_of_blocks():
    scatter = mdp("scatter").appearance
    assert isinstance(scatter, Scatter)
    box = Box(tuple(tower(B, K)))
    assert set(removal_table(scatter.cell, box.items).tolist()) == {-1, 0, 1}
