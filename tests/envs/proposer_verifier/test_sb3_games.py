"""The game as a Stable-Baselines3 `VecEnv`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import supersuit
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.utils import get_action_masks, is_masking_supported

from lilgym_mp.envs.proposer_verifier import AGENTS, PartnerTurn, Role, SingleAgentView, env, parallel_env
from lilgym_mp.sb3 import InfoMasks, make_game_vec_env
from lilgym_mp.scene.actions import ActionError

PROPOSER, VERIFIER = AGENTS
GAMES, STEPS = 4, 25


def claims_after_two_edits(turn: PartnerTurn) -> int:
    return int(np.flatnonzero(turn.action_mask)[0 if turn.state.mdp.steps == 2 else -1])


def legal_actions(masks: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.array([rng.choice(np.flatnonzero(mask)) for mask in masks])


@pytest.mark.parametrize("protocol", ["veto", "joint", "audit", "critique"])
@pytest.mark.parametrize("agent", AGENTS)
def test_one_seat__plays_as_single_agent_views_do(protocol: str, agent: str):
    partner = "oracle" if agent == PROPOSER else claims_after_two_edits
    settings: dict[str, Any] = {"protocol": protocol, "rewards": "hidden"}
    games = make_game_vec_env(GAMES, agent, partner, seed=3, monitor=False, **settings)
    views = [SingleAgentView(env(**settings), agent, partner) for _ in range(GAMES)]
    rng, seen = np.random.default_rng(0), games.reset()
    expected = [view.reset(seed=3 + index)[0] for index, view in enumerate(views)]
    assert games.observation_space == views[0].observation_space
    for _ in range(STEPS):
        for index, view in enumerate(views):
            assert all(np.array_equal(part, seen[key][index]) for key, part in expected[index].items())
            assert np.array_equal(view.action_masks(), get_action_masks(games)[index])
        actions = legal_actions(get_action_masks(games), rng)
        seen, rewards, dones, infos = games.step(actions)
        for index, view in enumerate(views):
            expected[index], reward, terminated, truncated, info = view.step(actions[index])
            assert rewards[index] == np.float32(reward)
            assert dones[index] == (terminated or truncated)
            assert infos[index].get("outcome") == info.get("outcome")
            if dones[index]:
                last, expected[index] = expected[index], view.reset()[0]
                assert all(np.array_equal(last[key], infos[index]["terminal_observation"][key]) for key in last)
                assert infos[index]["TimeLimit.truncated"] == truncated


@pytest.mark.parametrize("protocol", ["veto", "joint"])
def test_both_seats__are_two_rows_of_parallel_games(protocol: str):
    games = make_game_vec_env(GAMES, protocol=protocol, seed=3, rewards="correctness")
    singles = [parallel_env(protocol=protocol, homogeneous=True, rewards="correctness") for _ in range(GAMES)]
    rng, seen = np.random.default_rng(0), games.reset()
    expected = [single.reset(seed=3 + index)[0] for index, single in enumerate(singles)]
    returns, ended = np.zeros(2 * GAMES), 0
    for _ in range(STEPS):
        actions = legal_actions(get_action_masks(games), rng)
        for row, agent in enumerate(games.get_attr("agent")):
            one = expected[row // 2][agent]
            assert all(np.array_equal(part, seen[key][row]) for key, part in one["observation"].items())
            assert np.array_equal(get_action_masks(games)[row], one["action_mask"])
        seen, _, dones, infos = games.step(actions)
        for index, single in enumerate(singles):
            expected[index], rewards, *_ = single.step(dict(zip(AGENTS, actions[2 * index :][:2], strict=True)))
            returns[2 * index :][:2] += [rewards[agent] for agent in AGENTS]
            if single.agents:
                continue
            expected[index], _ = single.reset()
            for row in (2 * index, 2 * index + 1):
                assert dones[row]
                assert infos[row]["agent"] == AGENTS[row % 2]
                assert infos[row]["episode"]["r"] == pytest.approx(returns[row], abs=1e-6)
                returns[row], ended = 0, ended + 1
    assert ended > GAMES


@pytest.mark.parametrize(("agent", "partner"), [(PROPOSER, "oracle"), (VERIFIER, "helpful"), ("both", None)])
def test_maskable_ppo__learns_from_it(agent: str, partner: str | None):
    games = make_game_vec_env(8, agent, partner, seed=0, views="guide", protocol="critique")
    assert is_masking_supported(games)
    model = MaskablePPO("MultiInputPolicy", games, n_steps=8, batch_size=32, n_epochs=1, seed=0)
    model.learn(128)
    assert model.num_timesteps == 128


def test_wrong_arguments__are_named():
    with pytest.raises(ValueError, match="agent='both' takes no partner, not partner='oracle'"):
        make_game_vec_env(2, "both", "oracle")
    with pytest.raises(ValueError, match="agent='verifier_0' needs a partner for the other seat, not partner=None"):
        make_game_vec_env(2, VERIFIER)
    with pytest.raises(ValueError, match="unknown agent 'judge'; choose from both, proposer_0, verifier_0"):
        make_game_vec_env(2, "judge")
    games = make_game_vec_env(2, PROPOSER, "oracle", protocol="veto")
    games.reset()
    with pytest.raises(ActionError, match="99"):
        games.step(np.array([0, 99]))
    with pytest.raises(AttributeError, match="games in a batch have no 'task'; choose from action_masks, agent"):
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
