"""Compares SB3's SubprocVecEnv with this package's backends, under SB3's PPO or sb3-contrib's MaskablePPO.

With the same seed all backends play the same episodes and end with the same mean return; only the time differs. Plain
PPO does not use masks: an invalid action ends its episode with -1. "MultiInputPolicy" treats token ids as quantities
and only shows the interface; examples/train_masked_ppo.py has a network that embeds them.
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


def train(backend: str, args: argparse.Namespace) -> None:
    """Trains with one backend and prints time and mean return."""
    envs = make_vec_env(args.id, args.envs, backend, seed=args.seed)
    learner = MaskablePPO if args.masked else PPO
    try:
        model = learner(
            "MultiInputPolicy",
            envs,
            n_steps=args.rollout,
            batch_size=min(256, args.envs * args.rollout),
            n_epochs=4,
            ent_coef=0.02,
            seed=args.seed,
            device="cpu",
        )
        started = time.perf_counter()
        model.learn(args.steps)
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
    parser.add_argument("--steps", type=int, default=20_000, help="steps per backend")
    parser.add_argument("--envs", type=int, default=8)
    parser.add_argument("--rollout", type=int, default=64, help="steps per environment between updates")
    parser.add_argument("--masked", action="store_true", help="use MaskablePPO instead of PPO")
    parser.add_argument("--backends", nargs="+", choices=BACKENDS, default=list(BACKENDS))
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    for backend in args.backends:
        train(backend, args)


if __name__ == "__main__":
    main()
