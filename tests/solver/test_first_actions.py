"""Sets of optimal first actions agree with exhaustive trial."""

import random

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.scene import Scene
from lilgym_mp.solver import Solver
from tests.scenes import scene_of
from tests.solver.tasks import after_random_edits, check_optimal_actions, mdp, optimal_by_trial, task

CONFIGURATIONS = [(appearance, start) for appearance in ("tower", "scatter") for start in ("scratch", "flipit")]


@pytest.mark.parametrize(("appearance", "start"), CONFIGURATIONS)
def test_sets__agree_with_exhaustive_trial(appearance, start):
    dynamics = mdp(appearance)
    solver = Solver(dynamics)
    max_edits, stride = (3, 9) if appearance == "tower" else (1, 11)
    checked = 0
    for index, one in enumerate(load_tasks("builtin", appearance, start, "train")[: 12 * stride : stride]):
        state = after_random_edits(dynamics, dynamics.start(one), index % 4, index)
        edits, firsts = optimal_by_trial(dynamics, state, max_edits)
        found = solver.optimal_actions(state)
        if edits is None:
            assert found.steps == 0 or found.steps > max_edits + 1, one.id
        else:
            checked += 1
            assert (set(found.actions), found.complete, found.steps) == (firsts, True, edits + 1), one.id
    assert checked > 4


@pytest.mark.parametrize("program", ["Any({})", "NOT(All({}))"])
def test_sets__are_right_where_the_order_of_boxes_decides_whether_the_program_fails(program):
    dynamics = mdp("tower")
    state = dynamics.start(task(program.format("all_boxes, lambda b: is_blue(unique(b))")))
    check_optimal_actions(dynamics, state, 2)


NO_WALL = "count(filter_obj(all_items, lambda x: is_black(x) and not is_touching_wall(x))) == 2"
CROWDED_BOX = "exist(filter_obj(all_boxes, lambda b: count(filter_obj(b, is_blue)) >= 3))"
CORNERS = "count(filter_obj(all_items, lambda x: is_small(x) and is_touching_corner(x))) == 2"
FEWER = "exist(filter_obj(all_boxes, lambda b: count(b) == 1)) and count(all_items) >= 5"
FULL = scene_of(
    "circle 0,0 large blue; square 40,0 large black; triangle 0,40 large; square 70,70 large blue"
    "| circle 20,20 small blue; square 60,60 black; circle 61,5 blue | triangle 70,70 large blue; square 0,80"
)


@pytest.mark.parametrize("program", [NO_WALL, CROWDED_BOX, CORNERS, FEWER])
@pytest.mark.parametrize(("rules", "start"), [("release", Scene.empty()), ("paper", FULL)], ids=["empty", "full"])
def test_sets__of_longer_solutions_hold_the_actions_that_reduce_the_distance(rules, program, start):
    """On a sample of the actions in the set and of the others."""
    dynamics = mdp("scatter", rules)
    solver = Solver(dynamics)
    state = dynamics.start(task(program, start, target=not task(program).truth(start)))
    found = solver.optimal_actions(state)
    assert found.steps == solver.solve_from(state).steps
    legal = set(dynamics.legal_mask(state).nonzero()[0].tolist()) - {0}
    rng = random.Random(0)
    for actions in (sorted(found.actions), sorted(legal - set(found.actions))):
        for action in rng.sample(actions, min(4, len(actions))):
            after = dynamics.step(state, dynamics.appearance.decode(action)).state
            shorter = solver.solve_from(after).steps == found.steps - 1
            assert shorter == (action in found.actions) or (shorter and not found.complete), action


@pytest.mark.parametrize("appearance", ["tower", "scatter"])
def test_sets__depend_on_the_edits_left(appearance):
    dynamics = mdp(appearance)
    solver = Solver(dynamics)
    far = dynamics.start(task("count(all_items) == 5"))
    assert solver.optimal_actions(far).steps == 6
    assert solver.optimal_actions(far._replace(steps=6)).steps == 6
    found = solver.optimal_actions(far._replace(steps=7))
    assert (found.actions, found.complete, found.steps) == ((), True, 0)
