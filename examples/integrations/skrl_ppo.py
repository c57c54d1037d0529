"""SKRL: PPO over one environment or a batch, with the mask as part of the observation."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import torch
from flat import ACTIONS, ID, arguments, finish, flat_and_mask
from gymnasium.wrappers import NormalizeReward, vector
from skrl.agents.torch.ppo import PPO, PPO_CFG  # pyright: ignore[reportMissingImports]
from skrl.envs.wrappers.torch import wrap_env  # pyright: ignore[reportMissingImports]
from skrl.memories.torch import RandomMemory  # pyright: ignore[reportMissingImports]
from skrl.models.torch import CategoricalMixin, DeterministicMixin, Model  # pyright: ignore[reportMissingImports]
from skrl.trainers.torch import SequentialTrainer  # pyright: ignore[reportMissingImports]
from torch import nn

LIBRARY = "SKRL"
CELL = (
    "used by the snippet's model: `flat_and_mask` adds them to observations",
    "`evaluate_wrapped`",
    "Gymnasium's `NormalizeReward`",
)
CELLS = {"single": CELL, "batch": CELL}

COUNT = 8


class Policy(CategoricalMixin, Model):
    """Logits of the legal actions."""

    def __init__(self, observation_space: Any, action_space: Any, device: Any) -> None:
        Model.__init__(self, observation_space=observation_space, action_space=action_space, device=device)
        CategoricalMixin.__init__(self, unnormalized_log_prob=True)
        self.network = nn.Sequential(nn.Linear(self.num_observations, 64), nn.Tanh(), nn.Linear(64, ACTIONS))

    def compute(self, inputs: Any, role: str = "") -> Any:
        seen = inputs["observations"]
        return self.network(seen).masked_fill(seen[:, -ACTIONS:] == 0, -1e9), {}


class Value(DeterministicMixin, Model):
    """The critic."""

    def __init__(self, observation_space: Any, action_space: Any, device: Any) -> None:
        Model.__init__(self, observation_space=observation_space, action_space=action_space, device=device)
        DeterministicMixin.__init__(self)
        self.network = nn.Sequential(nn.Linear(self.num_observations, 64), nn.Tanh(), nn.Linear(64, 1))

    def compute(self, inputs: Any, role: str = "") -> Any:
        return self.network(inputs["observations"]), {}


def main() -> None:
    args = arguments(CELLS)
    torch.set_num_threads(1)
    if args.kind == "single":
        env = NormalizeReward(flat_and_mask(gym.make(ID, observation="arrays")))
    else:
        env = vector.NormalizeReward(flat_and_mask(gym.make_vec(ID, num_envs=COUNT, observation="arrays")))
    env = wrap_env(env, wrapper="gymnasium")
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": "cpu"}

    def agent() -> Any:
        models = {"policy": Policy(**spaces), "value": Value(**spaces)}
        memory = RandomMemory(memory_size=16, num_envs=env.num_envs, device="cpu")
        settings = PPO_CFG(rollouts=16, learning_epochs=1, mini_batches=2)
        settings.experiment.write_interval = settings.experiment.checkpoint_interval = 0
        return PPO(models=models, memory=memory, cfg=settings, **spaces)

    trained, loaded = agent(), agent()
    steps = {"timesteps": max(32, args.steps // env.num_envs), "headless": True, "disable_progressbar": True}
    SequentialTrainer(env=env, agents=trained, cfg=steps).train()
    trained.save("agent.pt")
    loaded.load("agent.pt")

    def greedy(agent: Any) -> Any:
        def choose(seen: Any, legal: Any) -> Any:
            with torch.no_grad():
                return agent.models["policy"].compute({"observations": torch.as_tensor(seen)})[0].argmax(-1).numpy()

        return choose

    finish(args.kind, greedy(trained), greedy(loaded), wrap=flat_and_mask)


if __name__ == "__main__":
    main()
