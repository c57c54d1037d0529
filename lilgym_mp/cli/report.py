"""Make the paper's tables and figures for recorded episodes.

Writes a page, DIR/index.html, with the paper's tables and figures and more for all recorded episodes; tables also as
CSV and LaTeX, figures also as PDF. `lilgym-mp evaluate --record` and `experiment` record them.
"""

from __future__ import annotations

import argparse
from pathlib import Path


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `lilgym-mp report`."""
    parser.add_argument(
        "paths",
        nargs="+",
        type=Path,
        metavar="DIR_OR_RUN",
        help="directories or files written by `evaluate --record` or `experiment`; run directories for training curves",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="directory of the report")


def run(args: argparse.Namespace) -> int:
    """Writes the report and prints where it is."""
    from lilgym_mp.contrib.report import make_report

    print(f"report: {make_report(args.paths, args.out)}")
    return 0
