"""Trains two RLlib policies at once, one for the proposer and one for the verifier, on a local Ray or a cluster.

RLlib's default networks support neither masks nor nested observations, so both policies use a custom module: it encodes
the scene's colours, the statement and messages, and gives illegal actions no probability.
Needs the extras `rllib` and `pettingzoo`. Run: python examples/rllib_two_policies.py --steps 20000 --runners 1
On a cluster: add --address auto, see docs/distributed.md.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # no usage reports to Ray's developers
os.environ.setdefault("RAY_worker_niceness", "0")  # by default 15, with which runners starve on a busy machine

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

    from lilgym_mp.corpus import write_corpus
    from lilgym_mp.envs.proposer_verifier import AGENTS, parallel_env
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[rllib,pettingzoo]"')

JOINT: dict[str, Any] = {"protocol": "joint", "rewards": "common", "views": "structured"}
GUIDE: dict[str, Any] = {  # the proposer sees neither statement nor target; the verifier has a message for each action
    "protocol": "critique",
    "views": {"proposer_0": {"scene": "structured", "statement": "none", "target": False}, "verifier_0": "structured"},
    "message_size": {"proposer_0": 0, "verifier_0": 13},
}
STATEMENTS = {  # so few that some thousand games show that both agents learn
    "Some block is blue.": "exist(filter_color(all_items, Color.BLUE))",
    "Yellow can be seen.": "exist(filter_color(all_items, Color.YELLOW))",
    "There is a tower.": "exist(filter_obj(all_boxes, lambda b: count(b) >= 2))",
}
ILLEGAL = -1e8  # logit
COLOURS = 5  # none, and the item array's numbers
OTHERS = ("target", "message", "proposal", "refused")  # what an agent may see besides scene and statement
SAMPLE_SECONDS = 600  # RLlib's default timeout of 60 seconds is too short on a busy machine


class MaskedActorCritic(TorchRLModule, ValueFunctionAPI):
    """Policy and value over {"observation": {item_array, and what else the agent sees}, "action_mask": mask}."""

    def setup(self) -> None:
        parts, width = self.observation_space["observation"].spaces, self.model_config["width"]
        boxes, items, _ = parts["item_array"].shape
        words = int(parts["statement"].high.max()) + 1 if "statement" in parts else 1
        self.words = nn.Embedding(words, width, padding_idx=0)
        self.others = {name: getattr(parts[name], "n", 0) for name in OTHERS if name in parts}
        size = boxes * items * COLOURS + sum(count or parts[name].shape[0] for name, count in self.others.items())
        self.scene = nn.Sequential(nn.Linear(size, width), nn.ReLU(), nn.Linear(width, width))
        self.body = nn.Sequential(nn.Linear(2 * width, width), nn.ReLU())
        self.policy, self.value = nn.Linear(width, int(self.action_space.n)), nn.Linear(width, 1)

    def encode(self, observation: dict[str, Any]) -> Tensor:
        """(B, width)"""
        parts = observation["observation"]
        seen = [nn.functional.one_hot(parts["item_array"][..., 3].long() + 1, COLOURS).flatten(1)]
        for name, count in self.others.items():
            part = parts[name]
            if count and part.ndim == 1:  # not yet one-hot
                part = nn.functional.one_hot(part.long(), count)
            seen.append(part if count else part / 10)
        scene = self.scene(torch.cat([each.float() for each in seen], 1))
        read = self.words(parts["statement"].long()).sum(1) if "statement" in parts else torch.ones_like(scene)
        return self.body(torch.cat([scene * read, scene], 1))

    def _forward(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Tensor]:
        logits = self.policy(self.encode(batch[Columns.OBS]))
        return {Columns.ACTION_DIST_INPUTS: logits.masked_fill(batch[Columns.OBS]["action_mask"] == 0, ILLEGAL)}

    def compute_values(self, batch: dict[str, Any], embeddings: Any = None) -> Tensor:
        return self.value(self.encode(batch[Columns.OBS])).squeeze(-1)


def make_game(config: dict[str, Any]) -> ParallelPettingZooEnv:
    common = {"appearance": "tower", "split": "train", "starts": []}
    rows = enumerate(STATEMENTS.items())
    entries = [{"id": f"{n}", "statement": said, "program": program, **common} for n, (said, program) in rows]
    with TemporaryDirectory() as directory:
        corpus = Path(directory) / "three.jsonl"
        write_corpus(corpus, "three", "MIT", entries)
        return ParallelPettingZooEnv(parallel_env(corpus=str(corpus), **config))


def learner(args: argparse.Namespace) -> Any:
    """PPO with one policy per agent."""
    register_env("lilgym_mp_proposer_verifier", make_game)
    module = RLModuleSpec(module_class=MaskedActorCritic, model_config={"width": args.width})
    config = (
        PPOConfig()
        .environment("lilgym_mp_proposer_verifier", env_config=GUIDE if args.guide else JOINT)
        .env_runners(num_env_runners=args.runners, sample_timeout_s=SAMPLE_SECONDS)
        .multi_agent(policies=set(AGENTS), policy_mapping_fn=lambda agent, episode, **kwargs: agent)
        .rl_module(rl_module_spec=MultiRLModuleSpec(rl_module_specs=dict.fromkeys(AGENTS, module)))
        .training(
            lr=1e-3,
            entropy_coeff=0.02,
            train_batch_size_per_learner=args.batch,
            minibatch_size=min(256, args.batch),
            num_epochs=4,
        )
        .debugging(seed=args.seed)
    )
    return config.build_algo()


@contextmanager
def started_ray(address: str | None) -> Iterator[None]:
    """Starts Ray on this machine or connects to the cluster at `address`, and shuts down at the end."""
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


def summary(result: dict[str, Any]) -> str:
    sampled = result["env_runners"]
    returns = sampled.get("agent_episode_returns_mean", {})
    means = "  ".join(f"{agent} {returns.get(agent, float('nan')):+.2f}" for agent in AGENTS)
    return f"{int(sampled['num_env_steps_sampled_lifetime']):8} steps  mean return  {means}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=20_000, help="total number of game steps over all runners")
    parser.add_argument("--batch", type=int, default=1024, help="steps between updates")
    parser.add_argument("--runners", type=int, default=1, help="number of sampling processes; 0 samples in this one")
    parser.add_argument("--width", type=int, default=128, help="width of the networks")
    parser.add_argument("--guide", action="store_true", help="critique with the guide's views instead of joint")
    parser.add_argument(
        "--address", help="address of a running Ray cluster, such as auto (default: start Ray on this machine)"
    )
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    with started_ray(args.address):
        algorithm, result = learner(args), {}
        try:
            while not result or result["env_runners"]["num_env_steps_sampled_lifetime"] < args.steps:
                result = algorithm.train()
                print(summary(result), flush=True)
        finally:
            algorithm.stop()


if __name__ == "__main__":
    main()
