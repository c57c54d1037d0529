"""Solving many tasks, optionally in several processes, and summaries of the results."""

from __future__ import annotations

import itertools
import signal
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from statistics import mean, median
from time import perf_counter
from typing import Any, NamedTuple

from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.solver.solution import Solution, Status
from lilgym_mp.solver.solver import Solver

CHUNK_SIZE = 32  # tasks that a process gets at a time; consecutive tasks of one statement share caches


class TaskReport(NamedTuple):
    """One task and its solution."""

    task: Task
    solution: Solution
    seconds: float


def solve_tasks(
    tasks: Sequence[Task],
    dynamics: Dynamics,
    *,
    budget: int | None = None,
    jobs: int = 1,
    on_report: Callable[[TaskReport], object] = lambda report: None,
) -> list[TaskReport]:
    """Solves tasks in `jobs` processes. Returns their reports in order; solutions do not depend on `jobs`.

    `budget`: scenes examined per task. `on_report` is called with each report, in order, as soon as it is ready. Ends
    all processes when interrupted. Raises ValueError for fewer than one job or a budget below 1.
    """
    if jobs < 1:
        raise ValueError(f"jobs must be at least 1, not {jobs}")
    solve = partial(_solutions, dynamics, Solver(dynamics, budget).budget)
    size = 1 if jobs == 1 else CHUNK_SIZE
    chunks = [tasks[begin : begin + size] for begin in range(0, len(tasks), size)]
    executor = ProcessPoolExecutor(max(1, min(jobs, len(chunks))), initializer=_ignore_interrupts)
    reports: list[TaskReport] = []
    try:
        found = map(solve, chunks) if jobs == 1 else executor.map(solve, chunks)
        for task, (solution, seconds) in zip(tasks, itertools.chain.from_iterable(found), strict=True):
            reports.append(TaskReport(task, solution, seconds))
            on_report(reports[-1])
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
    return reports


def _solutions(dynamics: Dynamics, budget: int, tasks: Sequence[Task]) -> list[tuple[Solution, float]]:
    """Solutions and seconds; without the tasks, which the parent process has."""
    solver = Solver(dynamics, budget)
    found: list[tuple[Solution, float]] = []
    for task in tasks:
        begin = perf_counter()
        found.append((solver.solve(task), perf_counter() - begin))
    return found


def _ignore_interrupts() -> None:
    """Leaves Ctrl-C to the parent process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


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


def summarise(reports: Sequence[TaskReport]) -> Summary:
    """Statistics; `solved_percent` excludes tasks proven unsolvable. Raises ValueError for no reports."""
    if not reports:
        raise ValueError("cannot summarise zero reports")
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
    """A header, and a row for each named summary."""
    rows = [(name, *(form.format(**summary) for form in COLUMNS.values())) for name, summary in summaries.items()]
    return [("", *COLUMNS), *rows]


def report_json(report: TaskReport, dynamics: Dynamics) -> dict[str, Any]:
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
