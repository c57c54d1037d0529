"""PettingZoo's two tutorials for Stable-Baselines3, with the game in place of theirs."""

import gymnasium as gym
import pytest
import supersuit
from pettingzoo.utils import BaseWrapper
from sb3_contrib import MaskablePPO
from sb3_contrib.common.wrappers import ActionMasker
from stable_baselines3 import PPO

from lilgym_mp.envs.proposer_verifier import env, parallel_env


class SB3ActionMaskWrapper(BaseWrapper, gym.Env):
    """An AEC environment as a Gymnasium one, in which the agents take turns at one policy."""

    def reset(self, seed=None, options=None):
        super().reset(seed, options)
        self.observation_space = super().observation_space(self.possible_agents[0])["observation"]
        self.action_space = super().action_space(self.possible_agents[0])
        return self.observe(self.agent_selection), {}

    def step(self, action):
        current = self.agent_selection
        super().step(int(action))
        following = self.agent_selection
        ends = self.terminations[current], self.truncations[current]
        return self.observe(following), self._cumulative_rewards[current], *ends, self.infos[current]

    def observe(self, agent):
        return super().observe(agent)["observation"]

    def action_mask(self):
        return super().observe(self.agent_selection)["action_mask"]


@pytest.mark.parametrize("protocol", ["veto", "joint"])
def test_action_mask_tutorial__maskable_ppo_plays_both_agents(protocol):
    game = SB3ActionMaskWrapper(env(protocol=protocol, views="structured", homogeneous=True))
    game.reset(seed=0)
    masked = ActionMasker(game, SB3ActionMaskWrapper.action_mask)
    model = MaskablePPO("MultiInputPolicy", masked, n_steps=16, batch_size=16, n_epochs=1)
    model.learn(16)
    assert model.num_timesteps == 16


@pytest.mark.parametrize("homogeneous", [True, False])
def test_shared_policy_tutorial__ppo_plays_both_agents(homogeneous):
    game = parallel_env(protocol="joint", views="structured", homogeneous=homogeneous, observations="vector")
    if not homogeneous:
        with pytest.raises(AssertionError, match="pad_action_space_v0"):
            supersuit.pettingzoo_env_to_vec_env_v1(game)
        game = supersuit.pad_action_space_v0(supersuit.pad_observations_v0(game))
    vectorised = supersuit.concat_vec_envs_v1(
        supersuit.pettingzoo_env_to_vec_env_v1(game), 2, num_cpus=0, base_class="stable_baselines3"
    )
    model = PPO("MlpPolicy", vectorised, n_steps=16, batch_size=16, n_epochs=1)
    model.learn(64)
    assert model.num_timesteps == 64
