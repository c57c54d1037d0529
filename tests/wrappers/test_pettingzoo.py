"""Wrappers of the proposer-verifier game."""

from functools import partial
from itertools import cycle

import numpy as np
import pytest

from lilgym_mp import wrappers
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.wrappers import WrongEnvironment

pytest.importorskip("pettingzoo")
from pettingzoo.test import api_test, parallel_api_test
from pettingzoo.utils import BaseParallelWrapper

from lilgym_mp.envs.proposer_verifier import AGENTS, ALWAYS_ACCEPT, SingleAgentView, env, parallel_env

PROPOSER, VERIFIER = AGENTS
STOP, ADD_LEFT_BLUE = 0, 3  # of tower's actions
REJECT, ACCEPT = 0, 1

STACKS = {
    "planes": [wrappers.channels_first_v0, wrappers.grid_planes_v0, wrappers.steps_left_v0],
    "flat": [wrappers.structured_observation_v0, wrappers.flat_observation_v0],
    "mask": [wrappers.stop_forcing_v0, wrappers.action_mask_v0],
    "tokens": [wrappers.box_permutation_v0, wrappers.tokenized_statement_v0],
    "embedding": [partial(wrappers.statement_embedding_v0, encoder=lambda statement: [len(statement)])],
}
NOT_OURS = (  # warnings of PettingZoo's tests for any environment with masks
    "Observation is not a NumPy array",
    "Observation space for each agent probably should be",
    "Agents have different observation space sizes",
    "Agents have different action space sizes",
    "Action space for each agent probably should be",
    "Observation numpy array is not the same",
)


def stacked(game, names):
    for wrap in STACKS[names]:
        game = wrap(game)
    return game


@pytest.fixture
def settings(corpus):
    return {"appearance": "tower", "start": "scratch", "corpus": str(corpus), "protocol": "veto"}


@pytest.mark.filterwarnings(*(f"ignore:{message}" for message in NOT_OURS))
@pytest.mark.parametrize(("names", "protocol"), [*zip(STACKS, cycle(["veto", "joint"]), strict=False)])
def test_wrapped_game__passes_pettingzoos_tests(settings, names, protocol):
    settings["protocol"] = protocol
    api_test(stacked(env(**settings), names), num_cycles=30)
    parallel_api_test(stacked(parallel_env(**settings), names), num_cycles=30)


def test_format__transforms_each_agents_observation(settings):
    game = wrappers.structured_observation_v0(parallel_env(**settings))
    observations, _ = game.reset(options={"task": "blue"})
    for agent in AGENTS:
        assert "image" not in observations[agent]["observation"]
        assert observations[agent] in game.observation_space(agent)
    game.step({PROPOSER: ADD_LEFT_BLUE, VERIFIER: 0})
    observations = game.step({PROPOSER: STOP, VERIFIER: ACCEPT})[0]
    assert observations[PROPOSER]["observation"]["item_array"][0, 0].tolist() == [40, 80, 1, 2, 1]


def test_format__refuses_to_reveal_a_hidden_scene(settings):
    views = {PROPOSER: "image", VERIFIER: {"scene": "none"}}
    with pytest.raises(WrongEnvironment, match="StructuredObservation needs"):
        wrappers.structured_observation_v0(env(**settings, views=views))


def test_stop_forcing__allows_the_proposer_only_stop(settings):
    game = wrappers.stop_forcing_v0(env(**settings))
    game.reset(seed=0, options={"task": "blue"})
    allowed = []
    for action in (ADD_LEFT_BLUE, ACCEPT, STOP, ACCEPT):
        allowed.append(int(game.observe(game.agent_selection)["action_mask"].sum()))
        game.step(action)
    assert allowed == [10, 2, 1, 2]


def test_action_mask__is_in_infos_as_in_observations(settings):
    game = wrappers.stop_forcing_v0(wrappers.action_mask_v0(parallel_env(**settings)))
    for actions in (None, {PROPOSER: ADD_LEFT_BLUE, VERIFIER: 0}, {PROPOSER: STOP, VERIFIER: ACCEPT}):
        observations, *_, infos = game.reset(options={"task": "blue"}) if actions is None else game.step(actions)
        for agent in AGENTS:
            assert np.array_equal(infos[agent]["action_mask"], observations[agent]["action_mask"])


def test_stop_forcing__has_no_effect_if_only_the_verifier_stops(settings):
    game = wrappers.stop_forcing_v0(parallel_env(**settings | {"protocol": "joint"}))
    game.reset(seed=0, options={"task": "blue"})
    observations, *_ = game.step({PROPOSER: ADD_LEFT_BLUE, VERIFIER: 0})
    assert observations[PROPOSER]["action_mask"].sum() > 1


def test_task_change__applies_to_the_game(settings):
    game = wrappers.box_permutation_v0(env(**settings | {"start": "flipit"}))
    game.reset(options={"task": "pair-no@201"})
    assert [len(box.items) for box in game.unwrapped.scene.boxes] == [0, 1, 0]
    with pytest.raises(WrongEnvironment, match="must be applied before StepsLeft"):
        wrappers.box_permutation_v0(wrappers.steps_left_v0(env(**settings)))


def test_other_packages_wrappers__come_after_those_of_this_package(settings):
    class OnlyMask(BaseParallelWrapper):
        def observation_space(self, agent):
            return self.env.observation_space(agent)["action_mask"]

    game = OnlyMask(wrappers.steps_left_v0(parallel_env(**settings)))
    with pytest.raises(WrongEnvironment, match=r"StepsLeft must be applied before .*, which changes observations"):
        wrappers.steps_left_v0(game)
    with pytest.raises(TypeError, match="SingleAgentView takes wrappers of this package alone"):
        SingleAgentView(game, PROPOSER, "random")


@pytest.mark.parametrize(
    ("wrap", "message"),
    [
        (wrappers.text_observation_v0, "uses the MDP's actions"),
        (wrappers.multi_discrete_actions_v0, "uses the MDP's actions"),
        (partial(wrappers.stop_forcing_v0, mode="replace"), "uses the MDP's actions"),
        (partial(wrappers.stop_forcing_v0, mode="observe"), "uses the MDP's actions"),
        (wrappers.potential_shaping_v0, "changes the MDP's rewards"),
    ],
)
def test_wrappers_of_mdp_actions_and_rewards__are_refused(settings, wrap, message):
    with pytest.raises(WrongEnvironment, match=message):
        wrap(env(**settings))


@pytest.mark.parametrize("make", [env, parallel_env])
def test_wrapper__leaves_the_game_that_it_was_given_as_it_was(settings, make):
    game = make(**settings)
    wrapped = wrappers.stop_forcing_v0(wrappers.structured_observation_v0(game))
    for each, has_image in ((game, True), (wrapped, False)):
        each.reset(seed=0, options={"task": "blue"})
        assert ("image" in each.observation_space(PROPOSER)["observation"].spaces) == has_image
        assert ("image" in each.unwrapped.engine.observe(0)["observation"]) == has_image
    assert not game.unwrapped.engine.layers


@pytest.mark.parametrize("make", [env, parallel_env])
def test_single_agent_view__applies_flat_observations(make):
    view = SingleAgentView(wrappers.flat_observation_v0(wrappers.grid_planes_v0(make())), PROPOSER, ALWAYS_ACCEPT)
    observation, _ = view.reset(seed=0)
    assert view.observation_space.contains(observation)
    observation, *_ = view.step(int(np.flatnonzero(view.action_masks())[1]))
    assert view.observation_space.contains(observation)


EASY = Task("easy", "A block is blue.", "exist(filter_color(all_items, Color.BLUE))", True, Scene.empty())


@pytest.mark.parametrize("make", [env, parallel_env])
def test_single_agent_view__allows_only_stop_at_the_goal_with_stop_forcing(make):
    view = SingleAgentView(wrappers.stop_forcing_v0(make(reveal_truth=True)), PROPOSER, ALWAYS_ACCEPT)
    view.reset(options={"task": EASY})
    assert view.action_masks().sum() > 1
    *_, info = view.step(ADD_LEFT_BLUE)
    assert info["goal_reached"]
    assert np.flatnonzero(view.action_masks()).tolist() == [0]


def test_single_agent_view__applies_wrappers_to_the_partner():
    """At the goal, the partner playing the proposer may only STOP."""
    game = wrappers.stop_forcing_v0(env(protocol="audit"))
    allowed = []

    def proposer(turn):
        allowed.extend(np.flatnonzero(mask).tolist() for mask in (turn.action_mask, turn["action_mask"]))
        return ADD_LEFT_BLUE if len(allowed) == 2 else 0

    SingleAgentView(game, VERIFIER, proposer).reset(options={"task": EASY})
    assert len(allowed[0]) == len(allowed[1]) > 1
    assert allowed[2:] == [[0], [0]]


def test_single_agent_view__refuses_array_observations():
    with pytest.raises(TypeError, match='SingleAgentView needs the game with observations="nested"'):
        SingleAgentView(parallel_env(observations="vector"), PROPOSER, ALWAYS_ACCEPT)
