"""Trains one Stable-Baselines3 PPO policy for both agents on three statements, through SuperSuit's vector environments.

SuperSuit needs agents with equal spaces, and Stable-Baselines3 does not accept nested dictionaries. Therefore the game
is created with homogeneous=True, so that part of the observation identifies the agent, and with observations="vector".
Plain PPO does not apply masks: an illegal choice counts as no choice.
Needs the extras `sb3` and `supersuit`. Run: python examples/supersuit_ppo.py --steps 60000
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lilgym_mp.corpus import write_corpus
from lilgym_mp.envs.proposer_verifier import parallel_env

try:
    import supersuit  # pyright: ignore[reportMissingImports]
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[sb3,supersuit]"')

STATEMENTS = {  # so few that a plain network over token ids can tell them apart
    "Some block is blue.": "exist(filter_color(all_items, Color.BLUE))",
    "Yellow can be seen.": "exist(filter_color(all_items, Color.YELLOW))",
    "There is a tower.": "exist(filter_obj(all_boxes, lambda b: count(b) >= 2))",
}


JOINT = {"protocol": "joint", "views": "structured"}
GUIDE = {  # the proposer sees no statement, and the verifier has a message for each action
    "protocol": "critique",
    "views": {"proposer_0": {"scene": "structured", "statement": "none", "target": False}, "verifier_0": "structured"},
    "message_size": {"proposer_0": 0, "verifier_0": 13},
}


def make_game(*, guide: bool = False) -> Any:
    common = {"appearance": "tower", "split": "train", "starts": []}
    rows = enumerate(STATEMENTS.items())
    entries = [{"id": f"{n}", "statement": said, "program": program, **common} for n, (said, program) in rows]
    with TemporaryDirectory() as directory:
        corpus = Path(directory) / "three.jsonl"
        write_corpus(corpus, "three", "MIT", entries)
        settings = GUIDE if guide else JOINT
        return parallel_env(**settings, homogeneous=True, observations="vector", corpus=str(corpus))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=60_000, help="total number of turns of both agents")
    parser.add_argument("--games", type=int, default=8, help="number of parallel games")
    parser.add_argument("--guide", action="store_true", help="critique with the guide's views instead of joint")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    markov = supersuit.pettingzoo_env_to_vec_env_v1(make_game(guide=args.guide))
    joined = supersuit.concat_vec_envs_v1(markov, args.games, num_cpus=0, base_class="stable_baselines3")
    joined.venv.reset(seed=args.seed)  # pyright: ignore[reportAttributeAccessIssue] -- each copy with another seed
    torch.manual_seed(args.seed)
    envs = VecNormalize(VecMonitor(joined), norm_reward=False)
    model = PPO("MlpPolicy", envs, learning_rate=1e-3, n_steps=128, batch_size=256, n_epochs=4, ent_coef=0.02)
    while model.num_timesteps < args.steps:
        model.learn(min(8192, args.steps), reset_num_timesteps=False)
        returns = [episode["r"] for episode in model.ep_info_buffer or ()]
        mean = sum(returns) / len(returns) if returns else float("nan")
        print(f"{model.num_timesteps:8} steps of 2 agents  mean return of the last games {mean:+.2f}", flush=True)


if __name__ == "__main__":
    main()
