"""Audits reward models on a split: results by target, calibration, and soundness against other seeds.

    python scripts/audit_reward_model.py runs/Tower-0 runs/Tower-1 --corpus lilgym --split dev

A proposer that optimises the verifier it is judged by finds its mistakes, so each run's scenes are judged by every run.
`--set` changes settings of the search for all runs.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from lilgym_mp.envs.rules import Outcome
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.common.agents import open_agent
from lilgym_mp.learning.reward_model.agent import RewardModelAgent
from lilgym_mp.scene.arrays import BoolArray, Float64Array

BINS = (0.0, 0.5, 0.7, 0.9, 0.97, 0.99, 1.0)  # of probabilities


class Claims(NamedTuple):
    """The choices of R runs in N tasks."""

    right: BoolArray  # (R, N) whether the run's plan solves the task
    judged: Float64Array  # (R, V, N) probability of success that each run V gives the chosen scene
    targets: BoolArray  # (N,)


def claims_of(agents: Sequence[RewardModelAgent], settings: Settings, split: str) -> Claims:
    dynamics = settings.dynamics()
    planners = [agent.planner(settings) for agent in agents]
    tasks = settings.make(split).tasks
    right = np.zeros((len(agents), len(tasks)), bool)
    judged = np.zeros((len(agents), len(agents), len(tasks)))
    for column, task in enumerate(tasks):
        for row, planner in enumerate(planners):
            state = dynamics.start(task)
            for action in planner.plan(task.start, task.statement, task.target).actions:
                transition = dynamics.step(state, action)
                state = transition.state
            right[row, column] = transition.outcome is Outcome.SUCCESS
            for judge, agent in enumerate(agents):
                judged[row, judge, column] = agent.success_probability(state)
    return Claims(right, judged, np.array([task.target for task in tasks]))


def print_table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    columns = [*head]
    print("\n| " + " | ".join(columns) + " |\n|" + " --- |" * len(columns))
    for row in rows:
        print("| " + " | ".join(f"{cell:.1f}" if isinstance(cell, float) else str(cell) for cell in row) + " |")


def percent(values: BoolArray | Float64Array) -> float | str:
    return 100 * float(np.mean(values)) if values.size else "-"


def audit(claims: Claims, names: Sequence[str]) -> None:
    right, judged, targets = claims
    own = judged[np.arange(len(names)), np.arange(len(names))]
    rows = [(name, right[row], own[row]) for row, name in enumerate(names)]
    print_table(
        ("run", "solved, %", "target true", "target false", "mean P"),
        ((name, percent(got), percent(got[targets]), percent(got[~targets]), percent(p)) for name, got, p in rows),
    )
    found, p = right.ravel(), own.ravel()
    bins = [(low, high, (p >= low) & ((p < high) | (high == 1))) for low, high in itertools.pairwise(BINS)]
    print_table(
        ("P at the chosen scene", "plans", "mean P, %", "solved, %"),
        (
            (f"{low:g} to {high:g}", inside.sum(), percent(p[inside]), percent(found[inside]))
            for low, high, inside in bins
        ),
    )
    pairs = itertools.product(range(len(names)), repeat=2)
    print_table(
        ("proposer", "verifier", "accepted, %", "right claims accepted", "wrong claims rejected", "accepted are right"),
        (
            (
                names[one],
                names[other],
                *map(percent, (accepted, accepted[right[one]], ~accepted[~right[one]], right[one][accepted])),
            )
            for one, other in pairs
            for accepted in [judged[one, other] > 0.5]
        ),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--split", default="dev")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", help="settings of the search")
    args = parser.parse_args()
    agents = [cast("RewardModelAgent", open_agent(run)) for run in args.runs]
    kinds = {name: type(value) for name, value in agents[0].recipe.to_json().items()}
    changes = {name: kinds[name](value) for name, _, value in (text.partition("=") for text in args.set)}
    agents = [replace(agent, recipe=replace(agent.recipe, **changes)) for agent in agents]
    for configuration in agents[0].description.configurations:
        print(f"\n{configuration}, corpus {args.corpus}, split {args.split} {' '.join(args.set)}")
        audit(
            claims_of(agents, Settings(configuration, corpus=args.corpus), args.split), [run.name for run in args.runs]
        )


if __name__ == "__main__":
    main()
