"""Trains one Stable-Baselines3 PPO policy for both agents, through SuperSuit's vector environments.

SuperSuit needs agents with equal spaces, and Stable-Baselines3 does not accept nested dictionaries. Therefore the game
is created with homogeneous=True, so that part of the observation identifies the agent, and its observations are
flattened. Plain PPO sees the masks but does not apply them: an illegal choice counts as no choice.
Needs the extras `sb3` and `supersuit`. Run: python examples/supersuit_ppo.py --steps 20000
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from gymnasium import spaces
from pettingzoo.utils import BaseParallelWrapper

from lilgym_mp.envs.proposer_verifier import AGENTS, parallel_env

try:
    import supersuit  # pyright: ignore[reportMissingImports]
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[sb3,supersuit]"')


class FlatParts(BaseParallelWrapper):
    """Flattens observations into one dictionary of the parts and "action_mask"."""

    def observation_space(self, agent: str) -> spaces.Dict:
        return self.flat[agent]

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        whole = {agent: env.observation_space(agent) for agent in AGENTS}
        self.flat = {
            agent: spaces.Dict({**space["observation"].spaces, "action_mask": space["action_mask"]})
            for agent, space in whole.items()
        }

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        observations, infos = self.env.reset(seed=seed, options=options)
        return self._flatten(observations), infos

    def step(self, actions: dict[str, Any]) -> Any:
        observations, *rest = self.env.step(actions)
        return self._flatten(observations), *rest

    def _flatten(self, observations: dict[str, Any]) -> dict[str, Any]:
        return {
            agent: {**observation["observation"], "action_mask": observation["action_mask"]}
            for agent, observation in observations.items()
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=20_000, help="total number of turns of both agents")
    parser.add_argument("--games", type=int, default=8, help="number of parallel games")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    game = FlatParts(parallel_env(protocol="joint", views="structured", homogeneous=True))
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
