"""Solving many tasks, and summaries of the results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from statistics import mean, median
from time import perf_counter
from typing import Any, NamedTuple

from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.solver.solution import Solution, Status
from lilgym_mp.solver.solver import Solver


class TaskReport(NamedTuple):
    """One task and its solution."""

    task: Task
    solution: Solution
    seconds: float


def solve_tasks(tasks: Iterable[Task], dynamics: Dynamics, *, budget: int | None = None) -> Iterator[TaskReport]:
    """Solves tasks in order; `budget`: scenes examined per task. Raises ValueError for a budget below 1."""
    solver = Solver(dynamics, budget)
    for task in tasks:
        begin = perf_counter()
        solution = solver.solve(task)
        yield TaskReport(task, solution, perf_counter() - begin)


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
