"""How fast imitation learns, and how fast its networks play: CPU time on one core.

    python benchmarks/imitation.py --corpus lilgym
    python benchmarks/imitation.py --corpus lilgym --play runs/imitation-TowerFlipIt runs/imitation-ScatterFlipIt

Learning: states a second in a run of each appearance, with and without the time in which it explores. Playing: every
task of the split once, in batches, what draws the pictures and reads them included.
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
    """States a second of processor time, exploring included and not, after the first report of progress."""
    reports: list[Progress] = []
    settings = Settings(configuration, corpus=corpus)
    recipe = default_recipe(settings.appearance)
    with tempfile.TemporaryDirectory() as place:
        train_imitation(settings, recipe, Path(place) / "run", minutes=minutes, on_progress=reports.append)
    first, last = reports[0], reports[-1]
    states, seconds = last.states - first.states, last.cpu_seconds - first.cpu_seconds
    return states / seconds, states / (seconds - (last.exploring_seconds - first.exploring_seconds))


def playing(place: Path, corpus: str, split: str, passes: int, envs: int) -> None:
    """Prints a row for each configuration of the agent."""
    agent = open_agent(place, "cpu")
    for configuration in agent.description.configurations:
        settings = Settings(configuration, corpus=corpus)
        policy = agent.policy(settings)
        evaluate(policy, settings, split)  # what is only done once
        began = process_time()
        episodes = evaluate(policy, settings, split, passes=passes, batch_size=envs)
        seconds = process_time() - began
        steps = sum(len(episode.actions) for episode in episodes)
        print(f"| {configuration} | {len(episodes):,} | {len(episodes) / seconds:,.0f} | {steps / seconds:,.0f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--split", default="dev")
    parser.add_argument("--minutes", type=float, default=1.5, help="of learning")
    parser.add_argument("--passes", type=int, default=5, help="over the split")
    parser.add_argument("--envs", type=int, default=256, help="episodes side by side")
    parser.add_argument("--play", nargs="+", type=Path, metavar="RUN", help="time these agents instead of learning")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.play:
        print("| agent plays | episodes | episodes/s | steps/s |\n| --- | --- | --- | --- |")
        for place in args.play:
            playing(place, args.corpus, args.split, args.passes, args.envs)
        return
    print("| learning | states/s | exploring not counted |\n| --- | --- | --- |")
    for configuration in LEARNT:
        whole, alone = learning(configuration, args.corpus, args.minutes)
        print(f"| {configuration} | {whole:,.0f} | {alone:,.0f} |", flush=True)


if __name__ == "__main__":
    main()
