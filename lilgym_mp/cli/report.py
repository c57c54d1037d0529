"""Make the paper's tables and figures for recorded episodes.

Writes a page, DIR/index.html, with the paper's tables and figures and more for all recorded episodes; tables also as
CSV and LaTeX, figures also as PDF. `lilgym-mp evaluate --record` and `experiment` record them. Runs of `train game`
play on dev, each with every other and with scripted partners; results that `evaluate --out` wrote for games are read.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `lilgym-mp report`."""
    parser.add_argument(
        "paths",
        nargs="+",
        type=Path,
        metavar="DIR_OR_RUN",
        help="directories or files written by `evaluate --record` or `experiment`; run directories, for training curves"
        " and for pairs of the two-agent game; JSON files of games written by `evaluate --out`",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="directory of the report")


def run(args: argparse.Namespace) -> int:
    """Writes the report and prints where it is."""
    from lilgym_mp.contrib.report import make_report
    from lilgym_mp.contrib.report.games import game_runs
    from lilgym_mp.contrib.report.writing import check_output

    check_output(args.out)
    runs = game_runs(args.paths)
    print(f"report: {make_report(args.paths, args.out, _played(runs) if runs else ())}")
    return 0


def _played(runs: Sequence[Path]) -> list[dict[str, Any]]:
    from lilgym_mp.cli.evaluate_game import results_for_report
    from lilgym_mp.learning.common.agents import open_agent

    return results_for_report({run: open_agent(run, "cpu") for run in runs})
