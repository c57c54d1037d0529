"""Compares the speed of two checkouts of this package on the workloads of `lilgym-mp bench`, in turns.

Run: python benchmarks/side_by_side.py OLD NEW TowerFlipIt --rounds 35
Prints NEW's steps per second of CPU time relative to OLD's: the median of seven groups of rounds.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from statistics import median

WAYS = ("single", "batched")


def serve(names: list[str]) -> None:
    """Prints the CPU seconds of a step, the best of three plays, for each case named on standard input."""
    from lilgym_mp.cli import bench
    from lilgym_mp.envs.config import EnvConfig

    bench.perf_counter = time.process_time
    with ExitStack() as stack:
        players = {}
        for name in names:
            workload = bench.Workload(EnvConfig(name), bench.FIXED, 1_100)
            for case in bench.cases([64]):
                if case.name in WAYS and case.workload == bench.FIXED:
                    players[f"{name} {case.name}"] = stack.enter_context(case.open(workload, case.num_envs))
        for player in players.values():
            player.play()
        print(",".join(players), flush=True)
        for line in sys.stdin:
            player = players[line.strip()]
            print(min(player.play() for _ in range(3)) / player.steps, flush=True)


class Checkout:
    """A process that measures one checkout."""

    def __init__(self, path: Path, names: list[str]) -> None:
        environment = {**os.environ, "PYTHONPATH": str(path.absolute()), "OMP_NUM_THREADS": "1"}
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._process = subprocess.Popen([sys.executable, __file__, "--serve", *names], env=environment, **pipes)
        self.cases = self._read().split(",")

    def _read(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def seconds(self, case: str) -> float:
        assert self._process.stdin is not None
        print(case, file=self._process.stdin, flush=True)
        return float(self._read())


def main() -> None:
    if sys.argv[1:2] == ["--serve"]:
        serve(sys.argv[2:])
        return
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("configurations", nargs="+")
    parser.add_argument("--rounds", type=int, default=35)
    args = parser.parse_args()
    old, new = (Checkout(path, args.configurations) for path in (args.old, args.new))
    for case in old.cases:
        ratios: list[float] = []
        for index in range(args.rounds):
            order = (old, new) if index % 2 else (new, old)
            seconds = {checkout: checkout.seconds(case) for checkout in order}
            ratios.append(seconds[old] / seconds[new])
        groups = [median(ratios[first::7]) for first in range(min(7, args.rounds))]
        print(f"{case:24} {median(groups):.3f}", flush=True)


if __name__ == "__main__":
    main()
