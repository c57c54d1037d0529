"""Gymnasium and PyTorch alone: REINFORCE with masks over one environment, a batch, or workers."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import torch
from flat import ACTIONS, ID, arguments, finish, flat
from gymnasium.wrappers import NormalizeReward, vector
from torch import Tensor, nn

from lilgym_mp import action_masks
from lilgym_mp.envs.workers import WorkerVectorEnv

LIBRARY = "PyTorch alone"
CELL = ("in the loss", "`evaluate_wrapped`", "Gymnasium's `NormalizeReward`")
CELLS = {"single": CELL, "batch": CELL, "workers": CELL}

COUNT = 8


def make(kind: str) -> Any:
    if kind == "single":
        return NormalizeReward(flat(gym.make(ID, observation="arrays")))
    makers = {"batch": lambda: gym.make_vec(ID, num_envs=COUNT, observation="arrays")}
    makers["workers"] = lambda: WorkerVectorEnv(ID, COUNT, 2, observation="arrays")
    return vector.NormalizeReward(flat(makers[kind]()))


def distribution(network: nn.Module, seen: Any, legal: Any) -> torch.distributions.Categorical:
    logits: Tensor = network(torch.as_tensor(seen).float())
    return torch.distributions.Categorical(logits=logits.masked_fill(~torch.as_tensor(legal), -1e9))


def main() -> None:
    args = arguments(CELLS)
    torch.set_num_threads(1)
    envs = make(args.kind)
    seen, _ = envs.reset(seed=0)
    network = nn.Sequential(nn.Linear(seen.shape[-1], 64), nn.Tanh(), nn.Linear(64, ACTIONS))
    optimiser = torch.optim.Adam(network.parameters())
    for _ in range(args.steps // COUNT):
        policy = distribution(network, seen, action_masks(envs))
        actions = policy.sample()
        seen, rewards, terminated, truncated, _ = envs.step(actions.numpy() if actions.ndim else int(actions))
        loss = -(policy.log_prob(actions) * torch.as_tensor(rewards)).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        if args.kind == "single" and (terminated or truncated):  # batches reset themselves
            seen, _ = envs.reset()
    envs.close()
    torch.save(network.state_dict(), "network.pt")
    loaded = nn.Sequential(nn.Linear(seen.shape[-1], 64), nn.Tanh(), nn.Linear(64, ACTIONS))
    loaded.load_state_dict(torch.load("network.pt", weights_only=True))
    greedy = [
        lambda seen, legal, net=net: distribution(net, seen, legal).logits.argmax(-1).numpy()
        for net in (network, loaded)
    ]
    finish(args.kind, *greedy, wrap=flat)


if __name__ == "__main__":
    main()
