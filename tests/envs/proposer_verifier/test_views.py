"""The parts of each agent's observation."""

import copy
import pickle

import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from lilgym_mp.envs.proposer_verifier import AGENTS, Role, View, parallel_env
from lilgym_mp.scene.render import draw
from tests.envs.proposer_verifier.games import ACCEPT, ADD_BLACK, ADD_BLUE, REJECT, game, played

PROPOSER, VERIFIER = AGENTS


def engine(**settings):
    """The engine after reset, with the only task."""
    return played(game(**settings))[0]


def seen(engine, role):
    """The parts of an agent's observation."""
    return engine.observe(role)["observation"]


def test_scene__is_drawn_or_listed_item_by_item():
    game = engine(protocol="joint", image_size="native", views={PROPOSER: "image", VERIFIER: "structured"})
    game.step(ADD_BLUE, 0)
    drawn, listed = (seen(game, role) for role in Role)
    assert np.array_equal(drawn["image"], draw(game.state.mdp.scene, "native"))
    assert "proposal" not in drawn
    assert listed["item_array"].shape == (3, 4, 5)
    assert listed["item_array"][0, 0].tolist() == [40, 80, 1, 2, 1]
    assert (listed["item_array"].reshape(-1, 5)[1:] == -1).all()


def test_tokens__encode_the_statement():
    game = engine()
    tokens = seen(game, Role.PROPOSER)["statement"]
    assert game.game.sizes.vocabulary.decode(tokens) == ["some", "block", "is", "blue"]
    assert tokens.shape == (8,)


def test_proposal__is_observed_in_the_released_array_form_until_answered_and_as_refused_until_an_action_is_played():
    game = engine()

    def shown():
        return [seen(game, Role.VERIFIER)["proposal"].tolist(), seen(game, Role.PROPOSER)["refused"].tolist()]

    found = [shown()]
    for actions in ((ADD_BLUE, None), (None, REJECT), (ADD_BLUE, None), (None, ACCEPT)):
        game.step(*actions)
        found.append(shown())
    nothing, blue = [-1, -1, -1], [1, 0, 2]
    assert found == [[nothing, nothing], [blue, nothing], [nothing, blue], [blue, blue], [nothing, nothing]]


def test_proposed_scene__is_the_scene_after_the_proposal():
    game = engine(views={"scene": "structured", "proposed_scene": True})
    game.step(ADD_BLUE, None)
    view = seen(game, Role.VERIFIER)
    assert (view["item_array"] == -1).all()
    assert view["proposed_item_array"][0, 0].tolist() == [40, 80, 1, 2, 1]


def test_history__holds_the_last_turns_newest_last():
    game = engine(views={"history": 3}, message_size=2)
    game.step(game.game.encode_action(Role.PROPOSER, ADD_BLUE, message=2), None)
    game.step(None, game.game.encode_action(Role.VERIFIER, REJECT, message=1))
    nothing, proposed, rejected = seen(game, Role.PROPOSER)["history"].tolist()
    assert nothing == [-1] * 6
    assert proposed == [1, 0, 2, -1, 2, 0]
    assert rejected == [-1, -1, -1, REJECT, 2, 1]


def test_message__is_the_other_agents_last_message():
    game = engine(message_size={PROPOSER: 2, VERIFIER: 0})
    game.step(game.game.encode_action(Role.PROPOSER, ADD_BLUE, message=2), None)
    assert seen(game, Role.VERIFIER)["message"] == 2
    assert "message" not in seen(game, Role.PROPOSER)


def test_view__can_omit_all_parts_but_one():
    nothing = View(scene="none", statement="none", target=False, proposal=False, refused=False)
    views = {PROPOSER: "image", VERIFIER: View(scene="none", statement="none", proposal=False, refused=False)}
    assert set(seen(engine(views=views), Role.VERIFIER)) == {"target"}
    assert seen(engine(views=nothing), Role.PROPOSER) == {}


def test_homogeneous__agents_have_equal_spaces_and_observe_their_index():
    views = {PROPOSER: "image", VERIFIER: View(scene="none", target=False)}
    game = parallel_env(homogeneous=True, views=views, rewards="hidden")
    assert game.observation_space(PROPOSER) == game.observation_space(VERIFIER)
    assert game.action_space(PROPOSER) == game.action_space(VERIFIER)
    observations, _ = game.reset(seed=0)
    assert [int(observations[agent]["observation"]["agent"]) for agent in AGENTS] == [0, 1]
    assert not observations[VERIFIER]["observation"]["image"].any()
    assert game.observation_space(VERIFIER).contains(observations[VERIFIER])


@pytest.mark.parametrize("split", ["train", "dev"])
def test_spaces__are_the_same_for_every_split(split):
    assert parallel_env(split=split).observation_space(PROPOSER) == parallel_env().observation_space(PROPOSER)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda game: pickle.loads(pickle.dumps(game))])
def test_copies__draw_their_own_tasks_if_unseeded_and_continue_a_game_alike(copied):
    game = parallel_env(protocol="joint", views={"history": 2})
    drawn = set()
    for unseeded in (copied(game) for _ in range(8)):
        unseeded.reset()
        drawn.add(unseeded.task.id)
    assert len(drawn) > 1
    game.reset(seed=3)
    game.step({PROPOSER: ADD_BLUE, VERIFIER: 0})
    twin = copied(game)
    for actions in ({PROPOSER: ADD_BLACK, VERIFIER: 0}, {PROPOSER: ADD_BLACK, VERIFIER: 1}):
        assert data_equivalence(game.step(actions), twin.step(actions))
    assert data_equivalence(game.reset(), twin.reset())
