"""Tower is solved exactly."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lilgym_mp.envs.rules import Outcome, State
from lilgym_mp.scene import Scene
from lilgym_mp.solver import Solver, Status
from tests.scenes import tower_boxes
from tests.solver.tasks import mdp, optimal_by_trial, played, task

PROGRAMS = (
    "exist(filter_color(all_items, Color.BLUE))",
    "count(all_items) == 2",
    "count(filter_obj(all_boxes, lambda b: b.is_tower())) == 2",
    "All(all_boxes, lambda b: exist(filter_obj(b, lambda x: is_bottom(x) and is_black(x))))",
    "exist(filter_obj(all_items, lambda x: is_yellow(x) and exist(filter_color(get_above(x), Color.BLACK))))",
    "count(get_set_colors(all_boxes[1].all_items_in_box())) == 2",
)
SIX_BLOCKS = "count(all_items) == 6"
NEVER = "exist(filter_obj(all_items, lambda x: is_yellow(x) and is_black(x)))"


@given(st.tuples(tower_boxes, tower_boxes, tower_boxes), st.sampled_from(PROGRAMS), st.booleans())
@settings(max_examples=25)
def test_solution__is_as_short_as_exhaustive_trial_finds(boxes, program, target):
    dynamics = mdp("tower", horizon=4)
    state = dynamics.start(task(program, dynamics.appearance.check_scene(Scene(boxes)), target=target))
    edits, firsts = optimal_by_trial(dynamics, state, 3)
    solver = Solver(dynamics)
    solution, actions = solver.solve_from(state), solver.optimal_actions(state)
    if edits is None:
        assert (solution.status, actions.actions, actions.complete) == (Status.UNSOLVABLE, (), True)
    else:
        assert (solution.steps, solution.proven_optimal) == (edits + 1, True)
        assert played(dynamics, state, solution.actions).outcome is Outcome.SUCCESS
        assert (set(actions.actions), actions.complete, actions.steps) == (firsts, True, edits + 1)


@pytest.mark.parametrize("rules", ["paper", "release"])
def test_horizon__leaves_its_last_action_to_stop(rules):
    assert Solver(mdp("tower", rules, horizon=7)).solve(task(SIX_BLOCKS)).steps == 7
    solution = Solver(mdp("tower", rules, horizon=6)).solve(task(SIX_BLOCKS))
    assert (solution.status, solution.reason) == (Status.UNSOLVABLE, "no scene within 5 edits has that value")


def test_horizon__that_is_over_is_a_value_error():
    state = State(task(SIX_BLOCKS), Scene.empty(), steps=12)
    with pytest.raises(ValueError, match="12 of 12 were taken"):
        Solver(mdp("tower")).solve_from(state)


def test_unsolvable__is_proven_by_examining_every_scene_within_reach():
    solution = Solver(mdp("tower", horizon=4)).solve(task(NEVER))
    scenes_within_three_edits = 1 + 9 + 54 + 270
    assert (solution.status, solution.scenes) == (Status.UNSOLVABLE, scenes_within_three_edits)


def test_budget__that_is_exhausted_is_no_proof():
    solution = Solver(mdp("tower"), budget=100).solve(task(NEVER))
    assert (solution.status, solution.scenes) == (Status.NOT_FOUND, 100)
    assert "nothing found in 100 scenes" in solution.reason


@pytest.mark.parametrize("budget", [0, -1, True, 1.5])
def test_budget__must_be_positive(budget):
    with pytest.raises(ValueError, match=f"or None, not {budget}"):
        Solver(mdp("tower"), budget)
