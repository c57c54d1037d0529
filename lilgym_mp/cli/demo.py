"""Train two agents in about three minutes, and see what they do.

Trains a parse-and-plan agent and an imitation agent on the builtin corpus, evaluates both on dev of TowerScratch,
compares them with random policies and the expert, and writes films of their episodes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from lilgym_mp.cli.experiment_plan import PlannedRun
from lilgym_mp.cli.experiment_runs import EPISODES, RUNS, RunStatus, execute, make_attempts
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import options
from lilgym_mp.evaluation.episode_files import read_episodes
from lilgym_mp.evaluation.files import SUFFIX, OutputError, first_free_path, writable_directory
from lilgym_mp.evaluation.film import episode_frames, film_frames
from lilgym_mp.evaluation.options import CommandError, add_number, add_seed, check_at_least
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
    _evaluate(args, directory)
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

        execute(attempts, len(attempts), show, poll_seconds=0.2)
    for attempt in attempts:
        if attempt.status is not RunStatus.FINISHED:
            raise CommandError(f"training {attempt.planned.name} failed: {attempt.error} (see {attempt.log})")


def _evaluate(args: argparse.Namespace, directory: Path) -> None:
    """Plays dev with all policies, prints and records the results, and films the agents."""
    from lilgym_mp.cli import parse_args

    agents = {name: directory / RUNS / name for name in (PARSE_AND_PLAN, IMITATION)}
    place = ["--record", str(directory / EPISODES), "--out", str(directory / "results.json")]
    words = ["--policy", "random-type", "random-legal", "expert", "--configuration", CONFIGURATION, "--split", SPLIT]
    evaluation = parse_args(["evaluate", *map(str, agents.values()), *words, *place, "--seed", str(args.seed)])
    evaluation.run(evaluation)
    recordings = [read_episodes(file) for file in (directory / EPISODES).glob(f"*{SUFFIX}")]
    env = EnvConfig(CONFIGURATION).make(SPLIT)
    for name, run in agents.items():
        (recording,) = (each for each in recordings if each.header.run == str(run))
        evenly_spaced = recording.episodes[:: max(1, len(recording.episodes) // FILMED)][:FILMED]
        film = directory / f"{name}.gif"
        film_frames(film, [list(episode_frames(env, episode)) for episode in evenly_spaced], columns=2)
        print(f"film: {film}")
    parser = agents[PARSE_AND_PLAN]
    print(
        "evaluate and explain the agents on other tasks, such as:\n"
        f"  lilgym-mp evaluate {parser} --configuration ScatterFlipIt --split test\n"
        f"  lilgym-mp explain 'There is a blue block.' --agent {parser}"
    )
