"""Make the paper's tables and figures for recorded episodes.

Writes a page, DIR/index.html, with the paper's tables and figures and more for all recorded episodes; tables also as
CSV and LaTeX, figures also as PDF. `lilgym-mp evaluate --record` and `experiment` record them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from lilgym_mp.evaluation.episodes import read_episodes
from lilgym_mp.evaluation.files import SUFFIX


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "paths",
        nargs="+",
        type=Path,
        metavar="DIR_OR_RUN",
        help="directories or files written by `evaluate --record` or `experiment`; run directories for training curves",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="directory of the report")
    parser.add_argument(
        "--check",
        action="store_true",
        help="first play all recorded actions and compute the tasks' facts again; end at the first difference",
    )


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.contrib.report import make_report
    from lilgym_mp.contrib.report.writing import check_output
    from lilgym_mp.evaluation.recording import check_recording

    check_output(args.out)
    if args.check:
        files = [file for path in args.paths for file in (path.rglob(f"*{SUFFIX}") if path.is_dir() else [path])]
        for file in sorted(files):
            check_recording(read_episodes(file))
        print(f"checked: {len(files)} recordings, every action played again")
    print(f"report: {make_report(args.paths, args.out)}")
    return 0
