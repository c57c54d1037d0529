"""Compares the speed of this package's environments with that of a checkout of the released lilGym.

    python benchmarks/released_package.py CHECKOUT
    python benchmarks/released_package.py CHECKOUT --data DATA --configuration TowerScratch --episodes 500

Both play the same tasks and the same legal actions side by side, with the release's rules: the release draws a task at
its reset, this package plays the same one, and each action, random and legal, goes to one and then to the other. An
episode ends with a STOP. Only calls of `reset` and `step` are timed. CHECKOUT is a directory that contains the package
`lilgym`, with its requirements installed; DATA has the released JSON files (by default LILGYM_DATA).
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np

import lilgym_mp
from lilgym_mp.envs.registration import CONFIGURATIONS
from lilgym_mp.scene.render import draw

EDITS = 10  # of an episode, before STOP: one action less than the release's horizon
STOP = 0


class Timed:
    """An environment with the seconds that its calls have taken."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self.env, self.seconds = env, 0.0

    def call(self, method: Callable[..., Any], *args: Any, **options: Any) -> Any:
        began = time.perf_counter()
        result = method(*args, **options)
        self.seconds += time.perf_counter() - began
        return result


def same_task(env: Any, observation: Any) -> str:
    """The id of our task with the statement, the target and the image of the release's first observation."""
    for task in env.tasks:
        is_same = task.statement == observation["sentence"] and task.target == bool(observation["target"])
        if is_same and np.array_equal(draw(task.start, "half"), observation["image"]):
            return task.id
    raise LookupError(f"no task starts with this observation: {observation['sentence']!r}")


def play(ours: Timed, release: Timed, rng: np.random.Generator) -> int:
    """Plays an episode in both environments; returns its number of actions."""
    single: Any = ours.env.unwrapped
    observation, _ = release.call(release.env.reset)
    ours.call(ours.env.reset, options={"task": same_task(single, observation)})
    for _ in range(EDITS):
        legal = np.flatnonzero(lilgym_mp.action_masks(ours.env))
        action = int(rng.choice(legal[legal != STOP]))
        listed = single.decode_action(action)
        rewards = [ours.call(ours.env.step, action)[1], release.call(release.env.step, listed)[1]]
        assert rewards[0] == rewards[1], f"the environments differ after {listed}: {rewards}"
    ours.call(ours.env.step, STOP)
    release.call(release.env.step, single.decode_action(STOP))
    return EDITS + 1


def compare(configuration: str, release: gym.Env[Any, Any], data: Path, episodes: int, rounds: int) -> list[float]:
    """How many times the release's seconds are this package's, in each round of episodes."""
    env = gym.make(f"lilgym_mp/{configuration}-v0", corpus=data, split="dev", rules="release")
    rng = np.random.default_rng(0)
    ratios = []
    for _ in range(rounds):
        ours, theirs = Timed(env), Timed(release)
        for _ in range(episodes):
            play(ours, theirs, rng)
        ratios.append(theirs.seconds / ours.seconds)
    return ratios


def released(checkout: Path, configuration: str, data: Path) -> gym.Env[Any, Any]:
    """The released environment."""
    sys.path.insert(0, str(checkout))
    __import__("lilgym")
    return gym.make(f"{configuration}-v0", data=str(data), split="dev")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="directory that contains the package lilgym")
    parser.add_argument("--data", type=Path, default=os.environ.get("LILGYM_DATA"), help="released JSON files")
    parser.add_argument("--configuration", nargs="+", choices=[*CONFIGURATIONS], default=[*CONFIGURATIONS])
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    if args.data is None:
        parser.error("name the released JSON files with --data, or set LILGYM_DATA")
    if not (args.checkout / "lilgym").is_dir():
        parser.error(f"{args.checkout}: contains no package lilgym")
    print("| configuration | times the release: median | least | most |\n| --- | ---: | ---: | ---: |")
    for name in args.configuration:
        found = compare(name, released(args.checkout, name, args.data), args.data, args.episodes, args.rounds)
        print(f"| {name} | {median(found):.0f} | {min(found):.0f} | {max(found):.0f} |")
