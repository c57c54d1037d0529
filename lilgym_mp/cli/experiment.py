"""`lilgym-mp experiment FILE.toml`: a matrix of configurations, learners and seeds, trained, evaluated and recorded."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.cli.errors import CommandError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from lilgym_mp.cli.experiment_runs import Attempt

RESULTS = Path("results")
FAILED = 1  # exit code where a run failed


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "experiment",
        help="train, evaluate and record a matrix of configurations, learners and seeds",
        description="Carries out every run that a TOML file asks for; the same command goes on where it was "
        "interrupted. `lilgym-mp report DIR` makes the tables and figures of the results.",
    )
    parser.add_argument("file", type=Path, metavar="FILE.toml", help="what to run; docs/experiments.md tells its keys")
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"results (default: {RESULTS}/FILE)")
    parser.add_argument("--jobs", type=int, metavar="N", help="runs at a time on this machine (default: 1)")
    parser.add_argument(
        "--ray",
        metavar="ADDRESS",
        help='on the Ray cluster there ("auto": the one that this machine is of), a processor for each run',
    )
    parser.add_argument("--list", action="store_true", help="print the commands, and run nothing")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.cli.experiment_plan import read_plan
    from lilgym_mp.cli.experiment_ray import carry_out_on_ray
    from lilgym_mp.cli.experiment_runs import Standing, attempts, carry_out

    jobs = 1 if args.jobs is None else args.jobs
    if jobs < 1:
        raise CommandError(f"--jobs must be at least 1, not {jobs}")
    if args.ray is not None and args.jobs is not None:
        raise CommandError("--jobs is for runs on this machine; how many go at once with --ray, the cluster says")
    plan = read_plan(args.file)
    if args.list:
        for planned in plan:
            print("\n".join(f"{planned.name}: lilgym-mp {' '.join(words)}" for words in planned.commands if words))
        return 0
    place = args.out or RESULTS / args.file.stem
    threads = 1 if args.ray is not None else max(1, (os.cpu_count() or 1) // jobs)
    made = attempts(plan, place, threads)
    with Display(made) as display:
        if args.ray is None:
            carry_out(made, jobs, display.update, display.every)
        else:
            carry_out_on_ray(made, args.ray, threads, display.update, display.every)
    failed = [attempt for attempt in made if attempt.standing is Standing.FAILED]
    for attempt in failed:
        print(f"failed: {attempt.planned.name}: {attempt.error} (log: {attempt.log})")
    print(
        f"{len(made) - len(failed)} of {len(made)} runs finished\ntables: lilgym-mp report {place} --out {place}-report"
    )
    return FAILED if failed else 0


class Display:
    """How the runs stand: a live table on a terminal, else a line for each change. A context manager."""

    def __init__(self, made: Sequence[Attempt], console: Console | None = None) -> None:
        """`console`: to show them on, standard output by default."""
        from rich import get_console
        from rich.live import Live

        self._made = made
        self._told: dict[str, str] = {}
        console = console or get_console()
        live = Live(console=console, get_renderable=self._table, auto_refresh=False)
        self._live = live if console.is_terminal else None
        self.every = 1.0

    def __enter__(self) -> Display:
        if self._live is not None:
            self._live.start(refresh=True)
        self.update()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._live is not None:
            self._live.stop()

    def update(self) -> None:
        if self._live is not None:
            self._live.refresh()
            return
        for attempt in self._made:
            name, standing = attempt.planned.name, state(attempt)
            if self._told.get(name, "waiting") != standing:
                print(f"{name}: {standing}", flush=True)
            self._told[name] = standing

    def _table(self) -> Table:
        from rich.table import Table

        table = Table(box=None, header_style="bold")
        for column in ("run", "state", "done", "time", "left"):
            table.add_column(column, justify="left" if column in ("run", "state") else "right")
        for attempt in self._made:
            table.add_row(*row(attempt))
        return table


def row(attempt: Attempt) -> list[str]:
    """A run's name, standing, share of its training, time so far and time left."""
    spent = attempt.seconds
    share = attempt.share_done
    if attempt.began is not None and not spent:
        spent = time.monotonic() - attempt.began
    left = spent * (1 - share) / share if share else None
    return [
        attempt.planned.name,
        state(attempt),
        "" if share is None else f"{100 * share:.0f} %",
        minutes(spent) if spent else "",
        "" if left is None else minutes(left),
    ]


def state(attempt: Attempt) -> str:
    """Its standing, and where it goes on."""
    return f"{attempt.standing} {attempt.where}".strip()


def minutes(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"
