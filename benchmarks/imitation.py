"""CPU time of imitation learning and of its trained networks, on one core.

    python benchmarks/imitation.py --corpus lilgym
    python benchmarks/imitation.py --corpus lilgym --play runs/imitation-TowerFlipIt runs/imitation-ScatterFlipIt

Learning: states per second for each appearance, with and without exploration. Playing: every task of the split once, in
batches, including rendering and perception.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from time import process_time

import torch

from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.runs import evaluate
from lilgym_mp.learning.agents import open_agent
from lilgym_mp.learning.imitation.recipe import default_recipe
from lilgym_mp.learning.imitation.training import Progress, train_imitation

LEARNT = ("TowerFlipIt", "ScatterFlipIt")


def learning(configuration: str, corpus: str, minutes: float) -> tuple[float, float]:
    """States per CPU second, with and without exploration, after the first progress report."""
    reports: list[Progress] = []
    settings = Settings(configuration, corpus=corpus)
    recipe = default_recipe(settings.appearance)
    with tempfile.TemporaryDirectory() as place:
        train_imitation(settings, recipe, Path(place) / "run", minutes=minutes, on_progress=reports.append)
    first, last = reports[0], reports[-1]
    states, seconds = last.states - first.states, last.cpu_seconds - first.cpu_seconds
    return states / seconds, states / (seconds - (last.collection_seconds - first.collection_seconds))


def playing(place: Path, corpus: str, split: str, passes: int, envs: int) -> None:
    """Prints a table row per configuration of the agent."""
    agent = open_agent(place, "cpu")
    for configuration in agent.description.configurations:
        settings = Settings(configuration, corpus=corpus)
        policy = agent.policy(settings)
        evaluate(policy, settings, split)  # warm-up
        began = process_time()
        episodes = evaluate(policy, settings, split, passes=passes, batch_size=envs)
        seconds = process_time() - began
        steps = sum(len(episode.actions) for episode in episodes)
        print(f"| {configuration} | {len(episodes):,} | {len(episodes) / seconds:,.0f} | {steps / seconds:,.0f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--split", default="dev")
    parser.add_argument("--minutes", type=float, default=1.5, help="minutes of learning")
    parser.add_argument("--passes", type=int, default=5, help="passes over the split")
    parser.add_argument("--envs", type=int, default=256, help="parallel episodes")
    parser.add_argument("--play", nargs="+", type=Path, metavar="RUN", help="time these agents instead of learning")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.play:
        print("| agent plays | episodes | episodes/s | steps/s |\n| --- | --- | --- | --- |")
        for place in args.play:
            playing(place, args.corpus, args.split, args.passes, args.envs)
        return
    print("| training | states/s | without data collection |\n| --- | --- | --- |")
    for configuration in LEARNT:
        whole, alone = learning(configuration, args.corpus, args.minutes)
        print(f"| {configuration} | {whole:,.0f} | {alone:,.0f} |", flush=True)


if __name__ == "__main__":
    main()
