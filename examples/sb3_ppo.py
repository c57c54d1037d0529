"""Stable-Baselines3's PPO, or sb3-contrib's MaskablePPO, over SB3's own SubprocVecEnv and over this package's backends.

All backends play the same episodes from the same seed, so they end with the same mean return; what differs is time.
Plain PPO knows nothing of masks: an action that is invalid ends its episode with -1. "MultiInputPolicy" reads word
numbers as mere numbers, which shows the plumbing; examples/train_masked_ppo.py has a network that reads.
Needs the extra `sb3`. Run: python examples/sb3_ppo.py --steps 20000 --masked
"""

from __future__ import annotations

import argparse
import sys
import time

try:
    import torch
    from sb3_contrib import MaskablePPO
    from stable_baselines3 import PPO

    from lilgym_mp.sb3 import BACKENDS, make_vec_env
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[sb3]"')


def train(backend: str, given: argparse.Namespace) -> None:
    """Trains over one backend and prints what became of it."""
    envs = make_vec_env(given.id, given.envs, backend, seed=given.seed)
    learner = MaskablePPO if given.masked else PPO
    try:
        model = learner(
            "MultiInputPolicy",
            envs,
            n_steps=given.rollout,
            batch_size=min(256, given.envs * given.rollout),
            n_epochs=4,
            ent_coef=0.02,
            seed=given.seed,
            device="cpu",
        )
        started = time.perf_counter()
        model.learn(given.steps)
        seconds = time.perf_counter() - started
    finally:
        envs.close()
    returns = [episode["r"] for episode in model.ep_info_buffer or ()]
    mean = sum(returns) / len(returns) if returns else float("nan")
    print(
        f"{learner.__name__} over {backend:8} {model.num_timesteps:7} steps in {seconds:6.1f} s;"
        f" mean return of the last {len(returns)} episodes {mean:+.2f}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--id", default="lilgym_mp/TowerScratch-v0")
    parser.add_argument("--steps", type=int, default=20_000, help="for each backend")
    parser.add_argument("--envs", type=int, default=8)
    parser.add_argument("--rollout", type=int, default=64, help="steps of an environment between updates")
    parser.add_argument("--masked", action="store_true", help="MaskablePPO in place of PPO")
    parser.add_argument("--backends", nargs="+", choices=BACKENDS, default=list(BACKENDS))
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    torch.set_num_threads(1)
    for backend in given.backends:
        train(backend, given)


if __name__ == "__main__":
    main()
