"""PettingZoo's two tutorials for Stable-Baselines3, with the game in place of theirs."""

import gymnasium as gym
import pytest
from pettingzoo.utils import BaseWrapper
from sb3_contrib import MaskablePPO
from sb3_contrib.common.wrappers import ActionMasker

from lilgym_mp.envs.proposer_verifier import env


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
