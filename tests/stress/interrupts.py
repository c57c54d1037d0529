"""Ctrl-C for the whole process group of a command at a random moment: no traceback, and no process left over.

Run: python -m tests.stress.interrupts --count 21
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter

COMMANDS = (
    "train ppo TowerScratch --steps 100000 --out run",
    "train imitation TowerScratch --minutes 1 --out run",
    "train parse-and-plan --updates 500 --out run",
    "demo --out run",
    "serve --port 0 --database sqlite:///web.sqlite3",
    "evaluate --policy expert --configuration ScatterFlipIt --record records",
    "data synthesize builtin --output new.jsonl.gz",
)
SHORTEST_RUN, LONGEST_RUN = 3.0, 10.0  # seconds before Ctrl-C; sooner, while Python imports, it shows its traceback
PATIENCE = 60.0  # seconds to end after it


def interrupted(words: str, seconds: float) -> str:
    """The exit code of a command interrupted after some seconds. Raises AssertionError for a traceback or a process
    left over."""
    with tempfile.TemporaryDirectory() as directory:
        process = subprocess.Popen(
            [sys.executable, "-m", "lilgym_mp", *words.split()],
            cwd=directory, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        try:
            process.wait(seconds)
            ended = "ended before"
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGINT)
            ended = "interrupted"
        output, errors = process.communicate(timeout=PATIENCE)
    assert "Traceback" not in output + errors, (words, seconds, errors)
    listed = subprocess.run(["ps", "-eo", "pgid"], capture_output=True, text=True, check=True).stdout.split()
    assert str(process.pid) not in listed, (words, seconds)
    return f"{words.split()[0]}: {ended}, exit code {process.returncode}"


def interrupts(count: int, seed: int) -> Counter[str]:
    """Outcomes of `count` interrupted commands, in turn."""
    rng = random.Random(seed)
    outcomes = Counter[str]()
    for index in range(count):
        begun = time.monotonic()
        outcomes[interrupted(COMMANDS[index % len(COMMANDS)], rng.uniform(SHORTEST_RUN, LONGEST_RUN))] += 1
        assert time.monotonic() - begun < LONGEST_RUN + PATIENCE
    return outcomes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=21)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # children of a shell's background job would ignore it
    for outcome, number in sorted(interrupts(args.count, args.seed).items()):
        print(f"{outcome}: {number}")


if __name__ == "__main__":
    main()
