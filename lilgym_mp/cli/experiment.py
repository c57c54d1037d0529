"""Train, evaluate and record a matrix of configurations, learners and seeds.

Executes all runs described by a TOML file. If interrupted, the same command resumes them. `lilgym-mp report DIR --out
REPORT` makes tables and figures of the results.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lilgym_mp.evaluation.options import CommandError, check_at_least
from lilgym_mp.scene.choices import choose

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from lilgym_mp.cli.experiment_runs import Attempt

RESULTS = Path("results")
UPDATE_SECONDS = 1.0
FAILED = 1  # exit code if any run failed


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file", type=Path, metavar="FILE.toml", help="the experiment; docs/experiments.md lists its keys"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"results directory (default: {RESULTS}/FILE)")
    parser.add_argument("--jobs", type=int, metavar="N", help="parallel runs on this machine (default: 1)")
    parser.add_argument(
        "--ray",
        metavar="ADDRESS",
        help='execute on the Ray cluster at ADDRESS, one CPU per run ("auto": the cluster of this machine)',
    )
    parser.add_argument("--list", action="store_true", help="print the commands without running them")
    parser.add_argument("--only", nargs="+", metavar="RUN", help="execute only these runs; --list prints the names")


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.cli.experiment_plan import read_plan
    from lilgym_mp.cli.experiment_ray import run_on_ray
    from lilgym_mp.cli.experiment_runs import RunStatus, make_attempts, run_locally
    from lilgym_mp.envs.machine import usable_cores

    check_at_least(args, 1, "jobs")
    jobs = args.jobs or 1
    if args.ray is not None and args.jobs is not None:
        raise CommandError("--jobs is for runs on this machine; with --ray, the cluster's CPUs limit parallel runs")
    plan = read_plan(args.file)
    if args.only:
        by_name = {planned.name: planned for planned in plan}
        plan = [choose("run", name, by_name) for name in dict.fromkeys(args.only)]
    if args.list:
        for planned in plan:
            print("\n".join(f"{planned.name}: lilgym-mp {' '.join(words)}" for words in planned.commands if words))
        return 0
    results = args.out or RESULTS / args.file.stem
    threads = 1 if args.ray is not None else max(1, usable_cores() // jobs)
    attempts = make_attempts(plan, results, threads)
    with display(attempts) as update:
        if args.ray is None:
            run_locally(attempts, jobs, update, UPDATE_SECONDS)
        else:
            run_on_ray(attempts, args.ray, threads, update, UPDATE_SECONDS)
    failed = [attempt for attempt in attempts if attempt.status is RunStatus.FAILED]
    for attempt in failed:
        print(f"failed: {attempt.planned.name}: {attempt.error} (log: {attempt.log})")
    print(
        f"{len(attempts) - len(failed)} of {len(attempts)} runs finished\n"
        f"tables: lilgym-mp report {results} --out {results}-report"
    )
    return FAILED if failed else 0


@contextmanager
def display(attempts: Sequence[Attempt], console: Console | None = None) -> Iterator[Callable[[], None]]:
    """Shows the runs' statuses: as a live table on a terminal, else as a line per change; yields what updates it.

    `console`: standard output by default.
    """
    from rich import get_console
    from rich.live import Live

    console = console or get_console()
    if console.is_terminal:
        with Live(console=console, get_renderable=lambda: _table(attempts), auto_refresh=False) as live:
            live.refresh()
            yield live.refresh
        return
    printed: dict[str, str] = {}  # last status by run

    def print_changes() -> None:
        for attempt in attempts:
            name, status = attempt.planned.name, _status(attempt)
            if printed.get(name, "waiting") != status:
                print(f"{name}: {status}", flush=True)
            printed[name] = status

    print_changes()
    yield print_changes


def _table(attempts: Sequence[Attempt]) -> Table:
    from rich.table import Table

    table = Table(box=None, header_style="bold")
    for column in ("run", "state", "done", "time", "left"):
        table.add_column(column, justify="left" if column in ("run", "state") else "right")
    for attempt in attempts:
        elapsed, done = attempt.seconds, attempt.fraction_done
        if attempt.began is not None and not elapsed:
            elapsed = time.monotonic() - attempt.began
        percent = "" if done is None else f"{100 * done:.0f} %"
        left = elapsed * (1 - done) / done if done else 0
        times = (f"{int(seconds) // 60}:{int(seconds) % 60:02d}" if seconds else "" for seconds in (elapsed, left))
        table.add_row(attempt.planned.name, _status(attempt), percent, *times)
    return table


def _status(attempt: Attempt) -> str:
    return f"{attempt.status} {attempt.location}".strip()
