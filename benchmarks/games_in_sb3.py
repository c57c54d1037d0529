"""Turns per second of the two-agent game in Stable-Baselines3, side by side: `make_game_vec_env` and SuperSuit's
`concat_vec_envs_v1`, both agents' random legal actions, masks included.

Run: python benchmarks/games_in_sb3.py --games 64 --turns 100
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np
import supersuit
from sb3_contrib.common.maskable.utils import get_action_masks

from lilgym_mp.envs.proposer_verifier import parallel_env
from lilgym_mp.sb3 import InfoMasks, make_game_vec_env

GAMES: dict[str, dict[str, Any]] = {
    f"{protocol}, {views}": {"protocol": protocol, "views": views}
    for protocol in ("veto", "joint")
    for views in ("structured", "image")
}


def batched(games: int, settings: dict[str, Any]) -> Any:
    return make_game_vec_env(games, monitor=False, **settings)


def concatenated(games: int, settings: dict[str, Any]) -> Any:
    game = parallel_env(homogeneous=True, observations="vector", **settings)
    return InfoMasks(
        supersuit.concat_vec_envs_v1(
            supersuit.pettingzoo_env_to_vec_env_v1(game), games, num_cpus=0, base_class="stable_baselines3"
        )
    )


def rate(env: Any, games: int, turns: int) -> float:
    """Turns of all games per second."""
    rng, start = np.random.default_rng(0), time.perf_counter()
    for _ in range(turns):
        masks = get_action_masks(env)
        env.step((masks * rng.random(masks.shape)).argmax(1))
    return games * turns / (time.perf_counter() - start)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--games", type=int, default=64)
    parser.add_argument("--turns", type=int, default=100, help="in a round")
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    makers: tuple[Callable[[int, dict[str, Any]], Any], ...] = (batched, concatenated)
    print("game | make_game_vec_env | SuperSuit | ratio, by round")
    for name, settings in GAMES.items():
        envs = [make(args.games, settings) for make in makers]
        for env in envs:
            env.reset()
            rate(env, args.games, 5)  # compiles
        found = np.array([[rate(env, args.games, args.turns) for env in envs] for _ in range(args.rounds)])
        own, other = np.median(found, axis=0)
        print(f"{name} | {own:,.0f} | {other:,.0f} | {median(found[:, 0] / found[:, 1]):.1f}", flush=True)


if __name__ == "__main__":
    main()
