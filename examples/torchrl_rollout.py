"""PPO in TorchRL: a collector plays several environments, and the policy keeps to the mask of legal actions.

TorchRL takes neither texts nor masks from infos by itself: TokenizedStatement turns statements into word numbers, and
an info reader lifts the mask of ActionMask into the tensordict, where the policy's distribution finds it.
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
    """One environment: structured items, word numbers, the target and the mask, and each episode's return so far."""
    env = ActionMask(TokenizedStatement(StructuredObservation(gym.make(id))))
    wrapped = GymWrapper(env, categorical_action_encoding=True)
    legal = Binary(wrapped.action_spec.space.n, dtype=torch.int8)
    wrapped.set_info_dict_reader(default_info_dict_reader([MASK], spec={MASK: legal}))
    return TransformedEnv(wrapped, RewardSum())


class Network(nn.Module):
    """Items, times a reading of the statement, to `outputs` numbers; any number of leading batch axes."""

    def __init__(self, items: int, words: int, outputs: int, width: int) -> None:
        super().__init__()
        self.words = nn.Embedding(words, 32, padding_idx=0)
        self.reader = nn.GRU(32, width, batch_first=True)
        self.scene = nn.Sequential(nn.Linear(items + 1, width), nn.Tanh(), nn.Linear(width, width))
        self.head = nn.Sequential(nn.Linear(2 * width, width), nn.Tanh(), nn.Linear(width, outputs))

    def forward(self, items: Tensor, statement: Tensor, target: Tensor) -> Tensor:
        batch = statement.shape[:-1]
        numbers = statement.reshape(-1, statement.shape[-1]).long()
        states, _ = self.reader(self.words(numbers))
        read = states[torch.arange(len(states)), (numbers > 0).sum(1).clamp(min=1) - 1]
        scaled = items.reshape(len(numbers), -1) / 100
        scene = self.scene(torch.cat([scaled, target.reshape(len(numbers), 1).float()], 1))
        return self.head(torch.cat([scene * read, read], 1)).view(*batch, -1)


class LegalPolicy(nn.Module):
    """Logits, and the mask as the distribution wants it."""

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
    """PPO's epochs over one batch."""
    for _ in range(epochs):
        for chosen in torch.randperm(len(batch)).split(minibatch):
            losses = loss(batch[chosen])
            optimiser.zero_grad()
            (losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]).backward()
            nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
            optimiser.step()


def told(steps: int, batch: TensorDict) -> str:
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
    parser.add_argument("--width", type=int, default=128, help="of the networks")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(given.seed)

    envs = SerialEnv(given.envs, partial(make_env, given.id))
    envs.set_seed(given.seed)
    actor, critic = actor_and_critic(make_env(given.id), given.width)
    advantage = GAE(gamma=0.99, lmbda=0.95, value_network=critic, deactivate_vmap=True)  # vmap knows no GRU
    loss = ClipPPOLoss(actor, critic, entropy_coeff=0.02, critic_coeff=0.5, normalize_advantage=True)
    optimiser = torch.optim.Adam(loss.parameters(), 1e-3)
    collector = Collector(
        envs, actor, frames_per_batch=given.batch, total_frames=given.steps, auto_register_policy_transforms=False
    )
    collected = 0
    try:
        for batch in collector:
            with torch.no_grad():
                advantage(batch)
            collected += batch.numel()
            update(loss, optimiser, batch.reshape(-1), epochs=4, minibatch=min(256, given.batch))
            print(told(collected, batch), flush=True)
    finally:
        collector.shutdown()


if __name__ == "__main__":
    main()
