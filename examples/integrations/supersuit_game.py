"""The two-agent game in Stable-Baselines3: one PPO policy for both agents, through SuperSuit's vector environments."""

from __future__ import annotations

import numpy as np
import supersuit  # pyright: ignore[reportMissingImports]
import torch
from flat import arguments
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from lilgym_mp.envs.proposer_verifier import parallel_env

LIBRARY = "Stable-Baselines3 with SuperSuit"
CELLS = {
    "game": (
        "in infos, not used: an illegal choice counts as none",
        "`evaluate_policy`: mean return of both agents",
        "`VecNormalize`",
    )
}


def main() -> None:
    args = arguments(CELLS)
    torch.set_num_threads(1)
    game = parallel_env(protocol="joint", views="structured", homogeneous=True, observations="vector")
    joined = supersuit.concat_vec_envs_v1(
        supersuit.pettingzoo_env_to_vec_env_v1(game), 4, num_cpus=0, base_class="stable_baselines3"
    )
    joined.venv.reset(seed=0)  # pyright: ignore[reportAttributeAccessIssue]
    envs = VecNormalize(VecMonitor(joined))
    model = PPO("MlpPolicy", envs, n_steps=32, batch_size=64, n_epochs=1, seed=None)
    model.learn(args.steps)
    envs.training = envs.norm_reward = False
    mean, _ = evaluate_policy(model, envs, n_eval_episodes=20)
    model.save("model.zip")
    envs.save("normalisation.pkl")
    loaded = PPO.load("model.zip", env=VecNormalize.load("normalisation.pkl", joined))
    seen = envs.reset()
    assert np.array_equal(model.predict(seen, deterministic=True)[0], loaded.predict(seen, deterministic=True)[0])
    print(f"{args.kind}: mean return {mean:+.2f} of 20 episodes, saved and loaded")


if __name__ == "__main__":
    main()
