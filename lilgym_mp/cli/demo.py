"""`lilgym-mp demo`: trains two agents in parallel, and compares them with baselines and the expert."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from shutil import get_terminal_size
from typing import NamedTuple

from lilgym_mp.evaluation.comparison import EvaluationPlan, Result, play_all, training_statements
from lilgym_mp.evaluation.files import OutputError, writable_directory, write_json, write_text
from lilgym_mp.evaluation.film import film_grid
from lilgym_mp.evaluation.named_policies import NamedPolicy, built_in_policy
from lilgym_mp.evaluation.report import legend, results_json, supervision_table, table, terminal_tables
from lilgym_mp.evaluation.runs import Episode
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.options import RUNS, CommandError, add_seed, check_at_least
from lilgym_mp.terminal import Progress

CONFIGURATION = "TowerScratch"
SPLIT = "dev"
PARSER_STEPS = 1_900
IMITATION_MINUTES = 1.5  # CPU time
FILMED = 6  # episodes of each agent, in two columns
DIRECTORY = RUNS / "demo"
POLL_SECONDS = 0.2
PARSE_AND_PLAN, IMITATION = "parse and plan", "imitation"


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser(
        "demo",
        help="train two agents in about three minutes, and see what they do",
        description="Trains a parse-and-plan agent and an imitation agent on the builtin corpus, evaluates both on "
        f"{SPLIT} of {CONFIGURATION}, compares them with an untrained network, random policies and the expert, and "
        "writes films of their episodes.",
    )
    parser.add_argument(
        "--parser-steps",
        type=int,
        default=PARSER_STEPS,
        metavar="N",
        help="training steps of the parser (default: %(default)s)",
    )
    parser.add_argument(
        "--minutes",
        type=float,
        default=IMITATION_MINUTES,
        metavar="N",
        help="CPU time for the imitation agent (default: %(default)s)",
    )
    add_seed(parser, "of training and evaluation")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help=f"empty or new directory (default: {DIRECTORY}, {DIRECTORY}-2, ...)"
    )
    parser.set_defaults(run=run)


class TrainingJob(NamedTuple):
    """A training run in its own process."""

    name: str
    directory: Path
    command: Sequence[str]
    fraction_done: Callable[[dict[str, float]], float]  # computed from the last line of its progress file
    note: Callable[[dict[str, float]], str]  # a summary of that line


def run(args: argparse.Namespace) -> int:
    check_at_least(args, 1, "parser_steps")
    check_at_least(args, 0, "seed")
    if args.minutes <= 0:
        raise CommandError(f"--minutes must be above 0, not {args.minutes:g}")
    directory = writable_directory(_empty(args.out) if args.out else first_free_path(DIRECTORY))
    settings = Settings(CONFIGURATION)
    print(
        f"training two agents in parallel on the builtin corpus ({len(settings.make('train').tasks):,} statements for"
        f" {CONFIGURATION}); no statement of {SPLIT} is in the training data"
    )
    jobs = _training_jobs(args, directory)
    with _started(jobs) as processes, Progress(100, "% of the slower training") as progress:
        _wait(jobs, processes, progress)
    plan = EvaluationPlan(settings, SPLIT, args.seed)
    named = _named_policies(args, directory)
    with Progress(plan.episodes * len(named), "episodes") as progress:
        results = list(play_all(named, plan, training_statements(settings), lambda episode: progress.advance()))
    _report(directory, plan, results)
    return 0


def _training_jobs(args: argparse.Namespace, directory: Path) -> list[TrainingJob]:
    seed = str(args.seed)
    parsing = ["parse-and-plan", "--steps", str(args.parser_steps), "--seed", seed]
    parsing += ["--generated", "0.6", "--generated-pairs", "12000", "--held-out", "40", "--dropout", "0.1"]
    imitating = ["imitation", CONFIGURATION, "--minutes", str(args.minutes), "--seed", seed]
    imitating += ["--pretraining", "0"]  # not worthwhile in such a short run
    return [
        TrainingJob(
            PARSE_AND_PLAN,
            directory / "parse-and-plan",
            parsing,
            lambda line: line["step"] / line["steps"],
            lambda line: f"{line['step']:.0f} of {line['steps']:.0f} steps, loss {line['loss']:.2f}",
        ),
        TrainingJob(
            IMITATION,
            directory / "imitation",
            imitating,
            lambda line: line["cpu_seconds"] / (60 * args.minutes),
            lambda line: f"{line['cpu_seconds']:.0f} of {60 * args.minutes:.0f} CPU seconds",
        ),
    ]


@contextmanager
def _started(jobs: Sequence[TrainingJob]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """One process per job, all terminated on exit."""
    processes: list[subprocess.Popen[bytes]] = []
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    try:
        for job in jobs:
            command = [sys.executable, "-m", "lilgym_mp", "train", *job.command, "--out", str(job.directory)]
            with job.directory.with_suffix(".log").open("wb") as log:
                processes.append(subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, env=environment))
        yield processes
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def _wait(jobs: Sequence[TrainingJob], processes: Sequence[subprocess.Popen[bytes]], progress: Progress) -> None:
    """Waits for all processes, showing their progress. Raises CommandError when one fails."""
    while any(process.poll() is None for process in processes):
        time.sleep(POLL_SECONDS)
        current = [_progress_of(job) for job in jobs]
        note = "; ".join(f"{job.name}: {note}" for job, (_, note) in zip(jobs, current, strict=True))
        progress.reach(int(100 * min(fraction for fraction, _ in current)), note)
        for job, process in zip(jobs, processes, strict=True):
            if process.poll():
                log = job.directory.with_suffix(".log")
                lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
                raise CommandError(f"training {job.name} failed: {lines[-1] if lines else ''} (see {log})")


def _progress_of(job: TrainingJob) -> tuple[float, str]:
    """The fraction of the training that is done, and a note about it."""
    try:
        lines = (job.directory / "progress.jsonl").read_text(encoding="utf-8").splitlines()
        line = json.loads(lines[-1])
    except (OSError, ValueError, IndexError):
        return 0.0, "starting"
    return min(1.0, job.fraction_done(line)), job.note(line)


def _named_policies(args: argparse.Namespace, directory: Path) -> list[NamedPolicy]:
    import torch

    from lilgym_mp.learning.agents import open_agent
    from lilgym_mp.learning.imitation.agent import ImitationAgent

    torch.set_num_threads(1)
    trained: list[NamedPolicy] = []
    for name in (IMITATION, PARSE_AND_PLAN):
        agent = open_agent(directory / name.replace(" ", "-"), "cpu")
        details = {"run": name.replace(" ", "-"), "recipe": dict(agent.description.recipe)}
        trained.append(NamedPolicy(name, agent.policy, agent.description.supervision, details=details))
        if isinstance(agent, ImitationAgent):
            torch.manual_seed(args.seed)
            fresh = ImitationAgent(
                agent.architecture.network().eval(), agent.architecture, agent.rules, agent.description
            )
            trained.insert(0, NamedPolicy("untrained network", fresh.policy))
    return [built_in_policy("random-type"), built_in_policy("random-legal"), *trained, built_in_policy("expert")]


def _report(directory: Path, plan: EvaluationPlan, results: Sequence[Result]) -> None:
    """Writes and prints the results."""
    explanation = _explanation(directory, plan.settings)
    summary = "\n\n".join([str(plan), table(results), supervision_table(results), legend(results)])
    write_json(directory / "results.json", results_json(results, with_episodes=True))
    write_text(directory / "results.md", f"{summary}\n")
    write_text(directory / "explanation.txt", f"{explanation}\n")
    films = [directory / f"{name.replace(' ', '-')}.gif" for name in (IMITATION, PARSE_AND_PLAN)]
    for film, name in zip(films, (IMITATION, PARSE_AND_PLAN), strict=True):
        (result,) = (result for result in results if result.name == name)
        film_grid(film, plan.settings, plan.split, _to_film(result.episodes), columns=2)
    if sys.stdout.isatty():
        summary = f"{plan}\n\n{terminal_tables(results, get_terminal_size().columns)}"
    print(
        f"\n{summary}\n\n{explanation}\n\n"
        f"results: {directory / 'results.md'}, {directory / 'results.json'}\n"
        f"films:   {', '.join(map(str, films))}\n"
        f"agents:  {directory / 'parse-and-plan'}, {directory / 'imitation'}; evaluate them on other tasks, such as:\n"
        f"         lilgym-mp evaluate {directory / 'parse-and-plan'} --configuration ScatterFlipIt --split test"
    )


def _explanation(directory: Path, settings: Settings) -> str:
    """The parse-and-plan agent's parse and plan of one of the split's longer statements."""
    from lilgym_mp.learning.agents import open_agent
    from lilgym_mp.learning.parsing.agent import ParseAndPlanAgent
    from lilgym_mp.learning.parsing.explanation import explanation_lines

    agent = open_agent(directory / "parse-and-plan", "cpu")
    assert isinstance(agent, ParseAndPlanAgent)
    planner = agent.planner(settings)
    tasks = sorted(settings.make(SPLIT).tasks, key=lambda task: (len(task.statement), task.id))
    task = tasks[len(tasks) * 3 // 4]
    plan = planner.plan(task.start, task.statement, task.target)
    lines = explanation_lines(plan, planner, task.statement, task.target)
    return "\n".join([f"lilgym-mp explain --task {task.id} --agent {directory / 'parse-and-plan'}", "", *lines])


def _to_film(episodes: Sequence[Episode]) -> list[Episode]:
    """Evenly spaced episodes of the split, whatever their outcome."""
    return list(episodes[:: max(1, len(episodes) // FILMED)][:FILMED])


def _empty(path: Path) -> Path:
    if path.is_dir() and any(path.iterdir()):
        raise OutputError(f"{path} is not empty; name an empty or new directory")
    return path


def first_free_path(path: Path) -> Path:
    """`path`, or the first of path-2, path-3, ... that does not exist."""
    numbered = (path if number == 1 else path.with_name(f"{path.name}-{number}") for number in count(1))
    return next(candidate for candidate in numbered if not candidate.exists())
