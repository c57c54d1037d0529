"""Solving many tasks, over several processes where wanted, and the results in numbers."""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from statistics import mean, median
from time import perf_counter
from typing import Any, NamedTuple, TypeVar

from lilgym_mp.rules import Dynamics
from lilgym_mp.solver.solution import Solution, Status
from lilgym_mp.solver.solver import Solver
from lilgym_mp.task import Task

Question = TypeVar("Question")
Answer = TypeVar("Answer")

CHUNK = 32  # tasks handed to a process at a time; those of one statement lie together and share work


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
    """A report for each task, in their order, whatever the number of processes.

    `budget`: scenes looked at per task. `on_report` hears of each as it is ready. When it is interrupted, no
    process is left behind. Raises ValueError for fewer than one job or a budget below 1.
    """
    if jobs < 1:
        raise ValueError(f"jobs must be at least 1, not {jobs}")
    solver = Solver(dynamics, budget)
    reports: list[TaskReport] = []
    for report in _solved_here(tasks, solver) if jobs == 1 else _solved_by_processes(tasks, solver, jobs):
        reports.append(report)
        on_report(report)
    return reports


def _solved_here(tasks: Sequence[Task], solver: Solver) -> Iterator[TaskReport]:
    for task in tasks:
        begin = perf_counter()
        solution = solver.solve(task)
        yield TaskReport(task, solution, perf_counter() - begin)


def _solved_by_processes(tasks: Sequence[Task], solver: Solver, jobs: int) -> Iterator[TaskReport]:
    solve = partial(_solutions, solver.dynamics, solver.budget)
    for task, (solution, seconds) in zip(tasks, in_processes(solve, tasks, jobs, CHUNK), strict=True):
        yield TaskReport(task, solution, seconds)


def in_processes(
    answer: Callable[[Sequence[Question]], Sequence[Answer]], questions: Sequence[Question], jobs: int, chunk: int
) -> Iterator[Answer]:
    """The answer to each question, in their order; `answer` takes `chunk` of them at a time, in its own process.

    With one job it works in this process. When it is interrupted, no process is left behind. Raises ValueError for
    fewer than one job.
    """
    if jobs < 1:
        raise ValueError(f"jobs must be at least 1, not {jobs}")
    chunks = [questions[begin : begin + chunk] for begin in range(0, len(questions), chunk)]
    if jobs == 1:
        for some in chunks:
            yield from answer(some)
        return
    executor = ProcessPoolExecutor(max(1, min(jobs, len(chunks))), initializer=_leave_interrupts_to_the_parent)
    try:
        for answers in executor.map(answer, chunks):
            yield from answers
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _solutions(dynamics: Dynamics, budget: int, tasks: Sequence[Task]) -> list[tuple[Solution, float]]:
    """The solutions and their seconds; the tasks themselves need not travel back."""
    return [(report.solution, report.seconds) for report in _solved_here(tasks, Solver(dynamics, budget))]


class Summary(NamedTuple):
    """What came of a set of tasks."""

    tasks: int
    solved: int
    proven_optimal: int  # of the solved
    unsolvable: int  # proven
    not_found: int
    mean_steps: float  # of the solved, STOP included
    most_steps: int
    median_seconds: float
    mean_seconds: float
    slowest_seconds: float

    @property
    def solved_share(self) -> float:
        """Of the tasks that are not proven unsolvable; 1 when there is none."""
        solvable = self.tasks - self.unsolvable
        return self.solved / solvable if solvable else 1.0


def summarise(reports: Sequence[TaskReport]) -> Summary:
    """Raises ValueError when there are no reports."""
    if not reports:
        raise ValueError("there are no reports to summarise")
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


COLUMNS = (
    "tasks",
    "solved",
    "proven shortest",
    "unsolvable",
    "not found",
    "mean steps",
    "most",
    "median ms",
    "mean ms",
)


def summary_table(summaries: Mapping[str, Summary]) -> str:
    """A Markdown table, a row for each named summary."""
    rows = [("", *COLUMNS), ("---", *["---:"] * len(COLUMNS))]
    for name, summary in summaries.items():
        cells = (
            f"{summary.tasks:,}",
            f"{summary.solved:,} ({100 * summary.solved_share:.2f} %)",
            f"{summary.proven_optimal:,}",
            f"{summary.unsolvable:,}",
            f"{summary.not_found:,}",
            f"{summary.mean_steps:.2f}",
            str(summary.most_steps),
            f"{1000 * summary.median_seconds:.2f}",
            f"{1000 * summary.mean_seconds:.2f}",
        )
        rows.append((name, *cells))
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def report_json(report: TaskReport, dynamics: Dynamics) -> dict[str, Any]:
    """One task's report as JSON; actions as the appearance numbers them."""
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
