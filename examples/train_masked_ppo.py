"""Trains sb3-contrib's MaskablePPO with the network, the tasks and the recipe of `lilgym-mp train ppo`.

docs/stable_baselines3.md has the results; 1.5 million steps take five minutes. Needs the extra "sb3".
Run: python examples/train_masked_ppo.py --configuration TowerScratch --corpus builtin
"""

import argparse
import sys

import torch
from sb3_contrib import MaskablePPO

from lilgym_mp.cli import main
from lilgym_mp.evaluation import Settings
from lilgym_mp.sb3 import make_vec_env, recipe

# Without the recipe's changes of the tasks: each environment plays its own, and illegal actions are masked.
UNCHANGED = {"same_statement": 1, "recolour": False, "empty_starts": 0.0, "stop_forcing": False}

parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
parser.add_argument("--configuration", default="TowerScratch")
parser.add_argument("--corpus", default="builtin", help='"builtin", "lilgym" or a path')
parser.add_argument("--steps", type=int, default=1_500_000)
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--masks", action="store_true", help="mask illegal actions, and change no tasks")
parser.add_argument("--split", default="dev", help="evaluate on it after training")
parser.add_argument("--model", default="masked_ppo.zip", help="where to save the model")
parser.add_argument("--json", metavar="FILE", help="write the evaluation to FILE")
args = parser.parse_args()

torch.set_num_threads(1)
Settings(args.configuration, args.corpus).make(args.split)  # fails now, rather than after training, if it has no tasks
settings = recipe(args.configuration, args.corpus)
envs = make_vec_env(**settings.env | (UNCHANGED if args.masks else {}), seed=args.seed)
model = MaskablePPO(env=envs, seed=args.seed, verbose=1, **settings.model)  # tensorboard_log="runs": curves
model.learn(args.steps, settings.callback, log_interval=25, use_masking=args.masks)
envs.close()
model.save(args.model)
results = ["--out", args.json, "--force"] if args.json else []
evaluation = ["--alone", "--corpus", args.corpus, "--split", args.split, *results]
if status := main(["evaluate", args.model, "--trust", *evaluation]):
    sys.exit(status)
