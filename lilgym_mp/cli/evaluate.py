"""Evaluate agents and baseline policies on a split.

Plays every task of a split once per pass, without stop forcing; only agents trained with a mask of legal actions get
one. Random policies are evaluated too, for comparison, unless --policy or --alone is given.

Runs of `train game` play the two-agent game instead, once with each pair: a run's proposer with its own verifier, an
oracle and a verifier that looks at the target alone; its verifier also with an expert that tells the truth and one that
lies. With --protocol, single agents take both seats, and without runs scripted partners play each other.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from lilgym_mp.cli.options import (
    CONFIGURATIONS_HELP,
    CommandError,
    add_device,
    add_flag,
    add_number,
    add_out,
    add_seed,
    add_settings,
    add_split,
    argument_type,
    check_at_least,
    check_out,
    given_environment,
)
from lilgym_mp.corpus import NoTasksError, load_all_tasks
from lilgym_mp.corpus.records import SCRATCH
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.proposer_verifier.protocols import PROTOCOLS
from lilgym_mp.envs.proposer_verifier.settings import VIEWS_HELP, name_or_json
from lilgym_mp.envs.registration import CONFIGURATIONS
from lilgym_mp.evaluation.episodes import Episode
from lilgym_mp.evaluation.files import fresh_file, writable_directory, write_json
from lilgym_mp.evaluation.game_partners import MESSAGE_CHANGES
from lilgym_mp.evaluation.policies import (
    AS_TRAINED,
    BASELINES,
    BUILT_IN_POLICIES,
    GREEDY,
    SAMPLED,
    NamedPolicy,
    built_in_policy,
)
from lilgym_mp.evaluation.recording import Recorder, episodes_file
from lilgym_mp.evaluation.recording_metadata import write_metadata
from lilgym_mp.evaluation.report import results_json, results_text
from lilgym_mp.evaluation.results import EvaluationPlan, Result, play, playable, training_statements
from lilgym_mp.evaluation.terminal import Progress
from lilgym_mp.evaluation.terminal import table as text_table
from lilgym_mp.learning.common.learners import find_learner
from lilgym_mp.scene.choices import choose, listed
from lilgym_mp.scene.grouping import grouped

if TYPE_CHECKING:
    from lilgym_mp.learning.common.agents import Agent
    from lilgym_mp.learning.common.model_file import ModelDescription


SHOWN_TASKS = 5  # of those that the expert does not solve


def add_options(parser: ArgumentParser) -> None:
    """Adds the options of `lilgym-mp evaluate`."""
    parser.add_argument(
        "agents",
        nargs="*",
        type=Path,
        metavar="RUN",
        help="run directories written by `lilgym-mp train`, model files, names of shipped agents, such as "
        "parse-and-plan, or .zip files of Stable-Baselines3 models with a LilGymPolicy",
    )
    add_flag(parser, "--trust", "load .zip files without asking: they can run any code")
    parser.add_argument(
        "--policy",
        nargs="+",
        default=[],
        metavar="NAME",
        help=f"built-in policies: {', '.join(sorted(BUILT_IN_POLICIES))}",
    )
    parser.add_argument(
        "--configuration",
        nargs="+",
        metavar="NAME",
        help=f"any of {CONFIGURATIONS_HELP} (default: all that the agents can play)",
    )
    add_split(parser, "dev")
    add_seed(parser, "of the policies")
    add_number(parser, "--passes", 1, "episodes per task")
    parser.add_argument(
        "--actions",
        nargs="+",
        choices=[GREEDY, SAMPLED],
        help="take the most probable action, sample from the policy, or evaluate both (default: both for PPO agents, "
        "whose most probable first action may be STOP; greedy for others, but for imitation as its stop rule says)",
    )
    parser.add_argument("--name", metavar="NAME", help="name of the agent in reports (default: its learner)")
    parser.add_argument(
        "--record", type=Path, metavar="DIR", help="record every episode in DIR, for `report` and the /watch page"
    )
    add_flag(
        parser,
        "--judge-decisions",
        "with --record-decisions: ask the expert at each step whether the action taken begins a shortest solution"
        " (slow in Scatter)",
    )
    add_flag(
        parser,
        "--record-decisions",
        "with --record: also record the action probabilities, value estimate and legal actions at each step",
    )
    add_flag(parser, "--optimal", "with --record: also record the length of the expert's solution")
    add_out(parser, "write the results to FILE as JSON")
    add_flag(
        parser,
        "--parses",
        "instead of playing, compare the programs that parse-and-plan agents find with those of the corpus",
    )
    add_flag(parser, "--alone", "do not evaluate random policies for comparison")
    game = parser.add_argument_group("two-agent game")
    game.add_argument(
        "--protocol",
        nargs="+",
        choices=list(PROTOCOLS),
        help="play this game, with runs of single agents or scripted partners (default configuration: TowerFlipIt)",
    )
    game.add_argument(
        "--views",
        type=argument_type(name_or_json),
        metavar="VIEWS",
        help="what scripted partners of --protocol see; runs see what they learned with: " + VIEWS_HELP,
    )
    game.add_argument(
        "--messages", choices=MESSAGE_CHANGES, help="replace every message, by silence or at random, as a control"
    )
    add_flag(game, "--cross-play", "play every proposer with every verifier")
    add_device(parser)
    add_settings(parser)


def run(args: Namespace) -> int:
    """Evaluates agents and policies, prints a table, and writes what --out and --record name."""
    check_at_least(args, 0, "seed")
    check_at_least(args, 1, "passes", "threads")
    if args.record is None and (args.optimal or args.record_decisions):
        raise CommandError(f"{'--optimal' if args.optimal else '--record-decisions'} needs --record DIR")
    if args.judge_decisions and not args.record_decisions:
        raise CommandError("--judge-decisions needs --record-decisions")
    plays_game = bool(args.protocol or args.cross_play)
    if not (args.agents or args.policy or plays_game):
        raise CommandError("name run directories of trained agents, policies with --policy, or a game with --protocol")
    check_out(args)
    opened = {path: _opened(path, args) for path in args.agents}
    if args.parses:
        return _score_parses(args, opened)
    if plays_game or any(agent.game for agent in opened.values()):
        from lilgym_mp.cli.evaluate_game import evaluate_games

        return evaluate_games(args, opened)
    agents = [named for path, agent in opened.items() for named in agent_policies(path, agent, args)]
    policies = [built_in_policy(name) for name in args.policy] or (list(BASELINES) if agents and not args.alone else [])
    named = [*agents, *policies]
    plans = [
        EvaluationPlan(settings, args.split, args.seed, args.passes, record_decisions=args.record_decisions)
        for settings in _settings(args, agents)
    ]
    if args.record is not None:
        writable_directory(args.record)
        for plan, policy in product(plans, named):
            fresh_file(episodes_file(args.record, policy, plan.settings, plan.split, plan.seed), force=args.force)
    results: list[Result] = []
    with Progress(sum(plan.episodes * len(playable(named, plan)) for plan in plans), "episodes") as progress:
        for plan in plans:
            results += _played(named, plan, args, progress)
            print(f"{plan}: done", flush=True)
    print(f"\n{results_text(results)}")
    for line in unsolved_lines(results):
        print(line)
    if args.out is not None:
        data = results_json(results)
        for row, result in zip(data["results"], results, strict=True):
            row["items"] = [_item(episode) for episode in result.episodes]
        write_json(args.out, data)
        print(f"results: {args.out}")
    return 0


def _item(episode: Episode) -> dict[str, object]:
    """What an agent did in an episode, beside the task."""
    data = episode.to_json()
    names = ("task", "statement", "program", "target", "outcome", "invalid_reason", "actions")
    return {**{name: data[name] for name in names}, "reward": episode.reward}


def unsolved_lines(results: Sequence[Result]) -> Iterator[str]:
    """Why the expert fails, with the tasks: a line for each configuration and reason."""
    for result in results:
        settings = result.plan.settings
        tasks = settings.tasks(result.plan.split)
        failed = [episode.task for episode in result.episodes if not episode.is_success]
        if result.named != BUILT_IN_POLICIES["expert"] or not failed:
            continue
        from lilgym_mp.solver import Solver

        dynamics = settings.dynamics()
        solver = Solver(dynamics)
        solutions = ((solver.solve(tasks.by_id(name)), name) for name in dict.fromkeys(failed))
        reasons = grouped((solution.reason or str(solution.status), name) for solution, name in solutions)
        for reason, names in reasons.items():
            shown = listed(names[:SHOWN_TASKS])
            yield f"expert, {settings.configuration}: {len(names)} tasks failed: {reason} ({shown})"


def _score_parses(args: Namespace, agents: Mapping[Path, Agent]) -> int:
    """Prints the accuracy of the agents' parsers on the split's statements, in percent."""
    from lilgym_mp.learning.parsing.agent import ParseAndPlanAgent
    from lilgym_mp.learning.parsing.scoring import ParseItem, ParseScore, parse_scores

    if not agents or args.policy or args.record is not None or args.configuration:
        raise CommandError("--parses needs agents, and neither --policy, --record nor --configuration")
    corpus = given_environment(args).get("corpus", "builtin")
    found: dict[str, list[ParseScore]] = {}
    items: dict[str, list[ParseItem]] = {}
    for run, agent in agents.items():
        if not isinstance(agent, ParseAndPlanAgent):
            raise CommandError(f"{run} is of kind {agent.description.kind}, which has no parser")
        sets = load_all_tasks(corpus, starts=[SCRATCH], splits=[args.split])
        count = sum(len({(task.statement, task.program) for task in tasks}) for tasks in sets)
        with Progress(count, "statements") as progress:
            parsed = items[str(run)] = list[ParseItem]()

            def on_item(item: ParseItem, parsed: list[ParseItem] = parsed, progress: Progress = progress) -> None:
                parsed.append(item)
                progress.advance()

            trained_on = agent.description.recipe.get("corpus")
            found[str(run)] = list(parse_scores(agent.parser, corpus, args.split, on_item, trained_on))
    rows = [[run, *score[:3], *(100 * share for share in score[3:])] for run in found for score in found[run]]
    print(f"parsers on corpus {corpus}, split {args.split}, in percent of statements")
    print(text_table(["agent", *(name.replace("_", " ") for name in ParseScore._fields)], rows))
    if args.out is not None:
        written = {
            run: {"totals": [score._asdict() for score in found[run]], "items": [item._asdict() for item in items[run]]}
            for run in found
        }
        write_json(args.out, written)
        print(f"results: {args.out}")
    return 0


def _played(
    named: Sequence[NamedPolicy], plan: EvaluationPlan, args: Namespace, progress: Progress
) -> Iterator[Result]:
    """The policies' results, each recorded with --record as soon as it is there."""
    judging = {"with_expert": args.optimal, "judges_decisions": args.judge_decisions}
    recorder = None if args.record is None else Recorder(plan.settings, plan.split, (), **judging)
    for policy in playable(named, plan):
        seen = training_statements(plan.settings, policy)
        result = play(policy, plan, seen, lambda episode: progress.advance())
        if recorder is not None and args.record is not None:
            path = recorder.write(args.record, result, seen)
            write_metadata(path, args.argv)
            print(f"episodes: {path}", flush=True)
        yield result


def agent_policies(path: Path, agent: Agent, args: Namespace) -> list[NamedPolicy]:
    """The agent saved at `path`, once for each action mode to evaluate."""
    description = agent.description
    action_modes = args.actions or find_learner(description.kind).action_modes
    own = AS_TRAINED if agent.chooses_actions else GREEDY
    recorded = {mode: own if mode == GREEDY else mode for mode in action_modes}
    common = {
        "kind": description.kind,
        "run": str(path),
        "recipe": dict(description.recipe),
        "label": args.name or description.kind,
        "training_seed": description.recipe.get("seed", description.details.get("seed")),
        "training": training_facts(description),
    }
    name = description.kind if description.kind == str(path) else f"{description.kind} ({path})"
    return [
        NamedPolicy(
            f"{name}, {recorded[mode]}" if len(action_modes) > 1 else name,
            partial(agent.policy, sampled=mode == SAMPLED),
            description.supervision,
            description.configurations,
            details={**common, "actions": recorded[mode]},
        )
        for mode in action_modes
    ]


def _opened(path: Path, args: Namespace) -> Agent:
    import torch

    from lilgym_mp.learning.common.agents import agent_file, open_agent

    torch.set_num_threads(args.threads)
    if path.suffix != ".zip":
        return open_agent(path, args.device)
    agent_file(path)
    warning = f"{path} contains pickles: loading it can run any code that its author put there"
    asks = not args.trust and sys.stdin.isatty()
    if not args.trust and not (asks and input(f"{warning}. Load it? [y/N] ").strip().lower() in ("y", "yes")):
        raise CommandError(f"{warning}; if you trust it, add --trust")
    from lilgym_mp.sb3.policy import load_agent

    return load_agent(path)


def training_facts(description: ModelDescription) -> dict[str, float]:
    """The steps and CPU minutes of an agent's training, as far as its description has them."""
    details = description.details
    facts = {name: details[name] for name in ("steps", "cpu_minutes") if details.get(name) is not None}
    if "cpu_seconds" in details:
        facts["cpu_minutes"] = round(details["cpu_seconds"] / 60, 2)
    return facts


def _settings(args: Namespace, agents: Sequence[NamedPolicy]) -> list[EnvConfig]:
    """The environments to evaluate in, in the order of CONFIGURATIONS unless named."""
    requested: Sequence[str] = args.configuration or ()
    supported = {name for agent in agents for name in agent.configurations} if agents else set(CONFIGURATIONS)
    for name in requested:
        choose("configuration", name, CONFIGURATIONS)
        for agent in agents:
            if name not in agent.configurations:
                raise CommandError(f"{agent.name} does not play {name}; it plays {', '.join(agent.configurations)}")
    environment = given_environment(args)
    chosen = [EnvConfig(name, **environment) for name in requested or CONFIGURATIONS if name in supported]
    with_tasks: list[EnvConfig] = []
    missing: list[NoTasksError] = []  # say what there is instead
    for settings in chosen:
        try:
            settings.make(args.split)
            with_tasks.append(settings)
        except NoTasksError as error:
            missing.append(error)
    if missing and (requested or not with_tasks):
        raise missing[0]
    return with_tasks
