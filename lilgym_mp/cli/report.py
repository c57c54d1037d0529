"""Make the paper's tables and figures for recorded episodes.

Writes a page, DIR/index.html, with the paper's tables and figures and more for all recorded episodes; tables also as
CSV and LaTeX, figures also as PDF. `lilgym-mp evaluate --record` and `experiment` record them. Runs of `train game`
play on dev, each with every other and with scripted partners; results that `evaluate --out` wrote for games are read.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

from lilgym_mp.evaluation.files import write_json


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
    with TemporaryDirectory() as directory:
        paths = list(args.paths)
        if runs := game_runs(paths):
            from lilgym_mp.cli.evaluate_game import play_on_dev
            from lilgym_mp.learning.common.agents import open_agent

            paths.append(Path(directory, "games.json"))
            write_json(paths[-1], {"results": play_on_dev({run: open_agent(run, "cpu") for run in runs})})
        print(f"report: {make_report(paths, args.out)}")
    return 0
