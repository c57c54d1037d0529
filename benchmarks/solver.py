"""Solves whole corpora with the expert: tasks solved and proven shortest, successes, time.

Without LILGYM_DATA, only the builtin corpus is solved. Run: python benchmarks/solver.py --jobs 2
"""

from __future__ import annotations

import argparse
import os

from lilgym_mp.evaluation import Episode, evaluate
from lilgym_mp.evaluation.expert import ExpertPolicy
from lilgym_mp.evaluation.report import markdown_table
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.solver.reports import TaskReport, solve_tasks, summarise, summary_rows

SPLITS = ("train", "dev")


def solved(settings: Settings, split: str, jobs: int) -> list[TaskReport]:
    env = settings.make(split)
    return solve_tasks(env.tasks, env.dynamics, jobs=jobs)


def report_on(corpus: str, rules: str, jobs: int) -> None:
    summaries = {}
    played: dict[str, list[Episode]] = {}
    for configuration in CONFIGURATIONS:
        settings = Settings(configuration, corpus=corpus, rules=rules)
        for split in SPLITS:
            reports = solved(settings, split, jobs)
            name = f"{configuration} {split}"
            summaries[name] = summarise(reports)
            played[name] = evaluate(ExpertPolicy(settings), settings, split)
            for task, solution, _ in reports:
                if not solution.solved:
                    print(f"  {name} {task.id}: {solution.status}, {solution.reason}")
    print(f"\ncorpus {corpus}, rules {rules}\n\n{markdown_table(summary_rows(summaries))}\n")
    episodes = [episode for each in played.values() for episode in each]
    successes = sum(episode.is_success for episode in episodes)
    print(f"played by the expert in the environment: {successes:,} of {len(episodes):,} succeed\n", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=1, help="processes; 1 gives the most accurate times per task")
    parser.add_argument("--rules", nargs="+", default=["paper", "release"])
    parser.add_argument("--corpus", nargs="+", default=["builtin"] + ["lilgym"] * ("LILGYM_DATA" in os.environ))
    given = parser.parse_args()
    for corpus in given.corpus:
        for rules in given.rules:
            report_on(corpus, rules, given.jobs)


if __name__ == "__main__":
    main()
