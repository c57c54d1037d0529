"""Solve tasks with the expert.

Finds shortest solutions of all tasks of the splits, and reports which are proven shortest.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import mean, median
from time import perf_counter
from typing import NamedTuple

from lilgym_mp.cli.options import (
    JSON,
    CommandError,
    add_configuration,
    add_flag,
    add_number,
    add_out,
    add_settings,
    check_at_least,
    check_out,
    given_environment,
    split_of,
)
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.registration import BUILTIN_CONFIGURATIONS
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.evaluation.files import write_json
from lilgym_mp.evaluation.terminal import Progress, shows_colours, table
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import Action, describe
from lilgym_mp.scene.render.characters import ruled, text
from lilgym_mp.solver import Solution, Solver, Status

MOST_LISTED = 20  # most unsolved tasks printed; the results file contains all
Summary = Mapping[str, float]  # statistics of reports; steps are of the solved tasks, STOP included
COLUMNS = {  # of the table of summaries; times are in milliseconds
    "tasks": "{tasks:,}",
    "solved": "{solved:,} ({solved_percent:.2f} %)",
    "proven shortest": "{proven_optimal:,}",
    "unsolvable": "{unsolvable:,}",
    "not found": "{not_found:,}",
    "mean steps": "{mean_steps:.2f}",
    "most": "{most_steps}",
    "median ms": "{median_ms:.2f}",
    "mean ms": "{mean_ms:.2f}",
}


class TaskReport(NamedTuple):
    """One task and its solution."""

    task: Task
    solution: Solution
    seconds: float


def add_options(parser: ArgumentParser) -> None:
    """Adds the options of `lilgym-mp solve`."""
    add_configuration(parser, several=True)
    parser.add_argument(
        "--split", nargs="+", choices=list(SPLITS), help="splits of the corpus (default: the tasks', else dev)"
    )
    add_number(parser, "--episodes", None, "only the first N tasks of each split")
    add_out(parser, "write all solutions to FILE as JSON")
    parser.add_argument("--task", nargs="+", metavar="ID", help="solve only these tasks, and print their solutions")
    add_flag(parser, "--show", "with --task: draw the scene before each action")
    add_solving(parser)
    add_settings(parser)


def add_solving(parser: ArgumentParser) -> None:
    """Options that limit the expert's work."""
    options = parser.add_argument_group("expert")
    add_number(options, "--budget", None, "search budget: maximum number of scenes per task")


def run(args: Namespace) -> int:
    """Solves all tasks of the chosen splits, or those named by --task, and prints what it found."""
    check_at_least(args, 1, "episodes")
    check_out(args)
    chosen = [EnvConfig(name, **given_environment(args)) for name in args.configuration or BUILTIN_CONFIGURATIONS]
    if args.task is not None:
        return _run_tasks(chosen, args)
    if args.show:
        raise CommandError("--show needs --task ID")
    summaries: dict[str, Summary] = {}
    records: list[JSON] = []
    unsolved: list[str] = []
    for settings in chosen:
        for split in args.split or [split_of(settings, None)]:
            tasks = settings.tasks(split)
            reports = solve_shown(tasks[: args.episodes], settings, split, args)
            name = f"{settings.configuration} {split}"
            dynamics = settings.dynamics()
            summaries[name] = summarise(reports)
            unsolved += [
                f"{name} {task.id}: {task.statement!r} to be {task.target}: {solution.status}, {solution.reason}"
                for task, solution, _ in reports
                if solution.status is not Status.SOLVED
            ]
            source = {"settings": settings.to_json(), "split": split}
            records += [{**source, **report_json(report, dynamics)} for report in reports]
    first = chosen[0]
    grid = first.grid if isinstance(first.grid, str) else "x".join(map(str, first.grid))
    print(f"corpus {first.corpus}, rules {first.rules}, horizon {first.dynamics().horizon}, grid {grid}\n")
    print(table(("", *COLUMNS), summary_rows(summaries)))
    if unsolved:
        print("\n".join([f"\nunsolved: {len(unsolved)}", *unsolved[:MOST_LISTED]]))
    if len(unsolved) > MOST_LISTED:
        print(f"... and {len(unsolved) - MOST_LISTED} more; --out FILE writes all")
    if args.out is not None:
        write_json(args.out, {"summaries": summaries, "tasks": records})
        print(f"\nsolutions: {args.out}")
    return 0


def _run_tasks(chosen: Sequence[EnvConfig], args: Namespace) -> int:
    """Prints the solutions of the named tasks, action by action."""
    if len(chosen) != 1 or len(args.split or ["one"]) != 1:
        raise CommandError("--task needs exactly one CONFIGURATION, and at most one --split")
    if args.out is not None or args.episodes is not None:
        raise CommandError("--task excludes --out and --episodes")
    (settings,) = chosen
    split = split_of(settings, *(args.split or [None]), *args.task)
    dynamics = settings.dynamics()
    solver = Solver(dynamics, args.budget)
    tasks = settings.tasks(split)
    for task in [tasks.by_id(task_id) for task_id in args.task]:
        solution = solver.solve_from(dynamics.start(task))
        print(f'{task.id}: make "{task.statement}" {str(task.target).lower()}')
        print(f"  program: {task.program}")
        if not solution.solved:
            print(f"  {solution.status}: {solution.reason}")
            continue
        proof = "proven shortest" if solution.proven_optimal else f"lower bound: {solution.least_edits} edits"
        print(f"  {solution.steps} actions, {proof}")
        _print_actions(dynamics, task, solution.actions, show=args.show)
    return 0


def _print_actions(dynamics: Dynamics, task: Task, actions: Sequence[Action], *, show: bool) -> None:
    """Prints each action, with `show` also the scene before it."""
    state = dynamics.start(task)
    for step, action in enumerate(actions, 1):
        if show:
            print(ruled(text(state.scene, [], coloured=shows_colours()), dynamics.appearance.grid))
        transition = dynamics.step(state, action)
        print(f"  {step}. {describe(action)}: reward {transition.reward:+.1f}")
        state = transition.state


def solve_shown(tasks: Sequence[Task], settings: EnvConfig, split: str, args: Namespace) -> list[TaskReport]:
    """Solves tasks of the split, showing progress."""
    solver = Solver(settings.dynamics(), args.budget)
    reports = list[TaskReport]()
    with Progress(len(tasks), f"tasks of {settings.configuration} {split}") as progress:
        for task in tasks:
            begin = perf_counter()
            solution = solver.solve(task)
            reports.append(TaskReport(task, solution, perf_counter() - begin))
            progress.advance()
    return reports


def summarise(reports: Sequence[TaskReport]) -> Summary:
    """Statistics of one or more reports; `solved_percent` excludes tasks proven unsolvable."""
    counts = Counter(report.solution.status for report in reports)
    steps = [report.solution.steps for report in reports if report.solution.solved]
    milliseconds = [1000 * report.seconds for report in reports]
    solvable = len(reports) - counts[Status.UNSOLVABLE]
    return {
        "tasks": len(reports),
        **{str(status): counts[status] for status in Status},
        "solved_percent": 100 * counts[Status.SOLVED] / solvable if solvable else 100.0,
        "proven_optimal": sum(report.solution.proven_optimal for report in reports),
        "mean_steps": mean(steps or [0]),
        "most_steps": max(steps, default=0),
        "median_ms": median(milliseconds),
        "mean_ms": mean(milliseconds),
        "slowest_ms": max(milliseconds),
    }


def summary_rows(summaries: Mapping[str, Summary]) -> list[tuple[str, ...]]:
    """The name and COLUMNS of each summary."""
    return [(name, *(form.format(**summary) for form in COLUMNS.values())) for name, summary in summaries.items()]


def report_json(report: TaskReport, dynamics: Dynamics) -> JSON:
    """One task's report as JSON, with actions as indices."""
    task, solution, seconds = report
    return {
        "task": task.id,
        "statement": task.statement,
        "target": task.target,
        "status": str(solution.status),
        "actions": [dynamics.appearance.encode(action) for action in solution.actions],
        "proven_optimal": solution.proven_optimal,
        "least_edits": solution.least_edits,
        "scenes": solution.scenes,
        "seconds": round(seconds, 6),
        "reason": solution.reason,
    }
