"""Steps per second of the batched environment, bare and wrapped: `python benchmarks/wrappers.py [--num-envs 64]`.

Actions are random legal ones drawn beforehand, so choosing them is not timed. All wrapper stacks play the same actions.
Time is CPU time of this process, so other load on the machine matters little.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

import lilgym_mp  # noqa: F401  (registers the environments)
from lilgym_mp.wrappers import (
    action_mask_v0,
    grid_planes_v0,
    structured_observation_v0,
    tokenized_statement_v0,
)

CONFIGURATIONS = ("TowerScratch", "TowerFlipIt", "ScatterScratch", "ScatterFlipIt")
STACKS: dict[str, list[Callable[[Any], Any]]] = {
    "bare": [],
    "mask": [action_mask_v0],
    "tokens": [tokenized_statement_v0],
    "structured": [structured_observation_v0],
    "planes": [grid_planes_v0],
    "mask + tokens + structured": [
        action_mask_v0,
        tokenized_statement_v0,
        structured_observation_v0,
    ],
}


def make(configuration: str, stack: str, num_envs: int) -> Any:
    env = gym.make_vec(f"lilgym_mp/{configuration}-v0", num_envs=num_envs)
    for wrap in STACKS[stack]:
        env = wrap(env)
    return env


def trace(configuration: str, num_envs: int, steps: int) -> np.ndarray[Any, Any]:
    """(steps, num_envs) random legal actions after a reset with seed 0."""
    env: Any = make(configuration, "bare", num_envs)
    env.reset(seed=0)
    generator = np.random.default_rng(0)
    actions = np.zeros((steps, num_envs), np.int64)
    for row in actions:
        row[:] = [generator.choice(np.flatnonzero(mask)) for mask in env.action_masks()]
        env.step(row)
    env.close()
    return actions


def steps_per_second(configuration: str, stack: str, actions: np.ndarray[Any, Any], repeats: int) -> float:
    """The fastest of `repeats` runs over the trace."""
    env = make(configuration, stack, actions.shape[1])
    best = 0.0
    for _ in range(repeats):
        env.reset(seed=0)
        started = time.process_time()
        for row in actions:
            env.step(row)
        best = max(best, actions.size / (time.process_time() - started))
    env.close()
    return best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--steps", type=int, default=300, help="steps of the batch in one run")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    print(f"{options.num_envs} environments, best of {options.repeats} runs, steps per second of CPU time")
    for configuration in CONFIGURATIONS:
        actions = trace(configuration, options.num_envs, options.steps)
        bare = 0.0
        for stack in STACKS:
            speed = steps_per_second(configuration, stack, actions, options.repeats)
            bare = bare or speed
            print(f"{configuration:15} {stack:27} {speed:10,.0f}  {speed / bare:5.0%} of bare")


if __name__ == "__main__":
    main()
