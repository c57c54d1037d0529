"""Two RLlib policies learn at once, one for the proposer and one for the verifier, on a Ray that may be local or not.

RLlib's default networks can neither keep to masks nor take nested observations, so both policies are a module of
ours: it reads the structured scene and the statement's words, and gives illegal actions no probability.
Needs the extras `rllib` and `pettingzoo`. Run: python examples/rllib_two_policies.py --steps 20000 --runners 1
On a cluster: add --address auto, see docs/distributed.md.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from gymnasium import spaces

os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # Ray reports its use to its makers unless told not to

try:
    import ray  # pyright: ignore[reportMissingImports]
    import torch
    from ray.rllib.algorithms.ppo import PPOConfig  # pyright: ignore[reportMissingImports]
    from ray.rllib.core.columns import Columns  # pyright: ignore[reportMissingImports]
    from ray.rllib.core.rl_module.apis import ValueFunctionAPI  # pyright: ignore[reportMissingImports]
    from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec  # pyright: ignore[reportMissingImports]
    from ray.rllib.core.rl_module.rl_module import RLModuleSpec  # pyright: ignore[reportMissingImports]
    from ray.rllib.core.rl_module.torch import TorchRLModule  # pyright: ignore[reportMissingImports]
    from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv  # pyright: ignore[reportMissingImports]
    from ray.tune.registry import register_env  # pyright: ignore[reportMissingImports]
    from torch import Tensor, nn

    from lilgym_mp.envs.proposer_verifier import AGENTS, parallel_env
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[rllib,pettingzoo]"')

GAME: dict[str, Any] = {
    "appearance": "tower",
    "start": "scratch",
    "protocol": "joint",
    "rewards": "common",
    "views": "structured",
}
ILLEGAL = -1e8  # logit
WORD_WIDTH = 32
SAMPLE_SECONDS = 600  # after which RLlib drops what a runner plays; its 60 are too few on a busy machine


class MaskedActorCritic(TorchRLModule, ValueFunctionAPI):
    """Policy and value over {"observation": {"statement": word numbers, other parts}, "action_mask": mask}."""

    def setup(self) -> None:
        parts, width = self.observation_space["observation"], self.model_config["width"]
        self.others = {name: space for name, space in parts.items() if name != "statement"}
        read = sum(spaces.flatdim(space) for space in self.others.values())
        self.words = nn.Embedding(int(parts["statement"].high.max()) + 1, WORD_WIDTH, padding_idx=0)
        self.statement = nn.GRU(WORD_WIDTH, width, batch_first=True)
        self.scene = nn.Sequential(nn.Linear(read, width), nn.Tanh(), nn.Linear(width, width))
        self.body = nn.Sequential(nn.Linear(2 * width, width), nn.Tanh())
        self.policy, self.value = nn.Linear(width, int(self.action_space.n)), nn.Linear(width, 1)

    def embedded(self, seen: dict[str, Any]) -> Tensor:
        """(B, width)"""
        statement = seen["observation"]["statement"].long()
        states, _ = self.statement(self.words(statement))
        read = states[torch.arange(len(states)), (statement > 0).sum(1).clamp(min=1) - 1]
        scene = self.scene(
            torch.cat([numbers(space, seen["observation"][name]) for name, space in self.others.items()], 1)
        )
        return self.body(torch.cat([scene * read, read], 1))

    def _forward(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Tensor]:
        logits = self.policy(self.embedded(batch[Columns.OBS]))
        return {Columns.ACTION_DIST_INPUTS: logits.masked_fill(batch[Columns.OBS]["action_mask"] == 0, ILLEGAL)}

    def compute_values(self, batch: dict[str, Any], embeddings: Any = None) -> Tensor:
        return self.value(self.embedded(batch[Columns.OBS])).squeeze(-1)


def numbers(space: spaces.Space[Any], values: Tensor) -> Tensor:
    """(B, numbers) a part within -1 .. 1: scaled by its bounds, or one-hot where it is Discrete."""
    if isinstance(space, spaces.Discrete):
        if values.ndim == 1:
            values = nn.functional.one_hot(values.long(), int(space.n))
        return values.float()
    assert isinstance(space, spaces.Box)
    return (values.float() / float(max(abs(space.low.min()), space.high.max()))).flatten(1)


def make_game(config: dict[str, Any]) -> ParallelPettingZooEnv:
    return ParallelPettingZooEnv(parallel_env(**config))


def learner(given: argparse.Namespace) -> Any:
    """PPO with a policy of its own for each agent."""
    register_env("lilgym_mp_proposer_verifier", make_game)
    module = RLModuleSpec(module_class=MaskedActorCritic, model_config={"width": given.width})
    config = (
        PPOConfig()
        .environment("lilgym_mp_proposer_verifier", env_config=GAME)
        .env_runners(num_env_runners=given.runners, sample_timeout_s=SAMPLE_SECONDS)
        .multi_agent(policies=set(AGENTS), policy_mapping_fn=lambda agent, episode, **kwargs: agent)
        .rl_module(rl_module_spec=MultiRLModuleSpec(rl_module_specs=dict.fromkeys(AGENTS, module)))
        .training(
            lr=1e-3,
            entropy_coeff=0.02,
            train_batch_size_per_learner=given.batch,
            minibatch_size=min(256, given.batch),
            num_epochs=4,
        )
        .debugging(seed=given.seed)
    )
    return config.build_algo()


@contextmanager
def started_ray(address: str | None) -> Iterator[None]:
    """A Ray of our own on this machine, or the cluster at `address`; left again at the end."""
    if address is None:
        ray.init(include_dashboard=False, log_to_driver=False)
    else:
        ray.init(address=address, log_to_driver=False)
    try:
        print(
            f"Ray {ray.__version__} on {len(ray.nodes())} node(s), {ray.cluster_resources()['CPU']:.0f} CPUs",
            flush=True,
        )
        yield
    finally:
        ray.shutdown()


def told(result: dict[str, Any]) -> str:
    sampled = result["env_runners"]
    returns = sampled.get("agent_episode_returns_mean", {})
    means = "  ".join(f"{agent} {returns.get(agent, float('nan')):+.2f}" for agent in AGENTS)
    return f"{int(sampled['num_env_steps_sampled_lifetime']):8} steps  mean return  {means}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=20_000, help="steps of the game, over all runners")
    parser.add_argument("--batch", type=int, default=1024, help="steps between updates")
    parser.add_argument("--runners", type=int, default=1, help="processes that play; 0 plays in this one")
    parser.add_argument("--width", type=int, default=128, help="of the networks")
    parser.add_argument("--address", help="of a running Ray cluster, such as auto; without it one is started here")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    with started_ray(given.address):
        algorithm, result = learner(given), {}
        try:
            while not result or result["env_runners"]["num_env_steps_sampled_lifetime"] < given.steps:
                result = algorithm.train()
                print(told(result), flush=True)
        finally:
            algorithm.stop()


if __name__ == "__main__":
    main()
