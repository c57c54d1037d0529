"""Kills, stops and interrupts of worker environments at random moments: one clear error, and nobody is left behind.

Run: python -m checks.kills --count 40
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import gymnasium as gym
import numpy as np

from lilgym_mp.envs.workers import WorkerError, WorkerVectorEnv

ID, ENVS, WORKERS = "lilgym_mp/TowerFlipIt-v0", 6, 3
TIMEOUT = 2.0  # seconds for a worker that is stopped
SECONDS = 20.0  # for everybody to be gone
CALLS = ("step", "reset", "states", "masks", "goals")
INTERRUPTED = """
import os, signal, sys
from lilgym_mp.envs.workers import WorkerVectorEnv

if __name__ == "__main__":
    signal.signal(signal.SIGALRM, lambda *_: os.killpg(0, signal.SIGINT))
    signal.setitimer(signal.ITIMER_REAL, float(sys.argv[2]))
    env = WorkerVectorEnv("lilgym_mp/TowerFlipIt-v0", 6, 3, start_method=sys.argv[1])
    env.reset(seed=0)
    while True:
        env.step([0] * 6)
"""


def is_running(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def left_behind(pids: tuple[int, ...]) -> list[int]:
    """Those that still run after SECONDS."""
    end = time.monotonic() + SECONDS
    while any(map(is_running, pids)) and time.monotonic() < end:
        time.sleep(0.02)
    return [pid for pid in pids if is_running(pid)]


def call(env: WorkerVectorEnv, name: str) -> object:
    match name:
        case "step":
            return env.step(np.zeros(ENVS, np.int64))
        case "reset":
            return env.reset()
        case "states":
            return env.states()
        case "masks":
            return env.action_masks()
        case _:
            return env.goal_reached()


def kill_one(chance: random.Random, sent: signal.Signals) -> str:
    """Sends a worker a signal at a random moment of random calls; gives what the caller was told."""
    env = WorkerVectorEnv(ID, ENVS, WORKERS, start_method="fork", timeout_seconds=TIMEOUT)
    env.reset(seed=0)
    pids = env.worker_pids
    moment = chance.randrange(12)
    said = "nothing"
    try:
        for number in range(16):
            if number == moment:
                time.sleep(chance.choice((0.0, 0.0005, 0.003)))
                os.kill(chance.choice(pids), sent)
            call(env, chance.choice(CALLS))
    except WorkerError as error:
        said = "died" if "died by signal" in str(error) else "hung" if "not answered" in str(error) else str(error)
    env.close()
    if still := left_behind(pids):
        raise AssertionError(f"workers {still} are left behind after {sent.name}")
    try:
        env.reset()
    except gym.error.ClosedEnvironmentError:
        return f"{sent.name}: {said}"
    raise AssertionError("a closed environment goes on")


def interrupt(start_method: str, seconds: float) -> str:
    """Interrupts a process group that starts and steps workers; gives how it ended."""
    command = [sys.executable, "-c", INTERRUPTED, start_method, str(seconds)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True) as caller:
        try:
            _, said = caller.communicate(timeout=120)
        finally:
            group = caller.pid
            end = time.monotonic() + SECONDS
            while (still := _members(group)) and time.monotonic() < end:
                time.sleep(0.05)
            if still:
                os.killpg(group, signal.SIGKILL)
                raise AssertionError(f"{start_method} {seconds}: processes {still} are left behind")
    if caller.returncode not in (-signal.SIGINT, 130):
        raise AssertionError(f"{start_method} {seconds}: {said.decode()[-500:]}")
    return f"Ctrl-C, {start_method}: {said.count(b'Traceback')} traceback"


def _members(group: int) -> list[int]:
    """The running processes of a process group."""
    found: list[int] = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if os.getpgid(int(entry.name)) == group and is_running(int(entry.name)):
                    found.append(int(entry.name))
            except ProcessLookupError:
                pass
    return found


def matrix(count: int, interrupts: int, seed: int) -> dict[str, int]:
    """`count` kills and stops, and `interrupts` for each start method; how often each end came."""
    chance = random.Random(seed)
    ends: Counter[str] = Counter()
    for number in range(count):
        ends[kill_one(chance, signal.SIGSTOP if number % 8 == 7 else signal.SIGKILL)] += 1
    for start_method in ("fork", "forkserver", "spawn"):
        for _ in range(interrupts):
            ends[interrupt(start_method, chance.uniform(0.02, 2.5))] += 1
    return dict(ends)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40, help="kills and stops")
    parser.add_argument("--interrupts", type=int, default=10, help="for each start method")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for end, count in sorted(matrix(arguments.count, arguments.interrupts, arguments.seed).items()):
        print(f"{count:4} {end}")


if __name__ == "__main__":
    main()
