"""PPO's steps per second of CPU time in 32-bit floats and in bfloat16, side by side.

Two runs of equal seed train in turns, a rollout with its updates each, on one thread. The median is over all rounds but
the first. On CPUs without AVX-512 bfloat16 is not used, so the rates are equal.

Run: python benchmarks/learner_precision.py [CONFIGURATION] [--model ours] [--weights DIR] [--recipe ours] [--rounds 20]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.common.model_file import precision, torch_threads
from lilgym_mp.learning.ppo.learner import PPORecipe
from lilgym_mp.learning.ppo.training import PPORun


class ReducedRun(PPORun):
    """Computes in bfloat16 whatever the model."""

    def _precision(self) -> Any:
        return precision(self.device)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("configuration", nargs="?", default="TowerFlipIt")
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--model", default="ours")
    parser.add_argument("--weights", type=Path)
    parser.add_argument("--recipe", default="ours")
    parser.add_argument("--envs", type=int)
    parser.add_argument("--rounds", type=int, default=20)
    args = parser.parse_args()
    if args.rounds < 2:
        parser.error(f"--rounds must be at least 2, as the first one does not count, not {args.rounds}")
    settings = Settings(args.configuration, corpus=args.corpus)
    chosen = {"envs": args.envs} if args.envs else {}
    full = PPORecipe.of(args.configuration, args.recipe, model=args.model, reduced_precision=False, **chosen)
    reduced = PPORecipe.of(args.configuration, args.recipe, model=args.model, **chosen)
    with tempfile.TemporaryDirectory() as out, torch_threads(1):
        options: dict[str, Any] = {"steps": 10**9, "weights": args.weights, "device": "cpu"}
        runs = {
            "32-bit": PPORun(settings, full, Path(out, "full"), **options),
            "bfloat16": ReducedRun(settings, reduced, Path(out, "reduced"), **options),
        }
        rates: dict[str, list[float]] = {name: [] for name in runs}
        for _ in range(args.rounds):
            for name, run in runs.items():
                start = time.process_time()
                run.step()
                rates[name].append(run.recipe.rollout / (time.process_time() - start))
    medians = {name: median(found[1:]) for name, found in rates.items()}
    for name, rate in medians.items():
        print(f"{name}: {rate:,.0f} steps/s")
    ratios = [b / a for a, b in zip(*(found[1:] for found in rates.values()), strict=True)]
    print(f"bfloat16 / 32-bit: {median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})")


if __name__ == "__main__":
    main()
