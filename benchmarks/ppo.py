"""PPO's speed, rollouts included, in steps per CPU second on one thread, and a profile.

    python benchmarks/ppo.py --corpus lilgym
    python benchmarks/ppo.py --corpus lilgym --profile TowerFlipIt

Uses the recipe `ours` with stop forcing. The first rollouts, in which code is compiled, are not timed.
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
WARM_UP_ROLLOUTS = 2


def speed(configuration: str, corpus: str, rollouts: int) -> tuple[int, float]:
    """The number of trained parameters, and actions per CPU second."""
    reports: list[Progress] = []
    recipe = make_recipe("ours", configuration, stop_forcing=True, held_out=0.0)
    with tempfile.TemporaryDirectory() as place:
        agent = train_ppo(
            Settings(configuration, corpus=corpus),
            recipe,
            Path(place) / "run",
            steps=(WARM_UP_ROLLOUTS + rollouts) * recipe.rollout,
            device="cpu",
            on_progress=reports.append,
        )
    first, last = reports[WARM_UP_ROLLOUTS - 1], reports[-1]
    return agent.model.trained_parameters, (last.steps - first.steps) / (last.cpu_seconds - first.cpu_seconds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--rollouts", type=int, default=10, help="number of timed rollouts")
    parser.add_argument("--profile", choices=CONFIGURATIONS, help="profile this configuration instead")
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
