"""Array observations with masks in infos, and SuperSuit's wrappers on them."""

import numpy as np
import pytest

pytest.importorskip("pettingzoo")
from gymnasium.spaces.utils import flatten
from pettingzoo.test import api_test, parallel_api_test

from lilgym_mp.envs.proposer_verifier import AGENTS, env, parallel_env
from lilgym_mp.wrappers import WrongEnvironment, grid_planes_v0

SUPERSUIT = {  # called with the supersuit module and the game
    "frame_stack": lambda ss, game: ss.frame_stack_v1(game, 3),
    "dtype": lambda ss, game: ss.dtype_v0(game, np.float32),
}


@pytest.mark.parametrize("protocol", ["veto", "joint"])
def test_vectors__are_the_nested_observations_with_masks_in_infos(protocol):
    nested, game = parallel_env(protocol=protocol), parallel_env(protocol=protocol, observations="vector")
    turns = env(protocol=protocol, observations="vector")
    turns.reset(seed=0)
    before, (seen, infos) = nested.reset(seed=0)[0], game.reset(seed=0)
    assert np.array_equal(turns.observe(AGENTS[0]), seen[AGENTS[0]])
    assert np.array_equal(turns.infos[AGENTS[0]]["action_mask"], infos[AGENTS[0]]["action_mask"])
    for _ in range(3):
        for agent in AGENTS:
            assert seen[agent] in game.observation_space(agent)
            flat = flatten(nested.observation_space(agent)["observation"], before[agent]["observation"])
            assert np.array_equal(seen[agent], flat)
            assert np.array_equal(infos[agent]["action_mask"], before[agent]["action_mask"])
        actions = {agent: int(infos[agent]["action_mask"].argmax()) for agent in AGENTS}
        before, *_ = nested.step(actions)
        seen, *_, infos = game.step(actions)


def test_unknown_form__is_refused_naming_the_choices():
    with pytest.raises(ValueError, match="'flat'; choose from nested, vector"):
        parallel_env(observations="flat")
    with pytest.raises(WrongEnvironment, match='GridPlanes needs the game with observations="nested"'):
        grid_planes_v0(parallel_env(observations="vector"))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", [None, *SUPERSUIT])
def test_pettingzoos_api_tests__pass_with_supersuits_wrappers(name):
    supersuit = pytest.importorskip("supersuit")
    wrap = SUPERSUIT[name] if name else lambda module, game: game
    api_test(wrap(supersuit, env(observations="vector")), num_cycles=20)
    parallel_api_test(wrap(supersuit, parallel_env(observations="vector")), num_cycles=20)


def test_supersuits_copies__of_a_game_play_different_tasks():
    supersuit = pytest.importorskip("supersuit")
    game = supersuit.pettingzoo_env_to_vec_env_v1(parallel_env(observations="vector", homogeneous=True))
    games = supersuit.concat_vec_envs_v1(game, 8, num_cpus=0, base_class="gymnasium")
    for seed in (None, 0):
        games.reset(seed=seed)
        assert len({one.par_env.unwrapped.task.id for one in games.vec_envs}) > 4
