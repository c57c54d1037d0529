"""`lilgym-mp evaluate`: an agent on every task of a split, beside policies that know nothing."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import add_configuration, add_settings, add_split, said_settings
from lilgym_mp.evaluation.comparison import BASELINES, Contestant, Trial, training_statements
from lilgym_mp.evaluation.files import writable_file, write_json
from lilgym_mp.evaluation.report import LEGEND, results_json, table
from lilgym_mp.evaluation.settings import Settings

FIXED = ("configuration", "grid")  # an agent cannot be evaluated on others than it was trained on


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "evaluate",
        help="an agent on every task of a split, beside random play",
        description="Visits every task of a split once a pass; stopping is never forced.",
    )
    parser.add_argument("agent", nargs="?", type=Path, metavar="RUN", help="directory that `lilgym-mp train` wrote")
    add_configuration(parser, "--configuration", help="for random play alone, in place of RUN")
    add_split(parser, "dev")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of what policies draw (default: 0)")
    parser.add_argument("--passes", type=int, default=1, metavar="N", help="visits to each task (default: 1)")
    parser.add_argument("--sampled", action="store_true", help="draw the agent's actions; else the likeliest is taken")
    parser.add_argument("--out", type=Path, metavar="FILE", help="results as JSON (default: RUN/evaluation-SPLIT.json)")
    add_settings(parser)
    parser.set_defaults(run=run)


class _Entry(NamedTuple):
    """Who is to be evaluated, and where."""

    settings: Settings
    contestants: tuple[Contestant, ...]
    seen_statements: set[str]


def run(args: argparse.Namespace) -> int:
    if args.seed < 0 or args.passes < 1:
        raise CommandError("--seed must be at least 0 and --passes at least 1")
    out: Path | None = args.out or (args.agent and args.agent / f"evaluation-{args.split}.json")
    entry = _nobody(args) if args.agent is None else trained(args.agent, said_settings(args), sampled=args.sampled)
    if out is not None:
        writable_file(out)
    trial = Trial(entry.settings, args.split, args.seed, args.passes)
    results = list(trial.results((*entry.contestants, *BASELINES), entry.seen_statements))
    print(f"{trial}\n\n{table(results)}\n\n{LEGEND}")
    if out is not None:
        write_json(out, results_json({"evaluation": (trial, results)}))
        print(f"results: {out}")
    return 0


def _nobody(args: argparse.Namespace) -> _Entry:
    if args.configuration is None:
        raise CommandError("name the directory of a trained agent, or --configuration for random play alone")
    settings = Settings(**said_settings(args))
    return _Entry(settings, (), training_statements(settings))


def trained(directory: Path, said: dict[str, Any], *, sampled: bool = False) -> _Entry:
    """The agent of a run, in its own environment but for what was said."""
    from lilgym_mp.learning.training import open_run

    run = open_run(directory, {name: value for name, value in said.items() if name in FIXED})
    details = {
        "actions": "sampled" if sampled else "greedy",
        "run": str(directory),
        "steps": run.steps,
        "checkpoint_sha256": run.directory.checkpoint_sha256(),
        "trained_with": run.identity.to_json(),
    }
    contestant = Contestant("trained agent", run.agent(greedy=not sampled), details)
    return _Entry(dataclasses.replace(run.identity.settings, **said), (contestant,), {t.statement for t in run.tasks})
