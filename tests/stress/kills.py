"""Kills, stops and interrupts workers at random moments: the caller gets one clear error, and no process survives.

Run: python -m tests.stress.kills --count 40
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
TIMEOUT = 2.0  # seconds until a stopped worker counts as hung
EXIT_SECONDS = 20.0  # within which all processes must have ended
CALLS = ("step", "reset", "states", "masks", "goals")
INTERRUPTED = """
import faulthandler, os, signal, sys
from lilgym_mp.envs.workers import WorkerVectorEnv

if __name__ == "__main__":
    signal.signal(signal.SIGALRM, lambda *_: os.killpg(0, signal.SIGINT))
    signal.setitimer(signal.ITIMER_REAL, float(sys.argv[2]), 30)  # again, if an extension module swallowed it
    faulthandler.dump_traceback_later(60)
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


def survivors(pids: tuple[int, ...]) -> list[int]:
    """The processes that still run after EXIT_SECONDS."""
    deadline = time.monotonic() + EXIT_SECONDS
    while any(map(is_running, pids)) and time.monotonic() < deadline:
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


def kill_one(rng: random.Random, sent: signal.Signals) -> str:
    """Sends a signal to a worker during random calls and returns the error that the caller gets."""
    env = WorkerVectorEnv(ID, ENVS, WORKERS, start_method="fork", timeout_seconds=TIMEOUT)
    env.reset(seed=0)
    pids = env.worker_pids
    target_call = rng.randrange(12)
    message = "nothing"
    try:
        for index in range(16):
            if index == target_call:
                time.sleep(rng.choice((0.0, 0.0005, 0.003)))
                os.kill(rng.choice(pids), sent)
            call(env, rng.choice(CALLS))
    except WorkerError as error:
        message = "died" if "died by signal" in str(error) else "hung" if "not responded" in str(error) else str(error)
    env.close()
    if running := survivors(pids):
        raise AssertionError(f"workers {running} still run after {sent.name}")
    try:
        env.reset()
    except gym.error.ClosedEnvironmentError:
        return f"{sent.name}: {message}"
    raise AssertionError("a closed environment still works")


def interrupt(start_method: str, seconds: float) -> str:
    """Interrupts a process group that starts and steps workers, and returns how it ended."""
    command = [sys.executable, "-c", INTERRUPTED, start_method, str(seconds)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True) as caller:
        try:
            _, errors = caller.communicate(timeout=120)
        except subprocess.TimeoutExpired as error:
            errors = error.stderr or b""
        deadline = time.monotonic() + EXIT_SECONDS
        while (running := _members(caller.pid)) and time.monotonic() < deadline:
            time.sleep(0.05)
        if running:
            os.killpg(caller.pid, signal.SIGKILL)
            raise AssertionError(f"{start_method} {seconds}: processes {running} still run: {errors.decode()[-3000:]}")
    if caller.returncode not in (-signal.SIGINT, 130):
        raise AssertionError(f"{start_method} {seconds}: {errors.decode()[-500:]}")
    return f"Ctrl-C, {start_method}: {errors.count(b'Traceback')} traceback"


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
    """Runs `count` kills and stops, and `interrupts` per start method; returns how often each result occurred."""
    rng = random.Random(seed)
    results: Counter[str] = Counter()
    for index in range(count):
        results[kill_one(rng, signal.SIGSTOP if index % 8 == 7 else signal.SIGKILL)] += 1
    for start_method in ("fork", "forkserver", "spawn"):
        for _ in range(interrupts):
            results[interrupt(start_method, rng.uniform(0.02, 2.5))] += 1
    return dict(results)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40, help="number of kills and stops")
    parser.add_argument("--interrupts", type=int, default=10, help="number of interrupts per start method")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    for result, count in sorted(matrix(args.count, args.interrupts, args.seed).items()):
        print(f"{count:4} {result}")


if __name__ == "__main__":
    main()
