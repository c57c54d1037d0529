"""Trains PPO with action masks in TorchRL, collecting from several environments.

TorchRL accepts neither text nor masks in infos by default: TokenizedStatement turns statements into token ids, and an
info reader copies the mask of ActionMask into the tensordict for the policy's distribution.
Needs the extra `torchrl`. Run: python examples/torchrl_rollout.py --steps 20000
"""

from __future__ import annotations

import argparse
import sys
from functools import partial

import gymnasium as gym

import lilgym_mp  # noqa: F401  (registers the environments)
from lilgym_mp.wrappers import ActionMask, StructuredObservation, TokenizedStatement

try:
    import torch
    from tensordict import TensorDict  # pyright: ignore[reportMissingImports]
    from tensordict.nn import TensorDictModule  # pyright: ignore[reportMissingImports]
    from torch import Tensor, nn
    from torchrl.collectors import Collector  # pyright: ignore[reportMissingImports]
    from torchrl.data import Binary  # pyright: ignore[reportMissingImports]
    from torchrl.envs import (  # pyright: ignore[reportMissingImports]
        EnvBase,
        GymWrapper,
        RewardSum,
        SerialEnv,
        TransformedEnv,
        default_info_dict_reader,
    )
    from torchrl.modules import MaskedCategorical, ProbabilisticActor, ValueOperator  # pyright: ignore[reportMissingImports]
    from torchrl.objectives import ClipPPOLoss  # pyright: ignore[reportMissingImports]
    from torchrl.objectives.value import GAE  # pyright: ignore[reportMissingImports]
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[torchrl]"')

PARTS = ["item_array", "statement", "target"]
MASK = "action_mask"


def make_env(id: str) -> EnvBase:
    """One environment with structured items, token ids, target and mask, and the return of the episode so far."""
    env = ActionMask(TokenizedStatement(StructuredObservation(gym.make(id))))
    wrapped = GymWrapper(env, categorical_action_encoding=True)
    legal = Binary(wrapped.action_spec.space.n, dtype=torch.int8)
    wrapped.set_info_dict_reader(default_info_dict_reader([MASK], spec={MASK: legal}))
    return TransformedEnv(wrapped, RewardSum())


class Network(nn.Module):
    """Maps items and statement to `outputs` values; any number of leading batch axes."""

    def __init__(self, items: int, words: int, outputs: int, width: int) -> None:
        super().__init__()
        self.words = nn.Embedding(words, 32, padding_idx=0)
        self.reader = nn.GRU(32, width, batch_first=True)
        self.scene = nn.Sequential(nn.Linear(items + 1, width), nn.Tanh(), nn.Linear(width, width))
        self.head = nn.Sequential(nn.Linear(2 * width, width), nn.Tanh(), nn.Linear(width, outputs))

    def forward(self, items: Tensor, statement: Tensor, target: Tensor) -> Tensor:
        batch = statement.shape[:-1]
        tokens = statement.reshape(-1, statement.shape[-1]).long()
        states, _ = self.reader(self.words(tokens))
        read = states[torch.arange(len(states)), (tokens > 0).sum(1).clamp(min=1) - 1]
        scaled = items.reshape(len(tokens), -1) / 100
        scene = self.scene(torch.cat([scaled, target.reshape(len(tokens), 1).float()], 1))
        return self.head(torch.cat([scene * read, read], 1)).view(*batch, -1)


class LegalPolicy(nn.Module):
    """Logits, and the mask as a bool tensor for the distribution."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.network = network

    def forward(self, items: Tensor, statement: Tensor, target: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        return self.network(items, statement, target), mask.bool()


def actor_and_critic(env: EnvBase, width: int) -> tuple[ProbabilisticActor, ValueOperator]:
    spec = env.observation_spec
    items, words = spec["item_array"].shape.numel(), int(spec["statement"].space.high.max()) + 1
    policy = TensorDictModule(
        LegalPolicy(Network(items, words, env.action_spec.space.n, width)),
        in_keys=[*PARTS, MASK],
        out_keys=["logits", "mask"],
    )
    actor = ProbabilisticActor(
        policy,
        in_keys=["logits", "mask"],
        spec=env.action_spec,
        distribution_class=MaskedCategorical,
        return_log_prob=True,
    )
    return actor, ValueOperator(Network(items, words, 1, width), in_keys=PARTS)


def update(loss: ClipPPOLoss, optimiser: torch.optim.Optimizer, batch: TensorDict, epochs: int, minibatch: int) -> None:
    """The PPO epochs over one batch."""
    for _ in range(epochs):
        for chosen in torch.randperm(len(batch)).split(minibatch):
            losses = loss(batch[chosen])
            optimiser.zero_grad()
            (losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]).backward()
            nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
            optimiser.step()


def summary(steps: int, batch: TensorDict) -> str:
    ended = batch["next", "done"].squeeze(-1)
    legal = batch[MASK].gather(-1, batch["action"].unsqueeze(-1)).float().mean()
    mean = batch["next", "episode_reward"][ended].mean()
    return f"{steps:8} steps  mean return {mean:+.2f} of {int(ended.sum())} episodes  legal actions {legal:.0%}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--id", default="lilgym_mp/TowerScratch-v0")
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--envs", type=int, default=8)
    parser.add_argument("--batch", type=int, default=1024, help="steps between updates")
    parser.add_argument("--width", type=int, default=128, help="width of the networks")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)

    envs = SerialEnv(args.envs, partial(make_env, args.id))
    envs.set_seed(args.seed)
    actor, critic = actor_and_critic(make_env(args.id), args.width)
    advantage = GAE(gamma=0.99, lmbda=0.95, value_network=critic, deactivate_vmap=True)  # vmap does not support GRU
    loss = ClipPPOLoss(actor, critic, entropy_coeff=0.02, critic_coeff=0.5, normalize_advantage=True)
    optimiser = torch.optim.Adam(loss.parameters(), 1e-3)
    collector = Collector(
        envs, actor, frames_per_batch=args.batch, total_frames=args.steps, auto_register_policy_transforms=False
    )
    collected = 0
    try:
        for batch in collector:
            with torch.no_grad():
                advantage(batch)
            collected += batch.numel()
            update(loss, optimiser, batch.reshape(-1), epochs=4, minibatch=min(256, args.batch))
            print(summary(collected, batch), flush=True)
    finally:
        collector.shutdown()


if __name__ == "__main__":
    main()
