"""Checks that memory stays constant during millions of steps of batched random legal play.

Every step takes a random legal action in each environment, STOP included, and computes images, masks and the truth of
programs. Resident memory is read after garbage collection. The last line compares the mean of the second half with
that of the second quarter, because caches fill at the beginning.
Run: python -m tests.stress.soak [--steps 5000000] [--configuration ScatterFlipIt] [--num-envs 256]
"""

from __future__ import annotations

import argparse
import gc
from collections.abc import Iterator
from pathlib import Path
from statistics import mean
from time import perf_counter
from typing import Any

import gymnasium as gym
import numpy as np

import lilgym_mp
from lilgym_mp.evaluation.settings import CONFIGURATIONS

MEGABYTE = 1e6
READINGS = 20
PAGE_BYTES = 4096
ALLOWED_GROWTH = 0.02  # of resident memory, from the second quarter to the second half


def resident_megabytes() -> float:
    """Resident memory of this process, from Linux's /proc."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * PAGE_BYTES / MEGABYTE


def legal_actions(env: Any, rng: np.random.Generator) -> np.ndarray[Any, Any]:
    """(N,) a uniformly random legal action for each environment."""
    masks = env.action_masks()
    drawn = (rng.random(len(masks)) * masks.sum(1)).astype(np.int64)
    return (masks.cumsum(1) > drawn[:, None]).argmax(1)


def readings(configuration: str, num_envs: int, steps: int) -> Iterator[tuple[int, float, int]]:
    """Yields steps taken, resident megabytes and episodes ended, READINGS times."""
    env: Any = gym.make_vec(f"lilgym_mp/{configuration}-v0", num_envs=num_envs)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    calls = -(-steps // num_envs)
    episodes = 0
    marks = {calls * mark // READINGS for mark in range(1, READINGS + 1)}
    for call in range(1, calls + 1):
        _, _, terminated, truncated, _ = env.step(legal_actions(env, rng))
        env.goal_reached()
        episodes += int((terminated | truncated).sum())
        if call in marks:
            yield call * num_envs, resident_megabytes(), episodes
    env.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=5_000_000)
    parser.add_argument("--configuration", choices=list(CONFIGURATIONS), default="ScatterFlipIt")
    parser.add_argument("--num-envs", type=int, default=256)
    args = parser.parse_args()
    if args.steps < READINGS * args.num_envs:
        parser.error(f"--steps must be at least {READINGS * args.num_envs}, {READINGS} per environment")
    print(f"lilgym_mp {lilgym_mp.__version__}, {args.configuration}, {args.num_envs} environments")
    print(f"{'steps':>12} {'episodes':>12} {'resident MB':>12} {'seconds':>8}")
    started, megabytes = perf_counter(), list[float]()
    for steps, resident, episodes in readings(args.configuration, args.num_envs, args.steps):
        megabytes.append(resident)
        print(f"{steps:12,} {episodes:12,} {resident:12.1f} {perf_counter() - started:8.0f}", flush=True)
    before, after = mean(megabytes[READINGS // 4 : READINGS // 2]), mean(megabytes[READINGS // 2 :])
    grows = after > before * (1 + ALLOWED_GROWTH)
    print(
        f"{'GROWS' if grows else 'constant'}: {before:.1f} MB in the second quarter, {after:.1f} MB in the second half"
    )
    raise SystemExit(grows)


if __name__ == "__main__":
    main()
