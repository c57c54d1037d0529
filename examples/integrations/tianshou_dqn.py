"""Tianshou: DQN with masks, over single environments in Tianshou's own vector environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from flat import ACTIONS, ID, arguments, finish, flat
from tianshou.algorithm.modelfree.dqn import DQN, DiscreteQLearningPolicy  # pyright: ignore[reportMissingImports]
from tianshou.algorithm.optim import AdamOptimizerFactory  # pyright: ignore[reportMissingImports]
from tianshou.data import Batch, Collector, VectorReplayBuffer  # pyright: ignore[reportMissingImports]
from tianshou.env import DummyVectorEnv  # pyright: ignore[reportMissingImports]
from tianshou.utils.net.common import Net  # pyright: ignore[reportMissingImports]
from tianshou.utils.torch_utils import policy_within_training_step  # pyright: ignore[reportMissingImports]

from lilgym_mp import action_masks

LIBRARY = "Tianshou"
CELLS = {
    "single": (
        "used by DQN, through the four-line wrapper `Masked` of the snippet",
        "`evaluate_wrapped`",
        "Gymnasium's `NormalizeReward`",
    )
}


class Masked(gym.ObservationWrapper):  # pyright: ignore[reportMissingTypeArgument]
    """Observations {"obs", "mask"}, as Tianshou's policies read them."""

    def observation(self, observation: Any) -> Any:
        return {"obs": observation, "mask": action_masks(self.env)}


def make() -> Any:
    return Masked(gym.wrappers.NormalizeReward(flat(gym.make(ID, observation="arrays"))))


def main() -> None:
    args = arguments(CELLS)
    torch.set_num_threads(1)
    envs = DummyVectorEnv([make for _ in range(4)])
    envs.seed(0)
    space = make().env.observation_space

    def algorithm() -> Any:
        network = Net(state_shape=space.shape, action_shape=ACTIONS, hidden_sizes=[64])
        policy = DiscreteQLearningPolicy(
            model=network, action_space=gym.spaces.Discrete(ACTIONS), observation_space=space, eps_training=0.1
        )
        return DQN(policy=policy, optim=AdamOptimizerFactory(lr=1e-3), target_update_freq=20)

    trained, loaded = algorithm(), algorithm()
    buffer = VectorReplayBuffer(10_000, 4)
    collector = Collector(trained, envs, buffer)
    collector.reset()
    for _ in range(4):
        with policy_within_training_step(trained.policy):
            collector.collect(n_step=args.steps // 4)
            trained.update(buffer, 64)
    torch.save(trained.state_dict(), "model.pt")
    loaded.load_state_dict(torch.load("model.pt", weights_only=True))

    def greedy(algorithm: Any) -> Any:
        def choose(seen: Any, legal: Any) -> Any:
            seen = Batch(obs=Batch(obs=seen, mask=legal), info=Batch())
            with torch.no_grad():
                return np.asarray(algorithm.policy(seen).act)

        return choose

    finish(args.kind, greedy(trained), greedy(loaded), wrap=flat)


if __name__ == "__main__":
    main()
