"""Plans for weighted goals have the mass that they state, and as much as the best reachable scene."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.rules import Dynamics, Outcome, State
from lilgym_mp.programs import ProgramError
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP
from lilgym_mp.solver import Solver, WeightedGoal, WeightedPlan
from tests.scenes import LARGE, B, K, Y, circle, scene, square, tower, triangle
from tests.solver.tasks import mdp, task

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
    "tower": (scene(), scene(tower(K), tower(B, B, K)), scene(tower(Y, B), tower(K, K), tower(Y))),
    "scatter": (
        scene(),
        scene([circle(0, 0, LARGE, B), square(40, 40, colour=K)], [triangle(5, 60, colour=Y)]),
        scene([circle(0, 0, colour=B), circle(40, 0, colour=B)], [square(0, 0, colour=K)], [square(40, 60, colour=K)]),
    ),
}


def goals(*weighted: tuple[str, float]) -> list[WeightedGoal]:
    return [WeightedGoal(program, True, probability) for program, probability in weighted]


def final_scene(dynamics: Dynamics, start: Scene, plan: WeightedPlan) -> Scene:
    """The scene at STOP; every edit must be valid."""
    state = dynamics.start(task("True", start))
    for action in plan.actions[:-1]:
        transition = dynamics.step(state, action)
        assert transition.outcome is Outcome.CONTINUES
        state = transition.state
    assert plan.actions[-1:] == (STOP,)
    return state.scene


def mass_of(given: Sequence[WeightedGoal], at: Scene) -> float:
    return sum(goal.probability for goal in given if task(goal.program).truth(at) == goal.target)


def best_mass_by_trial(dynamics: Dynamics, start: Scene, given: Sequence[WeightedGoal], max_edits: int) -> list[float]:
    """The highest mass of any scene within 0, 1, ... `max_edits` edits, by trying every action."""
    layer = {start}
    best = [mass_of(given, start)]
    for _ in range(max_edits):
        following: set[Scene] = set()
        for here in layer:
            state = State(task("True"), here, 0)
            for action in dynamics.legal_mask(state).nonzero()[0][1:].tolist():
                following.add(dynamics.step(state, dynamics.appearance.decode(action)).state.scene)
        layer = following
        best.append(max(best[-1], *(mass_of(given, at) for at in layer)))
    return best


@pytest.mark.parametrize("appearance", APPEARANCES)
@pytest.mark.parametrize("start", ["scratch", "flipit"])
def test_one_goal__is_solved_as_a_task(appearance: str, start: str):
    dynamics = mdp(appearance)
    solver = Solver(dynamics)
    for one in load_tasks("builtin", appearance, start, "dev")[::40]:
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
def test_mass__is_the_highest_of_any_reachable_tower_scene(mix: int, start_index: int):
    given, start = MIXES[mix], STARTS["tower"][start_index]
    dynamics = mdp("tower")
    best = best_mass_by_trial(dynamics, start, given, 3)
    plan = Solver(dynamics).plan_for(given, start, 3)
    assert plan.mass == pytest.approx(best[-1])
    assert len(plan.actions) - 1 == next(edits for edits, mass in enumerate(best) if mass > best[-1] - 1e-9)


@SOME_MIXES_AND_STARTS
def test_mass__is_the_highest_within_one_edit_in_scatter(mix: int, start_index: int):
    given, start = MIXES[mix], STARTS["scatter"][start_index]
    dynamics = mdp("scatter")
    plan = Solver(dynamics).plan_for(given, start, 1)
    assert plan.mass == pytest.approx(best_mass_by_trial(dynamics, start, given, 1)[-1])


@pytest.mark.parametrize("appearance", APPEARANCES)
@pytest.mark.parametrize("mix", range(len(MIXES)))
def test_satisfied__are_the_goals_that_hold_at_stop(appearance: str, mix: int):
    dynamics = mdp(appearance)
    for start, edits_left in itertools.product(STARTS[appearance][1:], (2, 11)):
        plan = Solver(dynamics).plan_for(MIXES[mix], start, edits_left)
        if not plan.actions:
            assert (plan.satisfied, plan.mass) == ((), 0.0)
            continue
        at = final_scene(dynamics, start, plan)
        holding = [i for i, goal in enumerate(MIXES[mix]) if task(goal.program).truth(at) == goal.target]
        assert list(plan.satisfied) == holding
        assert plan.mass == pytest.approx(sum(MIXES[mix][index].probability for index in holding))
        assert len(plan.actions) - 1 <= edits_left


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_plan__is_the_shorter_of_two_with_equal_mass(appearance: str):
    plan = Solver(mdp(appearance)).plan_for(goals((THREE_BLUE, 0.5), (TWO_BLUE, 0.5)), Scene.empty(), 11)
    assert (len(plan.actions), plan.satisfied) == (3, (1,))


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_goals__of_the_same_program_and_target_add_up(appearance: str):
    given = goals((BLUE, 0.3), (NO_BLACK, 0.3), (BLUE, 0.4))
    plan = Solver(mdp(appearance)).plan_for(given, Scene.empty(), 11)
    assert (plan.satisfied, plan.mass, len(plan.actions)) == ((0, 1, 2), pytest.approx(1.0), 2)


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_goals__out_of_reach_leave_no_plan(appearance: str):
    plan = Solver(mdp(appearance)).plan_for(goals((NEVER, 1.0)), Scene.empty(), 4)
    assert (plan.actions, plan.satisfied, plan.mass) == ((), (), 0.0)


def test_bad_input__is_named():
    solver = Solver(mdp("tower"))
    with pytest.raises(ValueError, match="at least one goal"):
        solver.plan_for([], Scene.empty(), 3)
    with pytest.raises(ValueError, match=r"probability of goal 1 must be a number of at least 0, not -0\.5"):
        solver.plan_for(goals((BLUE, 0.5), (TWO_BLUE, -0.5)), Scene.empty(), 3)
    with pytest.raises(ValueError, match="edits_left must be at least 0, not -1"):
        solver.plan_for(goals((BLUE, 0.5)), Scene.empty(), -1)
    with pytest.raises(ProgramError):
        solver.plan_for(goals(("exist(", 0.5)), Scene.empty(), 3)
