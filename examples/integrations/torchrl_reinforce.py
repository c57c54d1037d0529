"""TorchRL: REINFORCE with masks over one environment or a batch, which must have autoreset_mode="Disabled"."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import torch
from flat import ACTIONS, ID, arguments, finish, flat
from tensordict import TensorDict  # pyright: ignore[reportMissingImports]
from tensordict.nn import TensorDictModule  # pyright: ignore[reportMissingImports]
from torch import Tensor, nn
from torchrl.data import Binary  # pyright: ignore[reportMissingImports]
from torchrl.envs import GymWrapper, RewardScaling, TransformedEnv, default_info_dict_reader  # pyright: ignore[reportMissingImports]
from torchrl.modules import MaskedCategorical, ProbabilisticActor  # pyright: ignore[reportMissingImports]

from lilgym_mp.wrappers import action_mask_v0

LIBRARY = "TorchRL"
CELL = ("`MaskedCategorical`, by an info reader", "`evaluate_wrapped`", "TorchRL's transforms, such as `RewardScaling`")
CELLS = {"single": CELL, "batch": CELL}

COUNT = 8


class Masked(nn.Module):
    """Logits, and the mask as bool."""

    def __init__(self, size: int) -> None:
        super().__init__()
        self.network = nn.Sequential(nn.Linear(size, 64), nn.Tanh(), nn.Linear(64, ACTIONS))

    def forward(self, seen: Tensor, legal: Tensor) -> tuple[Tensor, Tensor]:
        return self.network(seen), legal.bool()


def make(kind: str) -> Any:
    if kind == "single":
        env, shape = gym.make(ID, observation="arrays"), (ACTIONS,)
    else:
        env = gym.make_vec(ID, num_envs=COUNT, observation="arrays", autoreset_mode="Disabled")
        shape = (COUNT, ACTIONS)
    wrapped = GymWrapper(action_mask_v0(flat(env)), categorical_action_encoding=True)
    legal = {"action_mask": Binary(shape=shape, dtype=torch.int8)}
    wrapped.set_info_dict_reader(default_info_dict_reader(["action_mask"], spec=legal))
    return TransformedEnv(wrapped, RewardScaling(loc=0.0, scale=0.5))


def actor(size: int) -> Any:
    logits = TensorDictModule(Masked(size), in_keys=["observation", "action_mask"], out_keys=["logits", "mask"])
    return ProbabilisticActor(logits, in_keys=["logits", "mask"], distribution_class=MaskedCategorical)


def main() -> None:
    args = arguments(CELLS)
    torch.set_num_threads(1)
    env = make(args.kind)
    env.set_seed(0)
    size = env.observation_spec["observation"].shape[-1]
    policy, loaded = actor(size), actor(size)
    optimiser = torch.optim.Adam(policy.parameters())
    for _ in range(4):
        with torch.no_grad():
            played = env.rollout(max(1, args.steps // 4 // COUNT), policy, break_when_any_done=False)
        chances = policy.get_dist(played).log_prob(played["action"])
        loss = -(chances * played["next", "reward"].squeeze(-1)).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    torch.save(policy.state_dict(), "policy.pt")
    loaded.load_state_dict(torch.load("policy.pt", weights_only=True))

    def greedy(policy: Any) -> Any:
        def choose(seen: Any, legal: Any) -> Any:
            given = TensorDict({"observation": torch.as_tensor(seen), "action_mask": torch.as_tensor(legal)}, len(seen))
            return policy.get_dist(given).mode.numpy()

        return choose

    finish(args.kind, greedy(policy), greedy(loaded), wrap=flat)


if __name__ == "__main__":
    main()
