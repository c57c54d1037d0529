"""`lilgym-mp evaluate`: agents and simple policies on every task of a split, in one or several configurations."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lilgym_mp.choices import choose
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import add_configuration, add_device, add_settings, add_split, said_settings
from lilgym_mp.corpus import NoTasksError
from lilgym_mp.evaluation.comparison import Result, Trial, play_all, training_statements
from lilgym_mp.evaluation.contestants import BASELINES, BUILT_IN, Contestant, built_in
from lilgym_mp.evaluation.files import OutputError, writable_file, write_json
from lilgym_mp.evaluation.report import LEGEND, results_json, supervision_table, table
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "evaluate",
        help="agents and simple policies on every task of a split",
        description="Visits every task of a split once a pass; stopping is never forced, and illegal actions are not "
        "masked. Without --policy, random play is shown beside the agents.",
    )
    parser.add_argument(
        "agents", nargs="*", type=Path, metavar="RUN", help="directories that `lilgym-mp train` wrote, or model files"
    )
    parser.add_argument(
        "--policy", nargs="+", default=[], metavar="NAME", help=f"also these: {', '.join(sorted(BUILT_IN))}"
    )
    add_configuration(
        parser, "--configuration", nargs="+", help="play these only (default: all that the agents can play)"
    )
    add_split(parser, "dev")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of what policies draw (default: 0)")
    parser.add_argument("--passes", type=int, default=1, metavar="N", help="visits to each task (default: 1)")
    parser.add_argument("--sampled", action="store_true", help="draw the agents' actions; else the likeliest is taken")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results there as JSON")
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    add_device(parser)
    add_settings(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    if args.seed < 0 or args.passes < 1 or args.threads < 1:
        raise CommandError("--seed must be at least 0, --passes and --threads at least 1")
    if not args.agents and not args.policy:
        raise CommandError("name the directories of trained agents, or policies with --policy")
    if args.json is not None and writable_file(args.json).exists() and not args.force:
        raise OutputError(f"{args.json} exists; --force overwrites it")
    agents = [agent_contestant(place, args) for place in args.agents]
    policies = [built_in(name) for name in args.policy] or (list(BASELINES) if agents else [])
    results: list[Result] = []
    for settings in _settings(args, agents):
        trial = Trial(settings, args.split, args.seed, args.passes)
        seen = training_statements(settings)
        results += play_all([*agents, *policies], trial, seen)
        print(f"{trial}: done", flush=True)
    print(f"\n{table(results)}\n\n{supervision_table(results)}\n\n{LEGEND}")
    for warning in warnings(results):
        print(warning)
    if args.json is not None:
        write_json(args.json, results_json(results))
        print(f"results: {args.json}")
    return 0


def agent_contestant(place: Path, args: argparse.Namespace) -> Contestant:
    """The agent at a place, as the command line wants it to act."""
    import torch

    from lilgym_mp.learning.agents import open_agent

    torch.set_num_threads(args.threads)
    agent = open_agent(place, args.device)
    description = agent.description
    name = f"{description.kind} ({place})"
    details = {
        "kind": description.kind,
        "actions": "sampled" if args.sampled else "greedy",
        "run": str(place),
        "recipe": dict(description.recipe),
    }
    return Contestant(
        name,
        lambda settings: agent.policy(settings, sampled=args.sampled),
        description.supervision,
        description.configurations,
        details,
    )


def _settings(args: argparse.Namespace, agents: Sequence[Contestant]) -> list[Settings]:
    """What is to be played, in the order of CONFIGURATIONS unless named."""
    named = [
        choose("configuration", name, {name: name for name in CONFIGURATIONS}) for name in args.configuration or ()
    ]
    playable = {name for agent in agents for name in agent.configurations} if agents else set(CONFIGURATIONS)
    for name in named:
        for agent in agents:
            if name not in agent.configurations:
                raise CommandError(f"{agent.name} does not play {name}; it plays {', '.join(agent.configurations)}")
    options = {key: value for key, value in said_settings(args).items() if key != "configuration"}
    chosen = [Settings(name, **options) for name in named or CONFIGURATIONS if name in playable]
    return chosen if named else [settings for settings in chosen if _has_tasks(settings, args.split)]


def _has_tasks(settings: Settings, split: str) -> bool:
    try:
        settings.make(split)
    except NoTasksError:
        return False
    return True


def warnings(results: Sequence[Result]) -> list[str]:
    """What a reader of the table should know."""
    told: list[str] = []
    for result in results:
        stopped = sum(len(episode.actions) == 1 for episode in result.episodes)
        if stopped == len(result.episodes) and result.summary.accuracy < 0.5:
            told.append(
                f"note: {result.name} stops at once in every episode of {result.trial.settings.configuration};"
                " try --sampled, or train it longer"
            )
    return told
