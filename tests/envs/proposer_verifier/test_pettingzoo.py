"""PettingZoo's API tests for every protocol, and what they do not cover."""

from dataclasses import replace

import numpy as np
import pettingzoo
import pytest
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, render_test, seed_test
from pettingzoo.test.state_test import state_test

from lilgym_mp.envs.proposer_verifier import (
    AGENTS,
    ENVIRONMENT_ID,
    PROTOCOLS,
    Role,
    SingleAgentView,
    TurnError,
    env,
    parallel_env,
    raw_env,
    read_text,
)
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import ActionError
from tests.envs.proposer_verifier.games import ADD_BLUE, CONTINUE, STOP_NOW, WAIT
from tests.scenes import B, Y, circle, scene, tower

PROPOSER, VERIFIER = AGENTS
CYCLES = 12
FORMS = {"env": env, "raw_env": raw_env, "parallel_env": parallel_env}
GIVEN = Task("given", "A new block is blue.", "exist(filter_color(all_items, Color.BLUE))", False, scene(tower(B)))
OTHER = replace(GIVEN, statement="No block is blue.", program="True", target=True, start=scene(tower(Y)))
WRONG_OPTIONS = [
    ({"task": "nothing"}, "no task 'nothing'"),
    ({"task": OTHER, "intent": "kind"}, "'kind'; choose from deceptive, helpful"),
    ({"task": OTHER, "tsk": "1"}, r"\['tsk'\]; choose from task, intent"),
    ({"task": replace(OTHER, statement="A block. " * 90)}, r"its statement has (\d+) (words|bytes), and observations"),
    ({"task": replace(OTHER, start=scene([circle(0, 0)]))}, "'given' cannot be played here"),
    ("task", "must be a mapping"),
]

# PettingZoo's warnings for environments with masks in observations that are not in its hard-coded list
MASK_WARNINGS = {
    "Observation is not a NumPy array",
    "Observation space for each agent probably should be gymnasium.spaces.box or gymnasium.spaces.discrete",
}
# and for agents with different action spaces, so masks of different lengths
SPACE_WARNINGS = {"Agents have different observation space sizes"}


@pytest.mark.parametrize("homogeneous", [False, True])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_api_tests__pass_with_only_the_known_warnings(protocol, homogeneous, recwarn):
    parallel_api_test(parallel_env(protocol=protocol, homogeneous=homogeneous), CYCLES)
    assert not recwarn.list
    api_test(env(protocol=protocol, homogeneous=homogeneous), CYCLES)
    assert messages(recwarn) <= MASK_WARNINGS | (set() if homogeneous else SPACE_WARNINGS)


@pytest.mark.parametrize(("views", "appearance"), [("image", "tower"), ("structured", "scatter")])
def test_api_test__passes_for_every_view(views, appearance, recwarn):
    settings = {"views": views, "appearance": appearance, "start": "flipit", "rewards": "hidden", "message_size": 2}
    api_test(env(**settings), CYCLES)
    parallel_api_test(parallel_env(**settings), CYCLES)
    assert messages(recwarn) <= MASK_WARNINGS | SPACE_WARNINGS


def messages(caught):
    return {str(warning.message) for warning in caught}


@pytest.mark.parametrize("protocol", ["veto", "joint"])
def test_seed_state_and_render_tests__pass(protocol, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr("lilgym_mp.envs.rendering.RENDER_FPS", 10_000)
    seed_test(lambda: env(protocol=protocol), CYCLES)
    parallel_seed_test(lambda: parallel_env(protocol=protocol), CYCLES)
    render_test(lambda **how: env(protocol=protocol, **how))
    state_test(env(protocol=protocol), parallel_env(protocol=protocol))


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_aec_and_parallel__play_the_same_game(protocol):
    turns, parallel = raw_env(protocol=protocol), parallel_env(protocol=protocol)
    rng = np.random.default_rng(1)
    for episode in range(5):
        turns.reset(seed=episode)
        observations, _ = parallel.reset(seed=episode)
        while parallel.agents:
            actions = {agent: rng.choice(np.flatnonzero(observations[agent]["action_mask"])) for agent in AGENTS}
            movers = len(turns.engine.movers)
            observations, *outcome = parallel.step(actions)
            for _ in range(movers):
                turns.step(actions[turns.agent_selection])
            assert data_equivalence({agent: turns.observe(agent) for agent in AGENTS}, observations)
            assert [turns.rewards, turns.terminations, turns.truncations, turns.infos] == outcome


def test_render__shows_an_answer_with_the_proposal_that_it_answers_and_the_rewards():
    game = env(protocol="veto", render_mode="ansi")
    game.reset(seed=0)
    game.step(ADD_BLUE)
    game.step(game.unwrapped.read_action(VERIFIER, "accept"))
    shown = str(game.render())
    assert "proposer: ADD(LEFT, BLUE);  verifier: accept" in shown
    assert "continues, rewards -0.1 and -0.1" in shown


def test_parallel__allows_only_wait_out_of_turn_and_reports_illegal_choices():
    game = parallel_env()
    observations, _ = game.reset(seed=0)
    assert np.flatnonzero(observations[VERIFIER]["action_mask"]).tolist() == [2]
    assert not observations[PROPOSER]["action_mask"][WAIT]
    *_, infos = game.step({PROPOSER: WAIT, VERIFIER: 0})
    assert infos == {PROPOSER: {"illegal_choice": True}, VERIFIER: {"illegal_choice": True}}
    observations, *_, infos = game.step({PROPOSER: ADD_BLUE, VERIFIER: 2})
    assert infos == {PROPOSER: {}, VERIFIER: {}}
    assert np.flatnonzero(observations[VERIFIER]["action_mask"]).tolist() == [0, 1]
    assert np.flatnonzero(observations[PROPOSER]["action_mask"]).tolist() == [WAIT]


def test_aec__keeps_an_agents_infos_until_it_acts():
    game = env(protocol="veto", reveal_truth=True)
    game.reset(seed=0)
    accept, reject = (game.unwrapped.read_action(VERIFIER, name) for name in ("accept", "reject"))
    for choice, expected in ((2, {"illegal_choice", "judgement"}), (reject, {"judgement"})):
        game.step(0)
        game.step(choice)
        game.step(ADD_BLUE)
        assert game.last()[4].keys() & {"illegal_choice", "judgement"} == expected
        game.step(accept)


def test_joint_aec__hides_the_proposers_action_from_the_verifier():
    game = raw_env(protocol="joint", views={"history": 2})
    game.reset(seed=0)
    before = game.observe(VERIFIER)
    game.step(ADD_BLUE)
    assert game.agent_selection == VERIFIER
    assert data_equivalence(game.observe(VERIFIER), before)
    game.step(CONTINUE)
    assert game.agent_selection == PROPOSER
    assert not data_equivalence(game.observe(VERIFIER), before)


def test_infos__have_the_outcome_but_not_the_truth_by_default():
    game = parallel_env(protocol="joint")
    _, infos = game.reset(seed=0)
    assert infos == {PROPOSER: {}, VERIFIER: {}}
    *_, infos = game.step({PROPOSER: ADD_BLUE, VERIFIER: STOP_NOW})
    assert infos[VERIFIER].keys() == {"outcome", "is_success"}


def test_infos__have_the_truth_with_reveal_truth():
    game = parallel_env(protocol="joint", reveal_truth=True)
    _, infos = game.reset(seed=0)
    task, scene = game.unwrapped.task, game.unwrapped.scene
    assert infos[VERIFIER]["truth"] == task.truth(scene)
    assert infos[VERIFIER]["goal_reached"] == task.solved_by(scene)
    *_, infos = game.step({PROPOSER: ADD_BLUE, VERIFIER: CONTINUE})
    assert infos[VERIFIER]["judgement"] == {"accepted": False, "holds": task.solved_by(scene)}


def test_truth__is_in_no_observation():
    game = parallel_env(reveal_truth=True, views={"history": 2}, rewards="hidden", message_size=2)
    parts = game.observation_space(VERIFIER)["observation"]
    assert set(parts) == {"image", "statement", "target", "proposal", "refused", "history", "message"}
    assert set(game.observation_space(PROPOSER)["observation"]) == {*parts, "intent"}


@pytest.mark.parametrize("form", FORMS)
def test_options__set_task_and_intent(form):
    game = FORMS[form](rewards="hidden", views={"statement": "text"})
    tasks = game.unwrapped.tasks
    for choice, played in ((GIVEN, GIVEN), (OTHER, OTHER), (tasks.ids[3], tasks[3]), (tasks[4], tasks[4])):
        game.reset(options={"task": choice, "intent": "deceptive"})
        assert (game.unwrapped.task, game.unwrapped.scene) == (played, played.start)
        seen = game.unwrapped.engine.observe(Role.PROPOSER)["observation"]
        assert (seen["target"], seen["intent"]) == (played.target, 1)
        assert read_text(seen["statement"]) == played.statement


@pytest.mark.parametrize("form", FORMS)
def test_options_and_seeds__that_are_wrong_change_nothing(form):
    game = FORMS[form](rewards="hidden")
    tasks = game.unwrapped.tasks
    game.reset(options={"task": GIVEN})
    for options, message in WRONG_OPTIONS:
        with pytest.raises(ValueError, match=message):
            game.reset(seed=1, options=options)
    with pytest.raises(ValueError, match="not -3"):
        game.reset(seed=-3, options={"task": OTHER})
    assert game.unwrapped.task == GIVEN
    game.reset(seed=2, options={"camera": "left", "task": GIVEN})  # of another layer
    assert game.unwrapped.task == GIVEN
    game.reset(seed=2, options={"task": None, "intent": None})
    assert game.unwrapped.task in tasks


@pytest.mark.parametrize("form", FORMS)
def test_step__before_reset_and_after_the_end_is_refused(form):
    game = FORMS[form](protocol="joint")
    is_parallel = form == "parallel_env"
    actions = [{PROPOSER: ADD_BLUE, VERIFIER: STOP_NOW}] if is_parallel else [ADD_BLUE, STOP_NOW, None, None]
    expected = (AssertionError, "reset.. needs to be called") if form == "env" else (ResetNeeded, "call reset")
    with pytest.raises(expected[0], match=expected[1]):
        game.step(actions[0])
    game.reset(seed=0)
    for action in actions:
        game.step(action)
    assert game.agents == []
    with pytest.raises(ResetNeeded, match="call reset"):
        game.step(actions[0])


def test_step__refuses_actions_for_others_and_none_from_the_agent_to_move():
    game = parallel_env()
    game.reset(seed=0)
    for actions in ({}, {PROPOSER: 1}, {PROPOSER: 1, "nobody": 2}, {PROPOSER: 1, VERIFIER: 2, "third": 0}):
        with pytest.raises(TurnError, match="for proposer_0 and verifier_0, not for"):
            game.step(actions)
    with pytest.raises(TurnError, match="it is the turn of proposer_0: it must act"):
        game.step({PROPOSER: None, VERIFIER: 2})


@pytest.mark.parametrize("action", [-1, 14, 1.0, True, [1]])
def test_step__refuses_actions_outside_the_action_space(action):
    fault = "is out of range; choose from" if action in (-1, 14) else "must be a whole number"
    for game, actions in ((parallel_env(), {PROPOSER: action, VERIFIER: 2}), (env(), action)):
        game.reset(seed=0)
        with pytest.raises(ActionError, match=rf"of proposer_0 {fault} 0 \.\. 13"):
            game.step(actions)


@pytest.mark.parametrize("form", FORMS)
def test_close__makes_everything_raise(form):
    game = FORMS[form](render_mode="ansi")
    game.reset(seed=0)
    game.close()
    game.close()
    uses = [
        game.reset,
        game.render,
        game.state,
        lambda: game.unwrapped.scene,
        lambda: game.unwrapped.change_tasks(lambda tasks: tasks),
        lambda: game.step({PROPOSER: ADD_BLUE, VERIFIER: 2} if form == "parallel_env" else ADD_BLUE),
    ]
    for use in uses if form == "parallel_env" else [*uses, game.last, lambda: game.observe(PROPOSER)]:
        with pytest.raises(ClosedEnvironmentError):
            use()


def test_close__of_a_single_agent_view_makes_everything_raise():
    view = SingleAgentView(env(), PROPOSER, "oracle")
    view.reset(seed=0)
    view.close()
    for use in (view.reset, view.action_masks, lambda: view.step(ADD_BLUE)):
        with pytest.raises(ClosedEnvironmentError):
            use()


@pytest.mark.skipif(not hasattr(pettingzoo, "register"), reason="this pettingzoo has no registry")
@pytest.mark.parametrize(("kind", "base"), [("aec", pettingzoo.AECEnv), ("parallel", pettingzoo.ParallelEnv)])
def test_registry__makes_aec_and_parallel(kind, base):
    game = pettingzoo.make(kind, ENVIRONMENT_ID, protocol="audit")
    assert isinstance(game, base)
    assert game.unwrapped.engine.game.protocol.name == "audit"


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_read_action__is_the_inverse_of_describe_action(protocol):
    game = raw_env(protocol=protocol, message_size=2)
    for agent in AGENTS:
        for action in range(game.action_space(agent).n):
            assert game.read_action(agent, game.describe_action(agent, action)) == action
    assert game.read_action(PROPOSER, "add( left,blue )") == ADD_BLUE * 3
    with pytest.raises(ActionError, match=r"'fly' .* actions look like 'STOP', "):
        game.read_action(PROPOSER, "fly")
