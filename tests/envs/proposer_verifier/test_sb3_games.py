"""The game as a Stable-Baselines3 `VecEnv`."""

from functools import partial

import numpy as np
import pytest
import supersuit
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.utils import get_action_masks, is_masking_supported

from lilgym_mp.envs.proposer_verifier import (
    AGENTS,
    BatchedGames,
    Role,
    SingleAgentView,
    env,
    parallel_env,
)
from lilgym_mp.sb3 import InfoMasks, make_game_vec_env
from lilgym_mp.scene.actions import ActionError
from lilgym_mp.testing import assert_same, check_sb3_games

PROPOSER, VERIFIER = AGENTS
GAMES, STEPS = 4, 25


def claims_after_two_edits(turn):
    return int(np.flatnonzero(turn.action_mask)[0 if turn.state.mdp.steps == 2 else -1])


def legal_actions(masks, rng):
    return np.array([rng.choice(np.flatnonzero(mask)) for mask in masks])


@pytest.mark.parametrize(
    ("protocol", "agent"),
    [("veto", PROPOSER), ("veto", VERIFIER), ("joint", VERIFIER), ("audit", VERIFIER), ("critique", PROPOSER)],
)
def test_one_seat__plays_as_single_agent_views_do(protocol, agent):
    partner = "oracle" if agent == PROPOSER else claims_after_two_edits
    settings = {"protocol": protocol, "rewards": "hidden"}
    make = partial(make_game_vec_env, GAMES, agent, partner, **settings)
    single = lambda: SingleAgentView(env(**settings), agent, partner)  # noqa: E731
    check_sb3_games(make, single, steps=12)
    assert make().observation_space == single().observation_space


@pytest.mark.parametrize("protocol", ["veto", "joint"])
def test_both_seats__are_two_rows_of_a_game_of_a_batch(protocol):
    games = make_game_vec_env(GAMES, protocol=protocol, seed=3, rewards="correctness")
    batch = BatchedGames(GAMES, protocol=protocol, homogeneous=True, rewards="correctness")
    rng, seen, (expected, _) = np.random.default_rng(0), games.reset(), batch.reset(seed=3)
    ended = 0
    for _ in range(STEPS):
        actions = legal_actions(get_action_masks(games), rng)
        for seat, agent in enumerate(games.get_attr("agent")[:2]):
            assert_same({key: part[seat::2] for key, part in seen.items()}, expected[agent]["observation"])
            assert np.array_equal(get_action_masks(games)[seat::2], expected[agent]["action_mask"])
        seen, rewards, dones, infos = games.step(actions)
        expected, payed, *_ = batch.step({PROPOSER: actions[::2], VERIFIER: actions[1::2]})
        assert rewards == pytest.approx(np.stack([*payed.values()], axis=1).ravel())
        ended += dones.sum()
    assert ended > GAMES
    assert [info["agent"] for info in infos] == [*AGENTS] * GAMES


@pytest.mark.parametrize(("agent", "partner"), [(VERIFIER, "helpful"), ("both", None)])
def test_maskable_ppo__learns_from_it(agent, partner):
    games = make_game_vec_env(8, agent, partner, seed=0, views="guide", protocol="critique")
    assert is_masking_supported(games)
    model = MaskablePPO("MultiInputPolicy", games, n_steps=4, batch_size=32, n_epochs=1, seed=0)
    model.learn(32)
    assert model.num_timesteps >= 32


def test_wrong_arguments__are_named():
    for arguments, message in (
        (("both", "oracle"), "'both' takes no partner, not partner='oracle'"),
        ((VERIFIER,), "'verifier_0' needs a partner for the other seat, not partner=None"),
        (("judge",), "'judge'; choose from both, proposer_0, verifier_0"),
    ):
        with pytest.raises(ValueError, match=message):
            make_game_vec_env(2, *arguments)
    games = make_game_vec_env(2, PROPOSER, "oracle", protocol="veto")
    games.reset()
    with pytest.raises(ActionError, match="99"):
        games.step(np.array([0, 99]))
    with pytest.raises(AttributeError, match="'task'; choose from action_masks, agent"):
        games.get_attr("task")


def test_options__choose_the_next_games():
    games = make_game_vec_env(2, PROPOSER, "oracle", split="dev", rewards="hidden")
    games.seed(0)
    games.set_options(
        [{"task": "tower-dev-001", "intent": "deceptive"}, {"task": "tower-dev-002", "intent": "helpful"}]
    )
    assert games.reset()["intent"].tolist() == [1, 0]


def test_info_masks__survive_supersuits_concatenation():
    game = parallel_env(protocol="veto", views="structured", homogeneous=True, observations="vector")
    joined = supersuit.concat_vec_envs_v1(
        supersuit.pettingzoo_env_to_vec_env_v1(game), 3, num_cpus=0, base_class="stable_baselines3"
    )
    games, rng = InfoMasks(joined), np.random.default_rng(0)
    games.reset()
    ended = 0
    for _ in range(STEPS):
        masks = get_action_masks(games)
        own = [one.par_env.unwrapped.engine.mask(role) for one in joined.venv.vec_envs for role in Role]
        assert np.array_equal(masks, np.array(own, np.bool_))
        *_, dones, _ = games.step(legal_actions(masks, rng))
        ended += int(dones.sum())
    assert ended
    assert is_masking_supported(games)
    MaskablePPO("MlpPolicy", games, n_steps=8, batch_size=16, n_epochs=1).learn(48)
