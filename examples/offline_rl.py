"""Offline reinforcement learning with d3rlpy (discrete CQL), against behaviour cloning with the same network.

    lilgym-mp data collect TowerScratch --episodes 3000 --quality mixed --observation structured --out mixed.npz
    python examples/offline_rl.py mixed.npz --method cql
    python examples/offline_rl.py mixed.npz --method bc
The observation is one vector: token ids, colours of the blocks and the target. Needs d3rlpy and the extra `train`.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from lilgym_mp.wrappers import StructuredObservation

try:
    import d3rlpy  # pyright: ignore[reportMissingImports]
    import torch
    from torch import Tensor, nn
except ImportError as missing:
    sys.exit(f"SKIPPED: {missing.name} is not installed; pip install d3rlpy torch")

BATCH, LEARNING_RATE = 256, 5e-4
WIDTH, COLOUR, ACTIONS = 64, 3, 13  # COLOUR: index of an item's colour in `item_array`; actions of Tower


class Reader(d3rlpy.models.torch.Encoder):
    """Boxes and the target attend to the statement's words; reads (B, tokens + 12 + 1) vectors."""

    def __init__(self, length: int) -> None:
        super().__init__()
        self.length = length
        self.words = nn.Embedding(1024, WIDTH, padding_idx=0)
        self.places = nn.Parameter(torch.randn(length, WIDTH) * 0.02)
        self.text = nn.TransformerEncoderLayer(WIDTH, 4, 2 * WIDTH, 0.0, batch_first=True, norm_first=True)
        self.blocks = nn.Linear(16, WIDTH)
        self.target = nn.Embedding(2, WIDTH)
        self.read = nn.TransformerDecoderLayer(WIDTH, 4, 2 * WIDTH, 0.0, batch_first=True, norm_first=True)
        self.out = nn.Sequential(nn.Linear(4 * WIDTH, 4 * WIDTH), nn.ReLU())

    def forward(self, x: Tensor) -> Tensor:
        tokens = x[:, : self.length].long()
        padding = tokens == 0
        words = self.text(self.words(tokens) + self.places, src_key_padding_mask=padding)
        colours = nn.functional.one_hot(x[:, self.length : -1].long() + 1, 4).float().reshape(len(x), 3, 16)
        vectors = torch.cat([self.blocks(colours), self.target(x[:, -1:].long())], 1)
        return self.out(self.read(vectors, words, memory_key_padding_mask=padding).flatten(1))


@dataclasses.dataclass()
class ReaderFactory(d3rlpy.models.EncoderFactory):
    length: int

    def create(self, observation_shape: Any) -> Reader:
        return Reader(self.length)

    @staticmethod
    def get_type() -> str:
        return "lilgym_reader"


def vectors(tokens: np.ndarray, items: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(N, tokens + 12 + 1) float32."""
    colours = items[..., COLOUR].reshape(len(items), -1)
    return np.concatenate([tokens, colours, target.reshape(-1, 1)], 1).astype(np.float32)


def accuracy(algorithm: Any, env: Any) -> float:
    """The share of dev's tasks solved."""
    solved = 0
    for task_id in env.unwrapped.tasks.ids:
        observation, info = env.reset(options={"task": task_id})
        while "is_success" not in info:
            seen = vectors(observation["statement"][None], observation["item_array"][None], observation["target"])
            action = int(algorithm.predict(seen)[0])  # neither method uses the mask
            observation, *_, info = env.step(action)
        solved += info["is_success"]
    return solved / len(env.unwrapped.tasks)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="a data set of TowerScratch with structured observations")
    parser.add_argument("--method", choices=["cql", "bc"], default="cql")
    parser.add_argument("--updates", type=int, default=1_000, help="updates of the optimiser")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    d3rlpy.seed(args.seed)
    data = np.load(args.file)
    lengths = np.diff(data["starts"])
    tokens, target = (data[name].repeat(lengths, 0) for name in ("tokens", "target"))
    dataset = d3rlpy.dataset.MDPDataset(
        vectors(tokens, data["item_array"], target),
        data["action"][:, None],
        data["reward"][:, None],
        data["terminated"].astype(np.float32),
        data["truncated"].astype(np.float32),
        action_space=d3rlpy.ActionSpace.DISCRETE,
        action_size=ACTIONS,
    )
    env = StructuredObservation(gym.make("lilgym_mp/TowerScratch-v0", split="dev", observation="arrays"), slots=4)
    options: dict[str, Any] = {
        "batch_size": BATCH,
        "learning_rate": LEARNING_RATE,
        "encoder_factory": ReaderFactory(tokens.shape[1]),
    }
    config = (
        d3rlpy.algos.DiscreteCQLConfig(**options) if args.method == "cql" else d3rlpy.algos.DiscreteBCConfig(**options)
    )
    algorithm = config.create(device="cpu:0")
    algorithm.build_with_dataset(dataset)
    print(f"{args.method}: {len(tokens):,} actions of {len(lengths):,} episodes\nupdates  dev", flush=True)
    for update in range(1, args.updates + 1):
        algorithm.update(dataset.sample_transition_batch(BATCH))
        if update % max(1, args.updates // 10) == 0:
            print(f"{update:7,}  {accuracy(algorithm, env):.3f}", flush=True)


if __name__ == "__main__":
    main()
