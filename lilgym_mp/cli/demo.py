"""Train two agents in about three minutes, and see what they do.

Trains a parse-and-plan agent and an imitation agent on the builtin corpus, evaluates both on dev of TowerScratch,
compares them with an untrained network, random policies and the expert, and writes films of their episodes.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from lilgym_mp.cli.experiment_plan import PlannedRun
from lilgym_mp.cli.experiment_runs import RUNS, RunStatus, make_attempts, run_locally
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import options
from lilgym_mp.evaluation.files import OutputError, first_free_path, writable_directory, write_json, write_text
from lilgym_mp.evaluation.film import film_grid
from lilgym_mp.evaluation.options import CommandError, add_number, add_seed, check_at_least
from lilgym_mp.evaluation.policies import NamedPolicy, built_in_policy
from lilgym_mp.evaluation.report import results_json, results_text
from lilgym_mp.evaluation.runs import EvaluationPlan, Result, play_all, training_statements
from lilgym_mp.evaluation.terminal import Progress

CONFIGURATION = "TowerScratch"
SPLIT = "dev"
FILMED = 6  # episodes of each agent, in two columns
DIRECTORY = options.RUNS / "demo"
PARSE_AND_PLAN, IMITATION = "parse-and-plan", "imitation"


def add_options(parser: argparse.ArgumentParser) -> None:
    add_number(parser, "--parser-updates", 1_900, "updates of the parser")
    add_number(parser, "--imitation-updates", 700, "updates of the imitation agent")
    add_seed(parser, "of training and evaluation")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help=f"empty or new directory (default: {DIRECTORY}, {DIRECTORY}-2, ...)"
    )


def run(args: argparse.Namespace) -> int:
    check_at_least(args, 1, "parser_updates", "imitation_updates")
    check_at_least(args, 0, "seed")
    if args.out is not None and args.out.is_dir() and any(args.out.iterdir()):
        raise OutputError(f"{args.out} is not empty; name an empty or new directory")
    directory = writable_directory(args.out or first_free_path(DIRECTORY))
    settings = EnvConfig(CONFIGURATION)
    print(
        f"training two agents in parallel on the builtin corpus ({len(settings.make('train').tasks):,} statements for"
        f" {CONFIGURATION}); no statement of {SPLIT} is in the training data"
    )
    _train(args, directory)
    plan = EvaluationPlan(settings, SPLIT, args.seed)
    named = _named_policies(directory, args.seed)
    with Progress(plan.episodes * len(named), "episodes") as progress:
        results = list(play_all(named, plan, training_statements(settings), lambda episode: progress.advance()))
    _report(directory, plan, results)
    return 0


def _train(args: argparse.Namespace, directory: Path) -> None:
    """Trains both agents, each in its own process. Raises CommandError if one fails."""
    seed = str(args.seed)
    parsing = ["parse-and-plan", "--updates", str(args.parser_updates), "--seed", seed]
    parsing += ["--generated", "0.6", "--generated-pairs", "12000", "--held-out", "40", "--dropout", "0.1"]
    imitating = ["imitation", CONFIGURATION, "--updates", str(args.imitation_updates), "--seed", seed]
    imitating += ["--pretraining", "0"]  # not worthwhile in such a short run
    plan = [
        PlannedRun(PARSE_AND_PLAN, ("train", *parsing), (), ("updates", args.parser_updates)),
        PlannedRun(IMITATION, ("train", *imitating), (), ("updates", args.imitation_updates)),
    ]
    attempts = make_attempts(plan, directory, threads=1)
    with Progress(100, "% of the slower training") as progress:

        def show() -> None:
            left = [attempt.fraction_done or 0.0 for attempt in attempts if attempt.status is not RunStatus.FINISHED]
            progress.reach(int(100 * min(left, default=1.0)))

        run_locally(attempts, len(attempts), show, poll_seconds=0.2)
    for attempt in attempts:
        if attempt.status is not RunStatus.FINISHED:
            raise CommandError(f"training {attempt.planned.name} failed: {attempt.error} (see {attempt.log})")


def _named_policies(directory: Path, seed: int) -> list[NamedPolicy]:
    import torch

    from lilgym_mp.learning.common.agents import open_agent
    from lilgym_mp.learning.imitation.agent import ImitationAgent, make_network

    torch.set_num_threads(1)
    trained: list[NamedPolicy] = []
    for name in (IMITATION, PARSE_AND_PLAN):
        agent = open_agent(directory / RUNS / name, "cpu")
        details = {"run": f"{RUNS}/{name}", "recipe": dict(agent.description.recipe)}
        trained.append(NamedPolicy(name, agent.policy, agent.description.supervision, details=details))
        if isinstance(agent, ImitationAgent):
            torch.manual_seed(seed)
            fresh = replace(agent, network=make_network(agent.description.details["network"]).eval())
            trained.insert(0, NamedPolicy("untrained network", fresh.policy))
    return [built_in_policy("random-type"), built_in_policy("random-legal"), *trained, built_in_policy("expert")]


def _report(directory: Path, plan: EvaluationPlan, results: Sequence[Result]) -> None:
    """Writes and prints the results."""
    parser = directory / RUNS / PARSE_AND_PLAN
    write_json(directory / "results.json", results_json(results, with_episodes=True))
    text = f"{plan}\n\n{results_text(results)}"
    write_text(directory / "results.txt", f"{text}\n")
    films = {name: directory / f"{name}.gif" for name in (IMITATION, PARSE_AND_PLAN)}
    for name, film in films.items():
        (result,) = (result for result in results if result.name == name)
        evenly_spaced = result.episodes[:: max(1, len(result.episodes) // FILMED)][:FILMED]
        film_grid(film, plan.settings, plan.split, evenly_spaced, columns=2)
    print(
        f"\n{text}\n\n"
        f"results: {directory / 'results.txt'}, {directory / 'results.json'}\n"
        f"films:   {', '.join(map(str, films.values()))}\n"
        f"agents:  {parser}, {directory / RUNS / IMITATION}; evaluate and explain them on other tasks, such as:\n"
        f"         lilgym-mp evaluate {parser} --configuration ScatterFlipIt --split test\n"
        f"         lilgym-mp explain 'There is a blue block.' --agent {parser}"
    )
