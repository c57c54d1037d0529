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


class Summary(NamedTuple):
    """Statistics of reports."""

    tasks: int
    solved: int
    proven_optimal: int  # solved tasks with a proof of optimality
    unsolvable: int  # proven unsolvable
    not_found: int
    mean_steps: float  # mean over the solved tasks, STOP included
    most_steps: int
    median_seconds: float
    mean_seconds: float
    slowest_seconds: float

    @property
    def solved_share(self) -> float:
        """The share of solved tasks among those not proven unsolvable; 1 if there are none."""
        solvable = self.tasks - self.unsolvable
        return self.solved / solvable if solvable else 1.0


def summarise(reports: Sequence[TaskReport]) -> Summary:
    """Raises ValueError for no reports."""
    if not reports:
        raise ValueError("cannot summarise zero reports")
    counts = Counter(report.solution.status for report in reports)
    steps = [report.solution.steps for report in reports if report.solution.solved]
    seconds = [report.seconds for report in reports]
    return Summary(
        tasks=len(reports),
        solved=counts[Status.SOLVED],
        proven_optimal=sum(report.solution.proven_optimal for report in reports),
        unsolvable=counts[Status.UNSOLVABLE],
        not_found=counts[Status.NOT_FOUND],
        mean_steps=mean(steps or [0]),
        most_steps=max(steps, default=0),
        median_seconds=median(seconds),
        mean_seconds=mean(seconds),
        slowest_seconds=max(seconds),
    )


def summary_rows(summaries: Mapping[str, Summary]) -> list[tuple[str, ...]]:
    """A header, and a row for each named summary."""
    tables = [
        {
            "": name,
            "tasks": f"{summary.tasks:,}",
            "solved": f"{summary.solved:,} ({100 * summary.solved_share:.2f} %)",
            "proven shortest": f"{summary.proven_optimal:,}",
            "unsolvable": f"{summary.unsolvable:,}",
            "not found": f"{summary.not_found:,}",
            "mean steps": f"{summary.mean_steps:.2f}",
            "most": str(summary.most_steps),
            "median ms": f"{1000 * summary.median_seconds:.2f}",
            "mean ms": f"{1000 * summary.mean_seconds:.2f}",
        }
        for name, summary in summaries.items()
    ]
    return [tuple(tables[0]), *(tuple(cells.values()) for cells in tables)]


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
