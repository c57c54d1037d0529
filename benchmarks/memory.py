"""Memory of batched environments, images excluded, and the time of `import lilgym_mp`.

Each configuration runs in its own process. The baseline is resident memory after importing the package, loading the
tasks and filling the shared caches with the same number of steps of a smaller batch. Then the environments are created
and stepped, with and without masks; the increase minus the bytes of the images is reported.
Run: python benchmarks/memory.py [--num-envs 1024] [--corpus lilgym]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from statistics import median
from typing import Any

CONFIGURATIONS = ("TowerFlipIt", "ScatterFlipIt")
IMPORTS = 7

ENVIRONMENTS = """
import ctypes, gc, sys
from pathlib import Path
import gymnasium as gym
import numpy as np
import lilgym_mp

def resident():
    gc.collect()
    getattr(ctypes.CDLL(None), "malloc_trim", int)(0)  # returns freed memory, if the C library supports it
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

def play(env, steps, with_masks):
    chance = np.random.default_rng(0)
    env.reset(seed=0)
    for _ in range(steps):
        if with_masks:
            masks = env.action_masks()
            drawn = (chance.random(len(masks)) * masks.sum(1)).astype(np.int64)
            actions = (masks.cumsum(1, dtype=np.int32) > drawn[:, None]).argmax(1)
        else:
            actions = chance.integers(env.single_action_space.n, size=env.num_envs)
        env.step(actions)

configuration, num_envs, steps, corpus = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
name = f"lilgym_mp/{configuration}-v0"
small = gym.make_vec(name, num_envs=64, corpus=corpus, copy=False)
play(small, num_envs * steps // 64, True)
before = resident()
env = gym.make_vec(name, num_envs=num_envs, corpus=corpus, copy=False)
images = env.reset(seed=0)[0]["image"].nbytes
for with_masks in (False, True):
    play(env, steps, with_masks)
    print(resident() - before - images)
"""

IMPORT = "from time import perf_counter as now; start = now(); import lilgym_mp; print(now() - start)"


def _printed(program: str, *arguments: str) -> list[float]:
    done = subprocess.run([sys.executable, "-c", program, *arguments], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.returncode)
    return [float(line) for line in done.stdout.split()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num-envs", type=int, default=1024)
    parser.add_argument("--steps", type=int, default=24)
    parser.add_argument("--corpus", default="builtin")
    given: Any = parser.parse_args()
    for name in CONFIGURATIONS:
        bare, masked = _printed(ENVIRONMENTS, name, str(given.num_envs), str(given.steps), given.corpus)
        print(
            f"{name}, corpus {given.corpus}: {given.num_envs:,} environments beyond their images:"
            f" {bare / 1e6:.1f} MB, with masks {masked / 1e6:.1f} MB",
            flush=True,
        )
    times = [_printed(IMPORT)[0] for _ in range(IMPORTS)]
    print(f"import lilgym_mp: median {median(times):.2f} s of {IMPORTS} (lowest {min(times):.2f})")


if __name__ == "__main__":
    main()
