"""Array observations with masks in infos, and SuperSuit's wrappers on them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pettingzoo", reason="needs the extra pettingzoo")
from gymnasium import spaces
from pettingzoo.test import api_test, parallel_api_test

from lilgym_mp.envs.proposer_verifier import PROTOCOLS, env, parallel_env
from lilgym_mp.wrappers import WrongEnvironment, grid_planes_v0

AGENTS = ("proposer_0", "verifier_0")
FORMS = pytest.mark.parametrize("observations", ["vector", "image"])
SUPERSUIT: dict[str, Callable[[Any, Any], Any]] = {  # called with the supersuit module and the game
    "frame_stack": lambda ss, game: ss.frame_stack_v1(game, 3),
    "color_reduction": lambda ss, game: ss.color_reduction_v0(game, "B"),
    "dtype": lambda ss, game: ss.dtype_v0(game, np.float32),
    "flatten": lambda ss, game: ss.flatten_v0(game),
    "pad": lambda ss, game: ss.pad_action_space_v0(ss.pad_observations_v0(game)),
    "black_death": lambda ss, game: ss.black_death_v3(game),
    "agent_indicator": lambda ss, game: ss.agent_indicator_v0(game),
}


@FORMS
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_array_spaces__contain_every_observation_and_infos_have_masks(protocol: str, observations: str):
    nested, game = parallel_env(protocol=protocol), parallel_env(protocol=protocol, observations=observations)
    rng = np.random.default_rng(0)
    (before, _), (seen, infos) = nested.reset(seed=0), game.reset(seed=0)
    while game.agents:
        for agent in AGENTS:
            space = game.observation_space(agent)
            assert isinstance(space, spaces.Box)
            assert space.contains(seen[agent])
            assert np.array_equal(infos[agent]["action_mask"], before[agent]["action_mask"])
        actions = {agent: int(rng.choice(np.flatnonzero(infos[agent]["action_mask"]))) for agent in AGENTS}
        before, *_ = nested.step(actions)
        seen, *_, infos = game.step(actions)


def test_vector__contains_every_part():
    nested, game = parallel_env(views="structured"), parallel_env(views="structured", observations="vector")
    parts = nested.reset(seed=3)[0]["verifier_0"]["observation"]
    vector: Any = game.reset(seed=3)[0]["verifier_0"]
    sizes = [part.size for name, part in sorted(parts.items()) if name == "item_array"]
    assert vector.dtype == np.float32
    assert len(vector) > sum(sizes)
    start = vector.tolist()
    items = parts["item_array"].ravel().astype(np.float32).tolist()
    assert any(start[at : at + len(items)] == items for at in range(len(start) - len(items) + 1))


@pytest.mark.filterwarnings("ignore")
@FORMS
def test_pettingzoo_api_tests__pass(observations: str):
    api_test(env(observations=observations), num_cycles=20)
    parallel_api_test(parallel_env(observations=observations), num_cycles=20)


def test_aec__has_masks_in_infos():
    game = env(observations="image")
    game.reset(seed=0)
    for agent in game.agent_iter(20):
        observation, _, terminated, truncated, info = game.last()
        assert observation.shape == (50, 190, 3)
        over = terminated or truncated
        game.step(None if over else int(np.flatnonzero(info["action_mask"])[-1]))
        assert agent in AGENTS


def test_unknown_form__is_refused_naming_the_choices():
    with pytest.raises(ValueError, match="unknown observations 'flat'; choose from image, nested, parts, vector"):
        parallel_env(observations="flat")
    with pytest.raises(ValueError, match='observations="image" needs views with scene="image"'):
        parallel_env(observations="image", views="structured")
    with pytest.raises(WrongEnvironment, match='GridPlanes needs the game with observations="nested"'):
        grid_planes_v0(parallel_env(observations="vector"))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("form", [parallel_env, env], ids=["together", "turns"])
@pytest.mark.parametrize("name", SUPERSUIT)
def test_supersuit__wraps_the_game(name: str, form: Callable[..., Any]):
    import supersuit

    if name == "black_death" and form is env:
        pytest.skip("SuperSuit's black_death needs a parallel environment")
    wrapped = SUPERSUIT[name](supersuit, form(observations="image" if name == "color_reduction" else "vector"))
    (_play_parallel if form is parallel_env else _play_aec)(wrapped)


def test_supersuits_copies__of_a_game_play_different_tasks():
    supersuit = pytest.importorskip("supersuit")
    game = supersuit.pettingzoo_env_to_vec_env_v1(parallel_env(observations="vector", homogeneous=True))
    games = supersuit.concat_vec_envs_v1(game, 8, num_cpus=0, base_class="gymnasium")
    for seed in (None, 0):
        games.reset(seed=seed)
        assert len({one.par_env.unwrapped.task.id for one in games.vec_envs}) > 4


def _play_parallel(game: Any) -> None:
    observations, _ = game.reset(seed=0)
    for _ in range(5):
        if not game.agents:
            break
        for agent, seen in observations.items():
            assert seen.shape == game.observation_space(agent).shape
        observations, *_ = game.step({agent: 3 if agent == AGENTS[0] else 1 for agent in game.agents})


def _play_aec(game: Any) -> None:
    game.reset(seed=0)
    for agent in game.agent_iter(6):
        observation, _, terminated, truncated, _ = game.last()
        assert observation.shape == game.observation_space(agent).shape  # SuperSuit's values may be out of its bounds
        game.step(None if terminated or truncated else 1)
