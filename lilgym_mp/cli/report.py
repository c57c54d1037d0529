"""`lilgym-mp report`: every table and figure of the paper, and more, for the agents whose episodes were recorded."""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import add_split
from lilgym_mp.evaluation.episodes import SUFFIX, read_header

AGENT_FILE, RUN_FILE = "agent.safetensors", "run.json"


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "report",
        help="tables and figures of the paper for recorded episodes",
        description="Makes one page, DIR/index.html, with the paper's tables and figures and more for everything "
        "recorded in the places; each item as CSV and Markdown, or SVG and PNG, too. A run whose episodes were not "
        "recorded is played first, beside the expert and random play.",
    )
    parser.add_argument(
        "places",
        nargs="+",
        type=Path,
        metavar="DIR_OR_RUN",
        help="directories or files that `evaluate --record` or `experiment` wrote, or directories of training runs",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where the report goes")
    parser.add_argument(
        "--tags", type=Path, metavar="FILE", help="hand-made phenomena: JSON, statements with their lists"
    )
    parser.add_argument(
        "--document",
        type=Path,
        metavar="FILE.md",
        help="also the main tables and figures as a Markdown page without statements, pictures beside it",
    )
    parser.add_argument("--corpus", metavar="NAME", help="for runs that are played (default: that of their training)")
    add_split(parser, "dev")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.report import make_report
    from lilgym_mp.report.html_report import check_directory
    from lilgym_mp.report.markdown_report import check_document

    check_directory(args.out)
    if args.document is not None:
        check_document(args.document)
    runs = [place for place in args.places if is_run_alone(place)]
    places = [place for place in args.places if place not in runs]
    recorded = recorded_runs(places)
    unplayed = [place for place in runs if place.resolve() not in recorded]
    try:
        with tempfile.TemporaryDirectory() as played:
            if unplayed:
                _play(unplayed, Path(played), args.corpus, args.split)
                places.append(Path(played))
            command = " ".join(["lilgym-mp", *args.words])
            page = make_report(places, args.out, tags=args.tags, runs=runs, document=args.document, command=command)
    except ImportError as error:
        raise CommandError(str(error)) from None
    print(f"report: {page}")
    if args.document is not None:
        print(f"page:   {args.document}")
    return 0


def is_run_alone(place: Path) -> bool:
    """Whether the directory is of a training run with an agent and without recorded episodes."""
    return (place / AGENT_FILE).is_file() and not any(place.rglob(f"*{SUFFIX}"))


def recorded_runs(places: Sequence[Path]) -> set[Path]:
    """The directories of the agents whose episodes are recorded in the places. Raises EpisodesError."""
    files = [file for place in places if place.is_dir() for file in sorted(place.rglob(f"*{SUFFIX}"))]
    headers = map(read_header, [*files, *(place for place in places if place.is_file())])
    return {Path(header.run).resolve() for header in headers if header is not None and header.run is not None}


def _play(places: Sequence[Path], directory: Path, corpus: str | None, split: str) -> None:
    """Records the runs, the expert and random play."""
    from lilgym_mp.cli import parsed

    for corpus_name in dict.fromkeys(corpus or trained_on(place) for place in places):
        own = [place for place in places if (corpus or trained_on(place)) == corpus_name]
        words = [*map(str, own), "--policy", "expert", "random-legal", "random-type", "--corpus", corpus_name]
        args = parsed(["evaluate", *words, "--split", split, "--record", str(directory), "--optimal"])
        args.run(args)


def trained_on(place: Path) -> str:
    """The corpus of a training run, by its description. Raises CommandError."""
    file = place / RUN_FILE
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        identity = data.get("identity", data)
        return str(identity["corpus"] if "corpus" in identity else identity["environment"]["corpus"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise CommandError(
            f"{file}: does not say which corpus the run was trained on; name one with --corpus"
        ) from None
