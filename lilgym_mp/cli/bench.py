"""Measure the steps per second of all ways to run the environments.

Plays the same recorded actions in all ways to run the environments, alternating between them, and compares their speed
with that of copying the observations.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import Any

from lilgym_mp.choices import choose
from lilgym_mp.evaluation.files import writable_directory, writable_file, write_atomically, write_json, write_text
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.options import CONFIGURATIONS_HELP, INTERRUPTED, RUNS, CommandError, add_corpus
from lilgym_mp.terminal import Progress, show_markdown

OUTPUT = RUNS / "bench"
QUICK_CONFIGURATIONS = ("TowerFlipIt", "ScatterFlipIt")
CHART = "benchmark_scaling.png"
PICTURES = "pictures"  # subdirectory of the document's directory


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="GROUP",
        help="any of single, batched, workers, wrappers, sb3, pettingzoo, parts (default: all)",
    )
    parser.add_argument(
        "--configurations", nargs="+", metavar="NAME", help=f"any of {CONFIGURATIONS_HELP} (default: all)"
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"take only about a minute: fewer rounds, and only {' and '.join(QUICK_CONFIGURATIONS)}",
    )
    add_corpus(parser)
    parser.add_argument(
        "--output", type=Path, default=OUTPUT, metavar="DIR", help="directory of the results (default: %(default)s)"
    )
    parser.add_argument("--write-docs", type=Path, metavar="FILE", help="update the tables and the chart of a document")


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.benchmark import EFFORTS, GROUPS, Bench, Workload, benchmark_cases

    names = args.configurations or (QUICK_CONFIGURATIONS if args.quick else CONFIGURATIONS)
    for name in names:
        choose("configuration", name, CONFIGURATIONS)
    chosen = benchmark_cases(args.only or GROUPS)
    output = writable_directory(args.output)
    if args.write_docs is not None:
        _with_tables(args.write_docs, "")  # fails now if the document has no place for tables
    effort = EFFORTS["quick" if args.quick else "full"]
    bench = Bench(effort)
    # A thread that redraws the bar would disturb the measurements.
    with Progress(len(names) * effort.repeats, "rounds", redraws_by_itself=False) as progress:
        for name in names:
            if not bench.is_interrupted:
                workload = Workload(name, args.corpus, actions=effort.actions)
                note = f"{name}, {len(chosen)} cases"
                bench.measure(workload, chosen, partial(progress.advance, note=note))
    _write(bench, output, args.write_docs)
    return INTERRUPTED if bench.is_interrupted else 0


def _write(bench: Any, output: Path, document: Path | None) -> None:
    """Prints the tables, and writes tables, JSON and chart to `output` and the document."""
    from lilgym_mp.benchmark.report import report_json, report_text, scaling_chart
    from lilgym_mp.plotting import save

    text = report_text(bench)
    show_markdown(text)
    write_text(output / "bench.md", text + "\n")
    write_json(output / "bench.json", report_json(bench))
    charts = [output / CHART]
    if document is not None:
        write_text(document, _with_tables(document, text))
        charts.append(document.parent / PICTURES / CHART)
    try:
        if (chart := scaling_chart(bench)) is not None:
            for path in charts:
                write_atomically(writable_file(path), lambda unfinished: save(chart, unfinished, "png"))
    except ImportError as missing:
        print(f"no chart: {missing}", file=sys.stderr)
    print(f"results: {output}" + (f", {document}" if document else ""), file=sys.stderr)


def _with_tables(document: Path, text: str) -> str:
    """The document's text with its tables replaced."""
    from lilgym_mp.benchmark.report import insert_tables

    try:
        return insert_tables(document.read_text(encoding="utf-8"), text)
    except OSError as error:
        raise CommandError(f"cannot read {document}: {error.strerror or error}") from None
    except ValueError as error:
        raise CommandError(f"{document}: {error}") from None
