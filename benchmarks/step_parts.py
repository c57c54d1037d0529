"""Microseconds of each part of a batched step, per environment.

Plays as `lilgym-mp bench` does. Clocks are read around the functions of each part, and the time of nested parts is
subtracted, so the sum is slightly more than an unprofiled step takes. Values are medians over rounds.
Run: python benchmarks/step_parts.py [--envs 64] [--configurations TowerFlipIt ScatterFlipIt] [--rounds 15]
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Callable
from statistics import median
from time import perf_counter
from typing import Any

import gymnasium as gym

from lilgym_mp.benchmark.traces import Trace, Workload, vector_trace

WARM_UPS = 3


class Clocks:
    """Time spent in named parts, excluding nested parts."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._within = [0.0]  # time in nested parts, for each open part

    def watch(self, owner: Any, function: str, part: str) -> None:
        """Times a method of an object."""
        watched: Callable[..., Any] = getattr(owner, function)

        def timed(*arguments: Any, **named: Any) -> Any:
            self._within.append(0.0)
            started = perf_counter()
            try:
                return watched(*arguments, **named)
            finally:
                elapsed = perf_counter() - started
                self.seconds[part] += elapsed - self._within.pop()
                self._within[-1] += elapsed

        setattr(owner, function, timed)


def watched_parts(env: Any) -> Clocks:
    """Adds clocks to a batched environment."""
    clocks, core = Clocks(), env._engine.core
    watched = [
        (env, "step", "API: arrays and dicts for the caller"),
        (env, "_images", "copying images for the caller"),
        (env, "_step", "autoreset and task selection"),
        (core, "start", "resets, including their images"),
        (core, "step", "decoding actions, computing outcomes"),
        (core, "_edit", "adding, removing and drawing items"),
        (core, "_scenes_of", "STOP: making scenes"),
        (core, "_solved", "STOP: evaluating programs"),
    ]
    for owner, function, part in watched:
        clocks.watch(owner, function, part)
    return clocks


def rounds_of(env: Any, trace: Trace, rounds: int) -> list[dict[str, float]]:
    """Microseconds per action by part, for each round."""
    clocks = watched_parts(env)
    found: list[dict[str, float]] = []
    for _ in range(WARM_UPS + rounds):
        env.reset(seed=0)
        clocks.seconds.clear()
        for row in trace.rows:
            env.step(row)
        found.append({part: seconds / trace.actions * 1e6 for part, seconds in clocks.seconds.items()})
    return found[WARM_UPS:]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--envs", type=int, default=64)
    parser.add_argument("--configurations", nargs="+", default=["TowerFlipIt", "ScatterFlipIt"])
    parser.add_argument("--rounds", type=int, default=15)
    given = parser.parse_args()
    for configuration in given.configurations:
        workload = Workload(configuration)
        env: Any = gym.make_vec(workload.environment_id, num_envs=given.envs, **workload.arguments)
        trace = vector_trace(workload.scripts(given.envs), env.metadata["autoreset_mode"])
        found = rounds_of(env, trace, given.rounds)
        medians = {part: median(one[part] for one in found) for part in found[0]}
        whole = sum(medians.values())
        print(f"\n{configuration}, {given.envs} environments: {whole:.2f} us")
        for part, cost in sorted(medians.items(), key=lambda item: -item[1]):
            print(f"  {cost:6.2f} us  {cost / whole:4.0%}  {part}")
        env.close()


if __name__ == "__main__":
    main()
