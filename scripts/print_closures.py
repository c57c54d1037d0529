"""Prints how many lines of the package a few uses load: `python scripts/print_closures.py [NAME ...]`."""

from __future__ import annotations

import subprocess
import sys

ENV = "import gymnasium, lilgym_mp; env = gymnasium.make('lilgym_mp/{}-v0'); env.reset(seed=0); env.step(1)"
TRAINING = "import tempfile; from pathlib import Path; folder = tempfile.TemporaryDirectory(); {}"
USES = {
    "tower": ENV.format("TowerFlipIt"),
    "scatter": ENV.format("ScatterFlipIt"),
    "ppo": TRAINING.format(
        "from lilgym_mp.evaluation import Settings; from lilgym_mp.learning.ppo.learner import PPORecipe;"
        " from lilgym_mp.learning.ppo.training import train_ppo;"
        " recipe = PPORecipe.of('TowerFlipIt', envs=8, same_statement=8, rollout=64, batch_size=64);"
        " train_ppo(Settings('TowerFlipIt'), recipe, Path(folder.name) / 'run', steps=64)"
    ),
    "train ppo": TRAINING.format(
        "from lilgym_mp.cli import main;"
        " main('train ppo TowerFlipIt --steps 64 --envs 8 --same-statement 8 --rollout 64 --batch-size 64'.split()"
        " + ['--out', folder.name])"
    ),
}
COUNT = """
import sys
files = {getattr(module, "__file__", None) for name, module in sys.modules.items() if name.split(".")[0] == "lilgym_mp"}
counts = {file: len(open(file, encoding="utf-8").readlines()) for file in files if file and file.endswith(".py")}
print(sum(counts.values()), len(counts))
"""


def closure(use: str) -> tuple[int, int]:
    """The lines and the number of the package's modules that a fresh process has imported after one of USES."""
    code = f"{USES[use]}\n{COUNT}"
    done = subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.PIPE, text=True)
    lines, modules = done.stdout.splitlines()[-1].split()
    return int(lines), int(modules)


if __name__ == "__main__":
    for name in sys.argv[1:] or USES:
        lines, modules = closure(name)
        print(f"{name}: {lines:,} lines in {modules} modules")
