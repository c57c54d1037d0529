"""`lilgym-mp evaluate`: agents and simple policies on every task of a split, in one or several configurations."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.choices import choose
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import add_configuration, add_device, add_settings, add_split, said_settings
from lilgym_mp.corpus import NoTasksError
from lilgym_mp.evaluation.circumstances import Circumstances
from lilgym_mp.evaluation.comparison import EvaluationPlan, Result, play_all, playing, training_statements
from lilgym_mp.evaluation.episodes import GREEDY, SAMPLED
from lilgym_mp.evaluation.files import OutputError, writable_directory, writable_file, write_json
from lilgym_mp.evaluation.named_policies import BASELINES, BUILT_IN, NamedPolicy, built_in
from lilgym_mp.evaluation.policies import Policy, WithoutMask
from lilgym_mp.evaluation.recording import Recorder, episodes_file
from lilgym_mp.evaluation.report import LEGEND, results_json, supervision_table, table
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.learning.agents import Agent
    from lilgym_mp.learning.model_file import ModelDescription

AS_TRAINED, OFF = "as-trained", "off"
_MANNERS = {"ppo": [GREEDY, SAMPLED]}  # by kind of agent, unless --actions says otherwise


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
    parser.add_argument("--sampled", action="store_true", help="the same as --actions sampled")
    parser.add_argument(
        "--actions",
        nargs="+",
        choices=[GREEDY, SAMPLED],
        help="take the agents' likeliest actions, draw them, or one after the other (the default for PPO agents, "
        "whose likeliest action may be to stop at once; greedy for others)",
    )
    parser.add_argument(
        "--mask",
        nargs="+",
        choices=[AS_TRAINED, OFF],
        default=[AS_TRAINED],
        help="show masks of legal actions to agents that look at them (the default), or none, or both in turn",
    )
    parser.add_argument("--name", metavar="NAME", help="of the agent in the tables of a report (default: its learner)")
    parser.add_argument(
        "--record", type=Path, metavar="DIR", help="write every episode there, a file for each agent and configuration"
    )
    parser.add_argument(
        "--record-decisions",
        action="store_true",
        help="with --record: also keep, for each step, the agent's action probabilities, its value and the legal "
        "actions",
    )
    parser.add_argument(
        "--judge-decisions",
        action="store_true",
        help="with --record-decisions: ask the expert in each step whether the action taken begins a shortest solution "
        "(slow in Scatter)",
    )
    parser.add_argument(
        "--optimal", action="store_true", help="with --record: ask the expert how many actions each start needs"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results there as JSON")
    parser.add_argument("--alone", action="store_true", help="play the agents without random play beside them")
    parser.add_argument("--force", action="store_true", help="overwrite files that exist")
    add_device(parser)
    add_settings(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    if args.seed < 0 or args.passes < 1 or args.threads < 1:
        raise CommandError("--seed must be at least 0, --passes and --threads at least 1")
    if args.sampled and args.actions:
        raise CommandError("--sampled is short for --actions sampled; leave one of them out")
    if args.optimal and args.record is None:
        raise CommandError("--optimal goes with --record DIR, where what the expert finds is kept")
    if args.record_decisions and args.record is None:
        raise CommandError("--record-decisions goes with --record DIR, where they are kept")
    if args.judge_decisions and not args.record_decisions:
        raise CommandError("--judge-decisions goes with --record-decisions, which it judges")
    if not args.agents and not args.policy:
        raise CommandError("name the directories of trained agents, or policies with --policy")
    if args.json is not None and writable_file(args.json).exists() and not args.force:
        raise OutputError(f"{args.json} exists; --force overwrites it")
    agents = [named for place in args.agents for named in agent_policies(place, args)]
    policies = [built_in(name) for name in args.policy] or (list(BASELINES) if agents and not args.alone else [])
    named = [*agents, *policies]
    plans = [
        EvaluationPlan(settings, args.split, args.seed, args.passes, record_decisions=args.record_decisions)
        for settings in _settings(args, agents)
    ]
    _check_record(args, named, plans)
    results: list[Result] = []
    with Progress(sum(plan.episodes * len(playing(named, plan)) for plan in plans), "episodes") as progress:
        for plan in plans:
            seen = training_statements(plan.settings)
            played = play_all(named, plan, seen, lambda episode: progress.advance())
            results += played if args.record is None else _recorded(played, args, plan, seen)
            print(f"{plan}: done", flush=True)
    print(f"\n{table(results)}\n\n{supervision_table(results)}\n\n{LEGEND}")
    for warning in warnings(results):
        print(warning)
    if args.json is not None:
        write_json(args.json, results_json(results))
        print(f"results: {args.json}")
    return 0


def _check_record(
    args: argparse.Namespace, named_policies: Sequence[NamedPolicy], plans: Sequence[EvaluationPlan]
) -> None:
    """Raises OutputError when the directory cannot be written to, or holds one of the files already."""
    if args.record is None:
        return
    writable_directory(args.record)
    for plan in plans:
        for named in named_policies:
            path = episodes_file(args.record, named, plan.settings, plan.split, plan.seed)
            if path.exists() and not args.force:
                raise OutputError(f"{path} exists; --force overwrites it")


def _recorded(
    played: Iterable[Result], args: argparse.Namespace, plan: EvaluationPlan, seen: set[str]
) -> Iterator[Result]:
    """The results, each written as it comes."""
    recorder = Recorder(
        plan.settings, plan.split, seen, asks_expert=args.optimal, judges_decisions=args.judge_decisions
    )
    for result in played:
        path = recorder.write(args.record, result)
        Circumstances.now(args.words).write(path)
        print(f"episodes: {path}", flush=True)
        yield result


def agent_policies(place: Path, args: argparse.Namespace) -> list[NamedPolicy]:
    """The agent at a place, once for each way in which the command line wants it to act."""
    import torch

    from lilgym_mp.learning.agents import open_agent

    torch.set_num_threads(args.threads)
    agent = open_agent(place, args.device)
    description = agent.description
    manners = [SAMPLED] if args.sampled else args.actions or _MANNERS.get(description.kind, [GREEDY])
    masks = args.mask if _looks_at_masks(agent, args) else [AS_TRAINED]
    common = {
        "kind": description.kind,
        "run": str(place),
        "recipe": dict(description.recipe),
        "label": args.name or description.kind,
        "training_seed": description.recipe.get("seed", description.details.get("seed")),
        "training": training_facts(description),
    }
    return [
        NamedPolicy(
            _name(description.kind, place, [manner] * (len(manners) > 1), [mask] * (len(masks) > 1)),
            partial(_policy, agent, manner == SAMPLED, mask == OFF),
            description.supervision,
            description.configurations,
            False if mask == OFF else None,
            {**common, "actions": manner},
        )
        for manner in manners
        for mask in masks
    ]


def _name(kind: str, place: Path, manner: list[str], mask: list[str]) -> str:
    return ", ".join([f"{kind} ({place})", *manner, *(f"mask {name}" for name in mask)])


def _policy(agent: Agent, sampled: bool, without_mask: bool, settings: Settings) -> Policy:
    policy = agent.policy(settings, sampled=sampled)
    return WithoutMask(policy) if without_mask else policy


def _looks_at_masks(agent: Agent, args: argparse.Namespace) -> bool:
    options = {key: value for key, value in said_settings(args).items() if key != "configuration"}
    settings = Settings((args.configuration or agent.description.configurations)[0], **options)
    if settings.configuration not in agent.description.configurations:
        return False  # refused later, with the choices
    return getattr(agent.policy(settings), "needs_masks", True)


def training_facts(description: ModelDescription) -> dict[str, float]:
    """What an agent's training took, as far as its description tells."""
    details, recipe = description.details, description.recipe
    found: dict[str, float] = {}
    if (steps := details.get("steps", recipe.get("steps"))) is not None:
        found["steps"] = steps
    if (minutes := details.get("cpu_minutes")) is not None:
        found["cpu_minutes"] = minutes
    elif (seconds := details.get("cpu_seconds", details.get("seconds"))) is not None:
        found["cpu_minutes"] = round(seconds / 60, 2)
    return found


def _settings(args: argparse.Namespace, agents: Sequence[NamedPolicy]) -> list[Settings]:
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
                f"note: {result.name} stops at once in every episode of {result.plan.settings.configuration};"
                " look at drawn actions (--actions sampled), or train it longer"
            )
    return told
