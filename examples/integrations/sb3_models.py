"""Stable-Baselines3's PPO, or with --masks sb3-contrib's MaskablePPO, over one environment or any backend.

`channels_first_v0` keeps VecNormalize the outermost wrapper: otherwise SB3 transposes the images of the training
environment outside of it, and EvalCallback finds the evaluation environment wrapped otherwise.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import torch
from flat import ID, arguments, finish
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.callbacks import MaskableEvalCallback
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from lilgym_mp.sb3 import make_vec_env
from lilgym_mp.wrappers import channels_first_v0

LIBRARY = "Stable-Baselines3, sb3-contrib"
CELL = (
    "PPO: none, an invalid action ends the episode with -1; MaskablePPO: used",
    '`EvalCallback` or `evaluate_policy` over `make_vec_env(split="dev", evaluation=True)`, or `evaluate_wrapped`',
    "`VecNormalize`; with images wrap training and evaluation environments in `channels_first_v0`",
)
CELLS = {"single": CELL, "batched": CELL, "workers": CELL, "subproc": CELL, "dummy": CELL}
SWITCHES = ("", "--masks")

SMALL = {"net_arch": [8], "features_extractor_kwargs": {"cnn_output_dim": 8}}  # omit it to learn


def make(kind: str) -> Any:
    if kind == "single":
        return DummyVecEnv([lambda: channels_first_v0(gym.make(ID, observation="arrays"))])
    return make_vec_env(ID, 4, kind, seed=0, wrap=channels_first_v0)


def main() -> None:
    args = arguments(CELLS, "--masks")
    torch.set_num_threads(1)
    algorithm: Any = MaskablePPO if args.masks else PPO
    envs = VecNormalize(make(args.kind), norm_obs=False)
    model = algorithm("MultiInputPolicy", envs, n_steps=32, batch_size=32, n_epochs=1, seed=0, policy_kwargs=SMALL)
    plain = make_vec_env(ID, 8, split="dev", evaluation=True, wrap=channels_first_v0)
    evaluation = VecNormalize(plain, norm_obs=False, norm_reward=False, training=False)
    tasks = len(evaluation.get_attr("tasks")[0])
    callback: Any = MaskableEvalCallback if args.masks else EvalCallback
    every = args.steps // envs.num_envs
    model.learn(args.steps, callback(evaluation, n_eval_episodes=tasks, eval_freq=every, verbose=0))
    model.save("model.zip")
    envs.save("normalisation.pkl")
    envs.close()
    again = VecNormalize.load("normalisation.pkl", make(args.kind))
    loaded = algorithm.load("model.zip", env=again)
    again.close()

    def greedy(model: Any) -> Any:
        if args.masks:
            return lambda seen, legal: model.predict(seen, action_masks=legal, deterministic=True)[0]
        return lambda seen, legal: model.predict(seen, deterministic=True)[0]

    finish(args.kind, greedy(model), greedy(loaded), wrap=channels_first_v0)


if __name__ == "__main__":
    main()
