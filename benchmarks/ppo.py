"""How fast PPO learns, playing included: steps a second of CPU time on one thread, and where the time goes.

    python benchmarks/ppo.py --corpus lilgym
    python benchmarks/ppo.py --corpus lilgym --profile TowerFlipIt

The recipe is `ours` with stop forcing; the first rollouts, in which things are compiled, do not count.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import tempfile
from pathlib import Path

from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.ppo.recipe import make_recipe
from lilgym_mp.learning.ppo.training import Progress, train_ppo

CONFIGURATIONS = ("TowerFlipIt", "ScatterFlipIt")
WARMING = 2  # rollouts


def speed(configuration: str, corpus: str, rollouts: int) -> tuple[int, float]:
    """Trained parameters, and actions a CPU second."""
    reports: list[Progress] = []
    recipe = make_recipe("ours", configuration, stop_forcing=True, held_out=0.0)
    with tempfile.TemporaryDirectory() as place:
        agent = train_ppo(
            Settings(configuration, corpus=corpus),
            recipe,
            Path(place) / "run",
            steps=(WARMING + rollouts) * recipe.rollout,
            device="cpu",
            on_progress=reports.append,
        )
    first, last = reports[WARMING - 1], reports[-1]
    return agent.model.trained_parameters, (last.steps - first.steps) / (last.cpu_seconds - first.cpu_seconds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--rollouts", type=int, default=10, help="that count")
    parser.add_argument("--profile", choices=CONFIGURATIONS, help="show where the time goes in this one instead")
    args = parser.parse_args()
    if args.profile:
        profile = cProfile.Profile()
        profile.runcall(speed, args.profile, args.corpus, args.rollouts)
        pstats.Stats(profile).sort_stats("tottime").print_stats(25)
        return
    print("| configuration | trained parameters | steps a CPU second |\n| --- | --- | --- |")
    for configuration in CONFIGURATIONS:
        parameters, rate = speed(configuration, args.corpus, args.rollouts)
        print(f"| {configuration} | {parameters:,} | {rate:,.0f} |")


if __name__ == "__main__":
    main()
