"""Solutions in Scatter are valid under the exact rules of placement, and as short as is claimed."""

import itertools

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.matching import SceneGoal, content
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP, RemoveItem, describe
from lilgym_mp.solver import Solver, Status
from tests.scenes import scene_of
from tests.solver.tasks import mdp, optimal_by_trial, played, task

BLUE_CIRCLE = "exist(filter_obj(all_items, lambda x: is_blue(x) and is_circle(x)))"
SMALL_AT_THE_FLOOR = "exist(filter_obj(all_items, lambda x: is_small(x) and is_touching_wall(x, Side.BOTTOM)))"
TWO_CORNERS = "count(filter_obj(all_items, lambda x: is_black(x) and is_touching_corner(x))) == 2"
BLACK_OVER_YELLOW = (
    "exist(filter_obj(all_items, lambda x: is_black(x) and is_square(x)"
    " and exist(filter_obj(get_below(x), lambda y: is_yellow(y) and is_triangle(y)))))"
)
TOUCHING_PAIR = (
    "exist(filter_obj(all_items, lambda x: is_square(x) and exist(filter_shape(get_touching(x), Shape.SQUARE))))"
)
SAME_COLOURS = "query_color(all_boxes[0]) == query_color(all_boxes[1]) and count(all_boxes[0]) == 2"
A_TOWER = "exist(filter_obj(all_boxes, lambda b: b.is_tower() and count(b) == 2))"
FIVE_A_BOX = "count(filter_obj(all_boxes, lambda b: count(b) >= 5)) == 3"
CROWD = scene_of(
    "circle 0,0 large blue; square 40,0 large black; triangle 0,40 large"
    "| circle 20,20 small blue; square 60,60 black; circle 61,5 blue | triangle 70,70 large blue; square 0,80"
)
PROGRAMS = (
    BLUE_CIRCLE,
    SMALL_AT_THE_FLOOR,
    TWO_CORNERS,
    BLACK_OVER_YELLOW,
    TOUCHING_PAIR,
    SAME_COLOURS,
    A_TOWER,
)


# Under the release's rules no item lies lower than the top of its cell: its search of the cell finds no other place.
@pytest.mark.parametrize(
    ("rules", "start", "program"),
    [
        *(("paper", CROWD, program) for program in PROGRAMS),
        *(("release", Scene.empty(), program) for program in PROGRAMS if program != SMALL_AT_THE_FLOOR),
    ],
)
def test_solution__succeeds_when_played(rules, start, program):
    dynamics = mdp("scatter", rules)
    given = task(program, start, target=not task(program).truth(start))
    solution = Solver(dynamics).solve(given)
    assert played(dynamics, dynamics.start(given), solution.actions).outcome is Outcome.SUCCESS


@pytest.mark.parametrize(
    ("grid", "program"),
    [*(((38, 10), program) for program in PROGRAMS[2:5]), ("native", BLUE_CIRCLE), ("native", SMALL_AT_THE_FLOOR)],
)
def test_solution__succeeds_on_other_grids(grid, program):
    dynamics = mdp("scatter", grid=grid)
    solution = Solver(dynamics).solve(task(program))
    assert played(dynamics, dynamics.start(task(program)), solution.actions).outcome is Outcome.SUCCESS


def test_solution__removes_an_item():
    start = scene_of("circle 0,0 blue; circle 40,40 black")
    solution = Solver(mdp("scatter")).solve(task(BLUE_CIRCLE, start, target=False))
    assert solution.actions == (RemoveItem(0, 0), STOP)


# A small item added to an empty cell lies at its top, so shorter abstract paths are infeasible: only another item in
# that place makes it lie lower. Of a relational program, solutions of up to two edits are proven.
@pytest.mark.parametrize("program", [SMALL_AT_THE_FLOOR, BLACK_OVER_YELLOW])
def test_solution__is_proven_shortest(program):
    solution = Solver(mdp("scatter")).solve(task(program))
    assert (solution.steps, solution.proven_optimal) == (3, True)


def test_solution__may_remove_an_item_and_add_one_like_it_elsewhere():
    """The small item is in the only free place: a ninth large one fits there, and the small one beside another."""
    start = scene_of(
        "square 0,0 large; square 0,30 large; square 0,60 large; square 30,0 large; square 30,30 large;"
        "square 30,60 large; square 60,0 large; square 60,30 large; square 70,70 small"
    )
    program = (
        "count(filter_obj(all_boxes[0], is_big)) == 9 and count(filter_obj(all_boxes[0], is_small)) == 1"
        " and count(all_items) == 10"
    )
    solution = Solver(mdp("scatter", horizon=4)).solve(task(program, start))
    assert (solution.steps, solution.proven_optimal) == (4, True)


@pytest.mark.parametrize("program", [BLUE_CIRCLE, BLACK_OVER_YELLOW])
def test_horizon__of_one_action_leaves_stop_to_a_task_solved_at_its_start_and_no_edit(program):
    start = scene_of("circle 0,0 blue; triangle 0,60; square 40,0 black")
    solver = Solver(mdp("scatter", horizon=1))
    assert solver.solve(task(program, start)).actions == (STOP,)
    assert solver.solve(task(program)).status is Status.UNSOLVABLE


def test_unsolvable__is_proven_if_too_many_items_are_needed():
    solution = Solver(mdp("scatter")).solve(task(FIVE_A_BOX))
    assert (solution.status, solution.least_edits) == (Status.UNSOLVABLE, 12)
    assert solution.reason == "no scene within 11 edits has that value"


def test_unsolvable__is_not_claimed_if_the_budget_is_exhausted():
    assert Solver(mdp("scatter"), budget=50).solve(task(FIVE_A_BOX)).status is Status.NOT_FOUND


def test_unsolvable__is_not_claimed_if_success_is_not_the_programs_value():
    goal = scene_of("circle 3,7")
    matching = Task("one", "A statement.", "True", True, Scene.empty(), SceneGoal(frozenset({content(goal)})))
    solution = Solver(mdp("scatter")).solve(matching)
    assert solution.status is Status.NOT_FOUND
    assert "depends on their program alone" in solution.reason


def test_proof__agrees_with_trying_every_single_edit():
    dynamics = mdp("scatter")
    solver = Solver(dynamics)
    far = (one for one in load_tasks("builtin", "scatter", "flipit", "dev") if solver.solve(one).least_edits > 1)
    for given in itertools.islice(far, 3):
        assert optimal_by_trial(dynamics, dynamics.start(given), 1) == (None, set()), given.id


def test_optimal_actions__of_a_relational_program_are_not_called_complete_beyond_one_edit():
    dynamics = mdp("scatter")
    found = Solver(dynamics).optimal_actions(dynamics.start(task(BLACK_OVER_YELLOW)))
    assert found.actions
    assert not found.complete


def test_order__is_respected_if_the_program_depends_on_it():
    start = scene_of("circle 0,0 black; circle 40,0 blue | circle 0,0 black")
    solution = Solver(mdp("scatter")).solve(task(SAME_COLOURS, start))
    assert (solution.steps, solution.proven_optimal) == (2, True)
    assert "BLUE" in describe(solution.actions[0])
