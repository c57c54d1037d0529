"""Train, evaluate and record a matrix of configurations, learners and seeds.

Executes all runs described by a TOML file. If interrupted, the same command resumes them. `lilgym-mp report DIR --out
REPORT` makes tables and figures of the results. With --split, evaluates the trained runs on another split.
"""

from __future__ import annotations

import shlex
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lilgym_mp.cli.options import CommandError, add_flag, add_number, check_at_least
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.evaluation.files import SUFFIX, write_text
from lilgym_mp.evaluation.terminal import Progress
from lilgym_mp.scene.choices import choose

if TYPE_CHECKING:
    from lilgym_mp.cli.experiment_runs import Attempt

RESULTS = Path("results")


def add_options(parser: ArgumentParser) -> None:
    """Adds the options of `lilgym-mp experiment`."""
    parser.add_argument(
        "file", type=Path, metavar="FILE.toml", help="the experiment; docs/experiments.md lists its keys"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"results directory (default: {RESULTS}/FILE)")
    add_number(parser, "--jobs", 1, "parallel runs")
    parser.add_argument(
        "--ray",
        nargs="?",
        const="",
        metavar="ADDRESS",
        help="execute the runs as tasks of the Ray cluster at ADDRESS, such as auto, or of one on this machine;"
        " DIR must be on a file system that all its machines share",
    )
    add_flag(parser, "--list", "print the commands without running them")
    parser.add_argument("--only", nargs="+", metavar="RUN", help="execute only these runs; --list prints the names")
    parser.add_argument(
        "--split", choices=list(SPLITS), help="train nothing; evaluate the runs in DIR on this split, as a table"
    )


def run(args: Namespace) -> int:
    """Lists or executes the runs of an experiment file; returns the exit status."""
    from lilgym_mp.cli.experiment_plan import OUT, read_plan
    from lilgym_mp.cli.experiment_runs import FINISHED, RunStatus, execute, make_attempts
    from lilgym_mp.envs.machine import usable_cores

    check_at_least(args, 1, "jobs")
    plan = read_plan(args.file, args.split)
    if args.only:
        by_name = {planned.name: planned for planned in plan}
        plan = [choose("run", name, by_name) for name in dict.fromkeys(args.only)]
    results = args.out or RESULTS / args.file.stem
    if args.list:
        for planned in plan:
            for words in planned.commands:
                print(f"{planned.name}: lilgym-mp {shlex.join(word.replace(OUT, str(results)) for word in words)}")
        return 0
    for planned in plan if args.split else ():
        if planned.train and not (results / FINISHED / f"{planned.name}.json").exists():
            raise CommandError(f"{planned.name}: was not trained; execute the experiment without --split first")
    threads = max(1, usable_cores() // args.jobs)
    attempts = make_attempts(plan, results, threads)
    if args.ray is not None:
        unfinished = [attempt.planned.name for attempt in attempts if attempt.status is not RunStatus.FINISHED]
        from lilgym_mp.cli.experiment_ray import execute_on_ray

        errors: dict[str, str] = {}
        split = ["--split", args.split] if args.split else []
        for name, error in execute_on_ray(args.ray, unfinished, args.file, results, threads, split):
            print(f"{name}: {'failed' if error else 'finished'}", flush=True)
            errors[name] = error
        attempts = make_attempts(plan, results, threads)
        for attempt in attempts:
            attempt.error = errors.get(attempt.planned.name, "")
    with display(attempts) as update:
        if args.ray is None:
            execute(attempts, args.jobs, update, poll_seconds=1.0)
    failed = [attempt for attempt in attempts if attempt.status is not RunStatus.FINISHED]
    for attempt in failed:
        print(f"failed: {attempt.planned.name}: {attempt.error} (log: {attempt.log})")
    print(f"{len(attempts) - len(failed)} of {len(attempts)} runs finished")
    if args.split is None:
        print(f"tables: lilgym-mp report {shlex.join([str(results), '--out', f'{results}-report'])}")
    else:
        _write_table(results / f"{args.split}.md", attempts, args.split)
    return 1 if failed else 0


@contextmanager
def display(attempts: Sequence[Attempt]) -> Iterator[Callable[[], None]]:
    """Prints a line for each change of a run's status, above a bar on a terminal; yields what updates it."""
    from lilgym_mp.cli.experiment_runs import RunStatus

    printed = {attempt.planned.name: RunStatus.WAITING for attempt in attempts}
    with Progress(len(attempts), "runs", prints=False) as bar:

        def update() -> None:
            for attempt in attempts:
                name = attempt.planned.name
                status = attempt.status
                if printed[name] != status:
                    print(f"{name}: {status}", flush=True)
                printed[name] = status
            shares = {attempt.planned.name: attempt.fraction_done for attempt in attempts}
            note = ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items() if share is not None)
            bar.reach(sum(attempt.status is RunStatus.FINISHED for attempt in attempts), note)

        update()
        yield update


def _write_table(file: Path, attempts: Sequence[Attempt], split: str) -> None:
    """Writes the accuracies of the recorded episodes of the split as Markdown."""
    from lilgym_mp.contrib.report.items import Table
    from lilgym_mp.contrib.report.report_data import load_report_data
    from lilgym_mp.contrib.report.results import table_2
    from lilgym_mp.evaluation.episode_files import read_header

    files = [file for attempt in attempts for file in sorted(attempt.episodes.glob(f"*{SUFFIX}"))]
    files = [file for file in files if read_header(file).split == split]
    if files:
        items = table_2(load_report_data(files))
        text = "".join(item.markdown() for item in items if isinstance(item, Table))
        write_text(file, text)
        print(f"{text}\ntable: {file}")
