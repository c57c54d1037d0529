"""Ablation of the parse-and-plan agent, its CPU time, and the calibration of its probabilities.

    python benchmarks/parse_and_plan.py runs/parse-lilgym-0 ... --corpus lilgym [--split dev] [--picture FILE.png]
    python benchmarks/parse_and_plan.py RUN --corpus lilgym --variants return accuracy

Prints Markdown tables: accuracy and mean reward by configuration, also for seen and unseen statements and forms
separately, with plans for the return and for accuracy, for all candidates and for the best one, with scenes from pixels
and from states; milliseconds per task, and a reliability table of the first variant.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import mean, stdev
from typing import NamedTuple

import torch

from lilgym_mp.corpus.tokens import statement_form
from lilgym_mp.evaluation import CONFIGURATIONS, Settings
from lilgym_mp.evaluation.comparison import training_statements
from lilgym_mp.evaluation.report import markdown_table
from lilgym_mp.learning.agents import open_agent
from lilgym_mp.learning.parsing.agent import ParseAndPlanAgent
from lilgym_mp.learning.parsing.calibration import Forecast, reliability
from lilgym_mp.learning.parsing.planning import Planner
from lilgym_mp.perception import read_scene
from lilgym_mp.render import draw
from lilgym_mp.rules import Outcome
from lilgym_mp.task import Task


class Played(NamedTuple):
    """The result of planning for one task."""

    configuration: str
    seen: bool  # whether the statement occurs in train
    form_seen: bool
    forecast: Forecast
    milliseconds: float
    reward: float


class Variant(NamedTuple):
    """A way to plan."""

    objective: str
    votes: bool = True
    from_pixels: bool = True


VARIANTS = {
    "return": Variant("return"),
    "accuracy": Variant("accuracy"),
    "accuracy, scenes from states": Variant("accuracy", from_pixels=False),
    "accuracy, best candidate": Variant("accuracy", votes=False),
}


def played(planner: Planner, settings: Settings, split: str, *, from_pixels: bool) -> Iterator[Played]:
    """Plans for every task of the split."""
    statements = training_statements(settings)
    forms = set(map(statement_form, statements))
    appearance, signals = planner.dynamics.appearance, planner.dynamics.rules.signals
    for task in settings.make(split).tasks:
        began = time.process_time()
        start = task.start
        if from_pixels:
            start = appearance.check_scene(read_scene(draw(start, "half"), appearance.name))
        plan = planner.plan(start, task.statement, task.target)
        seconds = time.process_time() - began
        success = planner.outcome(plan, Task(task.id, task.statement, task.program, task.target, task.start))
        yield Played(
            settings.configuration,
            task.statement in statements,
            statement_form(task.statement) in forms,
            Forecast(plan.success_probability, success is Outcome.SUCCESS),
            1000 * seconds,
            sum(signals[outcome].reward for outcome in (*[Outcome.CONTINUES] * (len(plan.actions) - 1), success)),
        )


def reward(results: Sequence[Played]) -> float:
    return mean(result.reward for result in results) if results else float("nan")


def accuracy(results: Sequence[Played]) -> float:
    return 100 * mean(result.forecast.success for result in results) if results else float("nan")


def spread(values: Sequence[float], digits: int = 1) -> str:
    return f"{mean(values):.{digits}f}" + (f" +- {stdev(values):.{digits}f}" if len(values) > 1 else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--split", default="dev")
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="reliability diagram (needs matplotlib)")
    parser.add_argument("--variants", nargs="+", choices=list(VARIANTS), default=list(VARIANTS), metavar="NAME")
    args = parser.parse_args()
    torch.set_num_threads(1)
    found: dict[str, list[list[Played]]] = {variant: [] for variant in args.variants}  # by variant, by run
    for run in args.runs:
        agent = open_agent(run, "cpu")
        assert isinstance(agent, ParseAndPlanAgent)
        for variant in args.variants:
            objective, votes, from_pixels = VARIANTS[variant]
            results: list[Played] = []
            for name in agent.description.configurations:
                settings = Settings(name, corpus=args.corpus)
                planner = agent.planner(settings, votes=votes, objective=objective)
                results += played(planner, settings, args.split, from_pixels=from_pixels)
            found[variant].append(results)
    print_accuracy(found)
    forecasts = [result.forecast for results in found[args.variants[0]] for result in results]
    print_reliability(forecasts)
    if args.picture is not None:
        draw_reliability(forecasts, args.picture)


def print_accuracy(found: dict[str, list[list[Played]]]) -> None:
    rows = [("", *CONFIGURATIONS, *(f"reward in {name}" for name in CONFIGURATIONS), "ms per task")]
    for variant, runs in found.items():
        groups = {variant: lambda result: True}
        if VARIANTS[variant] in (Variant("return"), Variant("accuracy")):
            groups |= {
                "  seen statements": lambda result: result.seen,
                "  unseen statements": lambda result: not result.seen,
                "  unseen forms": lambda result: not result.form_seen,
            }
        for group, belongs in groups.items():
            cells = [
                spread([accuracy([r for r in run if r.configuration == name and belongs(r)]) for run in runs])
                for name in CONFIGURATIONS
            ]
            cells += [
                spread([reward([r for r in run if r.configuration == name and belongs(r)]) for run in runs], 2)
                for name in CONFIGURATIONS
            ]
            times = spread([mean(result.milliseconds for result in run) for run in runs]) if group == variant else ""
            rows.append((group, *cells, times))
    print(markdown_table(rows), end="\n\n")


def print_reliability(forecasts: Sequence[Forecast]) -> None:
    rows = [("mean predicted", "success rate", "tasks")]
    for found in reliability(forecasts):
        rows.append(
            (f"{100 * found.mean_probability:.0f} %", f"{100 * found.success_rate:.0f} %", f"{found.forecasts}")
        )
    print(markdown_table(rows))


def draw_reliability(forecasts: Sequence[Forecast], path: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    bins = reliability(forecasts)
    figure, axes = pyplot.subplots(figsize=(4.5, 4.2), dpi=120)
    axes.plot([0, 1], [0, 1], color="grey", linewidth=1, label="perfect calibration")
    axes.plot(
        [found.mean_probability for found in bins],
        [found.success_rate for found in bins],
        marker="o",
        label="parse and plan",
    )
    for found in bins:
        axes.annotate(
            f"{found.forecasts}",
            (found.mean_probability, found.success_rate),
            textcoords="offset points",
            xytext=(-5, 5),
            ha="right",
        )
    axes.set(xlabel="predicted probability of success", ylabel="success rate", xlim=(0, 1.02), ylim=(0, 1.02))
    axes.legend(frameon=False, loc="upper left")
    figure.tight_layout()
    figure.savefig(path)


if __name__ == "__main__":
    main()
