"""Turns per second of CPU time of 64 games of critique with the guide's views, with and without the reward `progress`.

Both agents play random legal actions, so most scenes are new to the expert. Only `step` is timed.

Run: python benchmarks/progress_reward.py [CONFIGURATION] [--corpus lilgym] [--turns 600]
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

from lilgym_mp.envs.proposer_verifier.batched import BatchedGames

GAMES = 64
TERMS: dict[str, Any] = {"success": "mdp", "success and progress": {"mdp": 1, "progress": 0.3}}


def rate(configuration: str, corpus: str, rewards: Any, turns: int) -> float:
    """Turns per second of CPU time."""
    games = BatchedGames(
        GAMES,
        configuration=configuration,
        corpus=corpus,
        protocol="critique",
        views="guide",
        rewards={"proposer_0": rewards, "verifier_0": rewards},
    )
    observations, _ = games.reset(seed=0)
    rng, seconds = np.random.default_rng(0), 0.0
    for _ in range(turns):
        masks = {agent: np.asarray(seen["action_mask"]) for agent, seen in observations.items()}
        actions = {agent: (mask * rng.random(mask.shape)).argmax(1) for agent, mask in masks.items()}
        start = time.process_time()
        observations = games.step(actions)[0]
        seconds += time.process_time() - start
    return GAMES * turns / seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("configuration", nargs="?", default="TowerScratch")
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--turns", type=int, default=600)
    args = parser.parse_args()
    for name, rewards in TERMS.items():
        rate(args.configuration, args.corpus, rewards, 5)  # compiles
        print(f"{name}: {rate(args.configuration, args.corpus, rewards, args.turns):,.0f} turns/s")


if __name__ == "__main__":
    main()
