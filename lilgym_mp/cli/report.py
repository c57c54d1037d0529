"""Make the paper's tables and figures for recorded episodes.

Writes a page, DIR/index.html, with the paper's tables and figures and more for all recorded episodes; tables also as
CSV, Markdown and LaTeX, figures also as SVG, PNG and PDF. Runs without recorded episodes are evaluated first, together
with the expert and random policies.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

from lilgym_mp.evaluation.episodes import read_episodes, read_header
from lilgym_mp.evaluation.files import SUFFIX
from lilgym_mp.evaluation.options import CommandError, add_split
from lilgym_mp.learning.common.run_directory import AGENT_FILE, RUN_FILE, begin_run


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "paths",
        nargs="+",
        type=Path,
        metavar="DIR_OR_RUN",
        help="directories or files written by `evaluate --record` or `experiment`, or run directories",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="directory of the report")
    parser.add_argument(
        "--document",
        type=Path,
        metavar="FILE.md",
        help="also write the main tables and figures, without statements, as a Markdown page with pictures next to it",
    )
    parser.add_argument(
        "--corpus", metavar="NAME", help="corpus to evaluate runs on (default: the one they were trained on)"
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="first play all recorded actions and compute the tasks' facts again; end at the first difference",
    )
    add_split(parser, "dev")


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.contrib.report import make_report
    from lilgym_mp.contrib.report.writing import check_output
    from lilgym_mp.evaluation.recording import check_recording

    check_output(args.out, args.document)
    recordings = {path: _recordings(path) for path in args.paths}
    runs = [path for path, files in recordings.items() if not files and (path / AGENT_FILE).is_file()]
    paths = [path for path in args.paths if path not in runs]
    files = [file for found in recordings.values() for file in found]
    if args.check:
        for file in files:
            check_recording(read_episodes(file))
        print(f"checked: {len(files)} recordings, every action played again")
    headers = [header for header in map(read_header, files) if header is not None]
    recorded = {Path(header.run).resolve() for header in headers if header.run is not None}
    unrecorded = [path for path in runs if path.resolve() not in recorded]
    try:
        with tempfile.TemporaryDirectory() as recordings:
            if unrecorded:
                _evaluate(unrecorded, Path(recordings), args.corpus, args.split)
                paths.append(Path(recordings))
            command = " ".join(["lilgym-mp", *args.argv])
            page = make_report(paths, args.out, runs=runs, document=args.document, command=command)
    except ImportError as error:
        raise CommandError(str(error)) from None
    print(f"report: {page}")
    if args.document is not None:
        print(f"page:   {args.document}")
    return 0


def _recordings(path: Path) -> list[Path]:
    if path.is_dir():
        return sorted(path.rglob(f"*{SUFFIX}"))
    return [path] if path.is_file() else []


def _evaluate(paths: Sequence[Path], directory: Path, corpus: str | None, split: str) -> None:
    """Evaluates and records the runs, the expert and random policies."""
    from lilgym_mp.cli import parse_args

    corpora = {path: corpus or training_corpus_of(path) for path in paths}
    for name in dict.fromkeys(corpora.values()):
        runs = [str(path) for path in paths if corpora[path] == name]
        options = ["--policy", "expert", "random-legal", "random-type", "--corpus", name, "--split", split]
        args = parse_args(["evaluate", *runs, *options, "--record", str(directory), "--optimal"])
        args.run(args)


def training_corpus_of(path: Path) -> str:
    """The corpus that a run was trained on, from its description. Raises CommandError."""
    try:
        identity = begin_run(path, {}, resume=True).identity
        return str(identity["corpus"] if "corpus" in identity else identity["environment"]["corpus"])
    except (ValueError, KeyError, TypeError):
        raise CommandError(
            f"{path / RUN_FILE}: does not say which corpus the run was trained on; name one with --corpus"
        ) from None
