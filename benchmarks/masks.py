"""Microseconds per environment and step for the exact masks of a batch.

Legal edits are drawn from the masks, so each step changes one box of each environment. Only `action_masks()` is timed,
including the copy it returns, in CPU seconds of this process; the result is the median over rounds.
Run: python benchmarks/masks.py [--envs 1 8 64 256 1024] [--id lilgym_mp/ScatterFlipIt-v0] [--grid 19x5]
[--rules release] [--corpus lilgym] [--rounds 5]
"""

from __future__ import annotations

import argparse
import statistics
from time import process_time
from typing import Any

import gymnasium as gym
import numpy as np

import lilgym_mp  # noqa: F401  registers the environments
from lilgym_mp.rules import RULE_SETS

IDS = ("lilgym_mp/TowerFlipIt-v0", "lilgym_mp/ScatterScratch-v0", "lilgym_mp/ScatterFlipIt-v0")
MIN_ENV_STEPS = 3_000  # per round
STOP_SHARE = 1 / 11  # gives episodes of about 11 steps


def sample_legal(masks: np.ndarray, chance: np.random.Generator) -> np.ndarray:
    """(N,) a legal action for each row of `masks` (N, actions): sometimes STOP, otherwise an edit."""
    weights = chance.random(masks.shape, np.float32) * masks
    weights[:, 0] = chance.random(len(masks)) < STOP_SHARE
    return weights.argmax(axis=1)


def microseconds(env: Any, rounds: int, chance: np.random.Generator) -> list[float]:
    """Cost of one environment's mask in each round, except for the first round, which fills the tables."""
    env.reset(seed=0)
    steps = -(-MIN_ENV_STEPS // env.num_envs)
    found: list[float] = []
    for _ in range(1 + rounds):
        spent = 0.0
        for _ in range(steps):
            start = process_time()
            masks = env.action_masks()
            spent += process_time() - start
            env.step(sample_legal(masks, chance))
        found.append(spent / steps / env.num_envs * 1e6)
    return found[1:]


def _grid(text: str) -> tuple[int, int]:
    columns, rows = text.split("x")
    return int(columns), int(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--envs", type=int, nargs="+", default=[1, 8, 64, 256, 1024])
    parser.add_argument("--id", action="append", help=f"default: {', '.join(IDS)}")
    parser.add_argument("--grid", type=_grid, default=(19, 5), help="Scatter grid as COLUMNSxROWS (default: 19x5)")
    parser.add_argument("--rules", choices=sorted(RULE_SETS), default="paper")
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    for env_id in given.id or IDS:
        for count in given.envs:
            settings = {"corpus": given.corpus, "grid": given.grid, "rules": given.rules}
            env: Any = gym.make_vec(env_id, num_envs=count, copy=False, **settings)
            cost = microseconds(env, given.rounds, np.random.default_rng(0))
            spread = f"{min(cost):.1f} .. {max(cost):.1f}"
            print(f"{env_id:30} {count:5} environments  {statistics.median(cost):7.1f} us per mask  ({spread})")
            env.close()


if __name__ == "__main__":
    main()
