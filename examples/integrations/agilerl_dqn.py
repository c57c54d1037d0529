"""AgileRL: DQN with masks over a batch, in a loop of one's own."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from agilerl.algorithms.dqn import DQN  # pyright: ignore[reportMissingImports]
from agilerl.components.data import Transition  # pyright: ignore[reportMissingImports]
from agilerl.components.replay_buffer import ReplayBuffer  # pyright: ignore[reportMissingImports]
from flat import ID, arguments, finish, flat

from lilgym_mp import action_masks

LIBRARY = "AgileRL"
CELLS = {
    "batch": (
        "used by DQN, as 0 and 1 in `action_mask` of `get_action`",
        "`evaluate_wrapped`",
        "Gymnasium's `NormalizeReward`",
    )
}

COUNT = 8


def main() -> None:
    args = arguments(CELLS)
    torch.set_num_threads(1)
    envs = flat(gym.make_vec(ID, num_envs=COUNT, observation="arrays", autoreset_mode="SameStep"))
    envs = gym.wrappers.vector.NormalizeReward(envs)
    trained: Any = DQN(envs.single_observation_space, envs.single_action_space, batch_size=32)
    buffer = ReplayBuffer(max_size=10_000)
    seen, _ = envs.reset(seed=0)
    for _ in range(args.steps // COUNT):
        actions = trained.get_action(seen, epsilon=0.1, action_mask=action_masks(envs).astype(int))
        after, rewards, ended, cut, _ = envs.step(actions)
        done = (ended | cut).astype(np.float32)
        step = Transition(obs=seen, action=actions, reward=rewards, next_obs=after, done=done).to_tensordict()
        step.batch_size = [COUNT]
        buffer.add(step)
        seen = after  # where an episode ended, another's first, which its "done" keeps out of the target
        if len(buffer) >= 32:
            trained.learn(buffer.sample(32))
    trained.save_checkpoint("model.pt")
    loaded = DQN.load("model.pt")

    def greedy(agent: Any) -> Any:
        agent.set_training_mode(False)
        return lambda seen, legal: agent.get_action(seen, action_mask=legal.astype(int))

    finish(args.kind, greedy(trained), greedy(loaded), wrap=flat)


if __name__ == "__main__":
    main()
