"""Tasks, the table of rewards and termination of the MDP (docs/spec.md, "Rule sets"), and purity of steps."""

import copy
import dataclasses
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lilgym_mp.envs.rules import RULE_SETS, Outcome, State, make_dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP, AddBlock, RemoveBlock, named
from lilgym_mp.scene.appearances import APPEARANCES, InvalidReason, make_appearance
from tests.scenes import SCENES, B, K, scene, scene_of, tower

HORIZON = 5
BLUE_IS_HERE = "exist(filter_color(all_items, Color.BLUE))"
BLUE, BLACK = scene(tower(B)), scene(tower(K))
ADD, INVALID = AddBlock(1, K), RemoveBlock(2)

# Rules, whether it is the first action or the last, the action, whether the truth is the target; outcome, reward, and
# whether the episode is terminated or truncated, and the scene changed.
TABLE = """
paper   first stop    true  | success         1.0 terminated
paper   first stop    false | wrong_stop     -1.0 terminated
paper   first invalid true  | invalid_action -1.0 terminated
paper   first add     true  | continues      -0.1 changed
paper   first wait    true  | continues      -0.1
paper   last  stop    true  | success         1.0 terminated
paper   last  stop    false | wrong_stop     -1.0 terminated
paper   last  invalid true  | invalid_action -1.0 terminated
paper   last  add     true  | horizon        -1.0 terminated changed
paper   last  wait    true  | horizon        -1.0 terminated
release first stop    true  | success         1.0 terminated
release first stop    false | wrong_stop     -1.0 terminated
release first invalid true  | invalid_action -1.0 truncated
release first add     true  | continues      -0.1 changed
release first wait    true  | continues      -0.1
release last  stop    true  | success         1.0 terminated truncated
release last  stop    false | wrong_stop     -1.0 terminated truncated
release last  invalid true  | invalid_action -1.0 truncated
release last  add     true  | horizon        -0.1 truncated
release last  wait    true  | horizon        -0.1 truncated
"""
ACTIONS = {"stop": STOP, "add": ADD, "invalid": INVALID}


def task(start, *, target=True, program=BLUE_IS_HERE):
    return Task("own", "Blue is here.", program, target, start)


@pytest.mark.parametrize("target", [True, False])
@pytest.mark.parametrize("line", TABLE.strip().splitlines())
def test_step__reward_flags_and_scene_are_those_of_the_table(line, target):
    given, expected = line.split("|")
    rules, when, name, true = given.split()
    outcome, reward, *flags = expected.split()
    dynamics = make_dynamics(make_appearance("tower"), rules, HORIZON)
    before, steps = BLUE if (true == "true") == target else BLACK, {"first": 0, "last": HORIZON - 1}[when]
    state = State(task(before, target=target), before, steps)
    assert dynamics.goal_reached(state) == (true == "true")
    done = dynamics.wait(state) if name == "wait" else dynamics.step(state, ACTIONS[name])
    assert (str(done.outcome), done.reward) == (outcome, float(reward))
    assert {flag for flag in ("terminated", "truncated") if getattr(done.result, flag)} == {*flags} - {"changed"}
    assert done.invalid == (InvalidReason.EMPTY_TOWER if name == "invalid" else None)
    assert done.state.steps == steps + 1
    assert done.state.scene == (scene(before.boxes[0].items, tower(K)) if "changed" in flags else before)


@pytest.mark.parametrize(("rules", "horizon"), [("paper", 12), ("release", 11)])
def test_default_horizon__is_the_rule_sets(rules, horizon):
    dynamics = make_dynamics(make_appearance("tower"), rules)
    assert dynamics.horizon == horizon
    state = dynamics.start(task(BLACK))
    for step in range(1, horizon + 1):
        transition = dynamics.wait(state)
        state = transition.state
        assert transition.outcome is (Outcome.HORIZON if step == horizon else Outcome.CONTINUES)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("ADD(5, 0, CIRCLE, BLUE, SMALL)", "separator"),
        ("REMOVE(13, 4)", "separator"),
        ("ADD(4, 0, CIRCLE, BLUE, LARGE)", "out_of_box"),
        ("ADD(0, 0, SQUARE, BLUE, MEDIUM)", "overlap"),
        ("REMOVE(1, 1)", "nothing_to_remove"),
    ],
)
@pytest.mark.parametrize("rules", RULE_SETS)
def test_scatter_step__an_invalid_action_has_a_reason_and_keeps_the_scene(rules, text, reason):
    dynamics = make_dynamics(make_appearance("scatter"), rules)
    before = scene_of("square 0,0")
    transition = dynamics.step(dynamics.start(task(before)), named(text))
    assert (transition.outcome, transition.invalid, transition.reward) == (Outcome.INVALID_ACTION, reason, -1.0)
    assert transition.state.scene is before


@st.composite
def states_and_actions(draw):
    name = draw(st.sampled_from(sorted(APPEARANCES)))
    dynamics = make_dynamics(make_appearance(name), draw(st.sampled_from(sorted(RULE_SETS))), HORIZON)
    start = draw(SCENES[name])
    index = draw(st.integers(0, dynamics.appearance.action_count - 1))
    state = State(task(start), start, draw(st.integers(0, HORIZON - 1)))
    return dynamics, state, dynamics.appearance.decode(index)


@given(states_and_actions())
def test_step__is_pure_and_masks_are_independent_of_earlier_calls(given_case):
    dynamics, state, action = given_case
    before = copy.deepcopy(state)
    mask = dynamics.legal_mask(state)
    first, second = dynamics.step(state, action), dynamics.step(state, action)
    assert first == second == dynamics.step(before, action)
    assert state == before
    mask[:] = False
    assert dynamics.legal_mask(state).tolist() == dynamics.legal_mask(copy.deepcopy(before)).tolist()


# Tasks


SOME_BLUE = Task("7-a", "Some block is blue.", "exist(filter_color(all_items, Color.BLUE))", False, scene(tower(B)))


def test_truth__is_false_if_the_program_raises():
    failing = dataclasses.replace(SOME_BLUE, program="is_blue(unique(all_items))")
    assert failing.truth(scene(tower(B))) is True
    assert failing.truth(Scene.empty()) is False
    assert failing.truth(scene(tower(B, B))) is False


def test_task_json__gives_the_task_back():
    assert Task.from_json(json.loads(json.dumps(SOME_BLUE.to_json()))) == SOME_BLUE


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target": 1}, "a task's target must be of type bool, not 1"),
        ({"program": None}, "a task's program must be of type str, not None"),
        ({"start": [[], []]}, "a scene has 3 boxes, not 2"),
        ({}, "a task must be an object"),
    ],
)
def test_task_json__of_another_form_is_refused(change, message):
    data = SOME_BLUE.to_json()
    with pytest.raises(ValueError, match=message):
        Task.from_json({**data, **change} if change else [])
