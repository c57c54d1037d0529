"""Trains RLlib's PPO with action masks on a single-agent environment.

RLlib's modules see only observations, so the mask is part of them; the network is that of rllib_two_policies.py.
Needs the extras `rllib` and `pettingzoo`. Run: python examples/rllib_single_agent.py --steps 20000 --runners 1
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import gymnasium as gym
from gymnasium import spaces

import lilgym_mp  # noqa: F401  (registers the environments)
from lilgym_mp.wrappers import StructuredObservation, TokenizedStatement

try:
    from ray.rllib.algorithms.ppo import PPOConfig  # pyright: ignore[reportMissingImports]
    from ray.rllib.core.rl_module.rl_module import RLModuleSpec  # pyright: ignore[reportMissingImports]
    from ray.tune.registry import register_env  # pyright: ignore[reportMissingImports]
    from rllib_two_policies import SAMPLE_SECONDS, MaskedActorCritic, started_ray
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[rllib,pettingzoo]"')


class MaskInObservation(gym.ObservationWrapper[dict[str, Any], int, dict[str, Any]]):
    """Observations {"observation": the environment's, "action_mask": int8 (actions,)}."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        assert isinstance(env.action_space, spaces.Discrete)
        mask = spaces.MultiBinary(int(env.action_space.n))
        self.observation_space = spaces.Dict({"observation": env.observation_space, "action_mask": mask})

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        return {"observation": observation, "action_mask": self.get_wrapper_attr("action_masks")().astype("int8")}


def make_env(config: dict[str, Any]) -> gym.Env[Any, Any]:
    return MaskInObservation(TokenizedStatement(StructuredObservation(gym.make(**config))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--id", default="lilgym_mp/TowerScratch-v0")
    parser.add_argument("--steps", type=int, default=20_000, help="total number of steps over all runners")
    parser.add_argument("--batch", type=int, default=1024, help="steps between updates")
    parser.add_argument("--runners", type=int, default=1, help="number of sampling processes; 0 samples in this one")
    parser.add_argument("--envs", type=int, default=4, help="environments per runner")
    parser.add_argument("--width", type=int, default=128, help="width of the network")
    parser.add_argument(
        "--address", help="address of a running Ray cluster, such as auto (default: start Ray on this machine)"
    )
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    register_env("lilgym_mp_single", make_env)
    config = (
        PPOConfig()
        .environment("lilgym_mp_single", env_config={"id": args.id})
        .env_runners(
            num_env_runners=args.runners,
            num_envs_per_env_runner=args.envs,
            sample_timeout_s=SAMPLE_SECONDS,
        )
        .rl_module(rl_module_spec=RLModuleSpec(module_class=MaskedActorCritic, model_config={"width": args.width}))
        .training(
            lr=1e-3,
            entropy_coeff=0.02,
            train_batch_size_per_learner=args.batch,
            minibatch_size=min(256, args.batch),
            num_epochs=4,
        )
        .debugging(seed=args.seed)
    )
    with started_ray(args.address):
        algorithm = config.build_algo()
        try:
            steps = 0
            while steps < args.steps:
                results = algorithm.train()["env_runners"]
                steps = int(results["num_env_steps_sampled_lifetime"])
                print(
                    f"{steps:8} steps  mean return {results.get('episode_return_mean', float('nan')):+.2f}", flush=True
                )
        finally:
            algorithm.stop()


if __name__ == "__main__":
    main()
