"""Plans for weighted goals have the mass that they state, and as much as the best reachable scene."""

from itertools import accumulate

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.programs import ProgramError
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP
from lilgym_mp.solver import Solver, WeightedGoal
from tests.scenes import scene_of
from tests.solver.tasks import layers_by_trial, mdp, played, task

APPEARANCES = ("tower", "scatter")
BLUE = "exist(filter_obj(all_items, is_blue))"
TWO_BLUE = "count(filter_obj(all_items, is_blue)) == 2"
SOME_BLUE = "count(filter_color(all_items, Color.BLUE)) >= 2"
THREE_BLUE = "count(filter_obj(all_items, is_blue)) == 3"
NO_BLACK = "not exist(filter_obj(all_items, is_black))"
BLACK_TOPS = "count(filter_obj(all_items, lambda x: is_top(x) and is_black(x))) == 2"
FIRST_HAS_TWO = "count(all_boxes[0]) == 2"
FAILS_ON_NOTHING = "is_blue(unique(all_items))"
NEVER = "count(all_items) > 40"
STARTS = {
    "tower": ("", "tower k | tower bbk", "tower yb | tower kk | tower y"),
    "scatter": (
        "",
        "circle 0,0 large blue; square 40,40 black | triangle 5,60",
        "circle 0,0 blue; circle 40,0 blue | square 0,0 black | square 40,60 black",
    ),
}


def goals(*weighted):
    return [WeightedGoal(program, True, probability) for program, probability in weighted]


def final_scene(dynamics, start, plan):
    """The scene at STOP; every edit must be valid."""
    assert plan.actions[-1:] == (STOP,)
    return played(dynamics, dynamics.start(task("True", start)), plan.actions).state.scene


def mass_of(given, at):
    return sum(goal.probability for goal in given if task(goal.program).truth(at) == goal.target)


def best_mass_by_trial(dynamics, start, given, max_edits):
    """The highest mass of any scene within 0, 1, ... `max_edits` edits, by trying every action."""
    layers = layers_by_trial(dynamics, dynamics.start(task("True", start)), max_edits)
    return [*accumulate((max(mass_of(given, at) for at in layer) for layer in layers), max)]


@pytest.mark.parametrize("appearance", APPEARANCES)
@pytest.mark.parametrize("start", ["scratch", "flipit"])
def test_one_goal__is_solved_as_a_task(appearance, start):
    dynamics = mdp(appearance)
    solver = Solver(dynamics)
    for one in load_tasks("builtin", appearance, start, "dev")[::60]:
        plan = solver.plan_for([WeightedGoal(one.program, one.target, 0.25)], one.start, dynamics.horizon - 1)
        solution = solver.solve(one)
        assert len(plan.actions) == solution.steps, one.id
        assert (plan.satisfied, plan.mass) == (((0,), 0.25) if solution.solved else ((), 0.0))
        if solution.solved:
            assert one.solved_by(final_scene(dynamics, one.start, plan))


MIXES = [
    goals((TWO_BLUE, 0.5), (SOME_BLUE, 0.3), (THREE_BLUE, 0.2)),
    goals((THREE_BLUE, 0.3), (TWO_BLUE, 0.3), (SOME_BLUE, 0.2), (NO_BLACK, 0.2)),
    goals((NEVER, 0.6), (BLUE, 0.1), (NO_BLACK, 0.1), (FIRST_HAS_TWO, 0.2)),
    goals((BLACK_TOPS, 0.4), (TWO_BLUE, 0.3), (FAILS_ON_NOTHING, 0.3)),
    [WeightedGoal(BLUE, True, 0.2), WeightedGoal(TWO_BLUE, False, 0.5), WeightedGoal(FAILS_ON_NOTHING, False, 0.3)],
]
SOME_MIXES_AND_STARTS = pytest.mark.parametrize(
    ("mix", "start_index"), [(mix, start) for mix in range(len(MIXES)) for start in range(3) if (mix + start) % 2 == 0]
)


@SOME_MIXES_AND_STARTS
@pytest.mark.parametrize(("appearance", "max_edits"), [("tower", 3), ("scatter", 1)])
def test_mass__is_the_highest_of_any_reachable_scene_and_the_plan_is_as_short(appearance, max_edits, mix, start_index):
    given, start = MIXES[mix], scene_of(STARTS[appearance][start_index])
    dynamics = mdp(appearance)
    best = best_mass_by_trial(dynamics, start, given, max_edits)
    plan = Solver(dynamics).plan_for(given, start, max_edits)
    assert plan.mass == pytest.approx(best[-1])
    if plan.actions:
        assert len(plan.actions) - 1 == next(edits for edits, mass in enumerate(best) if mass > best[-1] - 1e-9)


@pytest.mark.parametrize("appearance", APPEARANCES)
@pytest.mark.parametrize("mix", range(len(MIXES)))
def test_satisfied__are_the_goals_that_hold_at_stop(appearance, mix):
    dynamics, start = mdp(appearance), scene_of(STARTS[appearance][1])
    plan = Solver(dynamics).plan_for(MIXES[mix], start, 11)
    at = final_scene(dynamics, start, plan)
    assert plan.mass == pytest.approx(mass_of(MIXES[mix], at))
    assert plan.mass == pytest.approx(sum(MIXES[mix][index].probability for index in plan.satisfied))
    assert len(plan.actions) - 1 <= 11


@pytest.mark.parametrize("appearance", APPEARANCES)
@pytest.mark.parametrize(
    ("given", "edits_left", "actions", "satisfied", "mass"),
    [
        (goals((THREE_BLUE, 0.5), (TWO_BLUE, 0.5)), 11, 3, (1,), 0.5),  # the shorter of two of equal mass
        (goals((BLUE, 0.3), (NO_BLACK, 0.3), (BLUE, 0.4)), 11, 2, (0, 1, 2), 1.0),  # equal goals add up
        (goals((NEVER, 1.0)), 4, 0, (), 0.0),  # nothing is in reach
    ],
)
def test_plan__from_an_empty_scene(appearance, given, edits_left, actions, satisfied, mass):
    plan = Solver(mdp(appearance)).plan_for(given, Scene.empty(), edits_left)
    assert (len(plan.actions), plan.satisfied, plan.mass) == (actions, satisfied, pytest.approx(mass))


def test_bad_input__is_named():
    solver = Solver(mdp("tower"))
    for given, edits_left, message in (
        ([], 3, "at least one goal"),
        (goals((BLUE, 0.5), (TWO_BLUE, -0.5)), 3, r"of goal 1 must be a number of at least 0, not -0\.5"),
        (goals((BLUE, 0.5)), -1, "at least 0, not -1"),
        (goals(("exist(", 0.5)), 3, "never closed"),
    ):
        with pytest.raises((ValueError, ProgramError), match=message):
            solver.plan_for(given, Scene.empty(), edits_left)
