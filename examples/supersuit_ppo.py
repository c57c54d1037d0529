"""Trains one Stable-Baselines3 PPO policy for both agents, through SuperSuit's vector environments.

SuperSuit needs agents with equal spaces, and Stable-Baselines3 does not accept nested dictionaries. Therefore the game
is created with homogeneous=True, so that part of the observation identifies the agent, and with observations="parts".
Plain PPO does not apply masks: an illegal choice counts as no choice.
Needs the extras `sb3` and `supersuit`. Run: python examples/supersuit_ppo.py --steps 20000
"""

from __future__ import annotations

import argparse
import sys

from lilgym_mp.envs.proposer_verifier import parallel_env

try:
    import supersuit  # pyright: ignore[reportMissingImports]
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[sb3,supersuit]"')


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=20_000, help="total number of turns of both agents")
    parser.add_argument("--games", type=int, default=8, help="number of parallel games")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    game = parallel_env(protocol="joint", views="structured", homogeneous=True, observations="parts")
    markov = supersuit.pettingzoo_env_to_vec_env_v1(game)
    joined = supersuit.concat_vec_envs_v1(markov, args.games, num_cpus=0, base_class="stable_baselines3")
    joined.venv.reset(seed=args.seed)  # pyright: ignore[reportAttributeAccessIssue] -- the copies are identical until seeded
    torch.manual_seed(args.seed)
    model = PPO("MultiInputPolicy", VecMonitor(joined), n_steps=128, batch_size=256, device="cpu")
    model.learn(args.steps)
    returns = [episode["r"] for episode in model.ep_info_buffer or ()]
    mean = sum(returns) / len(returns) if returns else float("nan")
    print(f"{model.num_timesteps} steps of 2 agents in {args.games} games; mean return of the last games {mean:.2f}")


if __name__ == "__main__":
    main()
