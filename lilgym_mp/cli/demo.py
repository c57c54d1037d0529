"""`lilgym-mp demo`: trains two agents side by side, and shows what they do beside simpler play and the expert."""

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
from typing import NamedTuple

from lilgym_mp.cli.errors import CommandError
from lilgym_mp.evaluation.comparison import EvaluationPlan, Result, play_all, training_statements
from lilgym_mp.evaluation.files import OutputError, writable_directory, write_json, write_text
from lilgym_mp.evaluation.film import film_grid
from lilgym_mp.evaluation.named_policies import NamedPolicy, built_in
from lilgym_mp.evaluation.report import LEGEND, results_json, supervision_table, table
from lilgym_mp.evaluation.runs import Episode
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.terminal import Progress

CONFIGURATION = "TowerScratch"
SPLIT = "dev"
PARSER_STEPS = 1_900
IMITATION_MINUTES = 1.5  # of processor time
FILMED = 6  # episodes of each agent, two a row
PLACE = Path("runs") / "demo"
POLL_SECONDS = 0.2
PARSE_AND_PLAN, IMITATION = "parse and plan", "imitation"


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser(
        "demo",
        help="train two agents in about three minutes, and see what they do",
        description=f"Trains an agent that parses and plans, and a network by imitation of the expert, on the builtin "
        f"corpus; evaluates both on {SPLIT} of {CONFIGURATION} beside an untrained network, random play and the "
        "expert; and films them.",
    )
    parser.add_argument(
        "--parser-steps", type=int, default=PARSER_STEPS, metavar="N", help="of the parser (default: %(default)s)"
    )
    parser.add_argument(
        "--minutes",
        type=float,
        default=IMITATION_MINUTES,
        metavar="N",
        help="of processor time for the network (default: %(default)s)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of everything (default: 0)")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help=f"empty or new directory (default: {PLACE}, {PLACE}-2, ...)"
    )
    parser.set_defaults(run=run)


class Learner(NamedTuple):
    """A training that runs in a process of its own."""

    name: str
    place: Path
    command: Sequence[str]
    share: Callable[[dict[str, float]], float]  # of the training that is done, by its last line of progress
    told: Callable[[dict[str, float]], str]  # that line, for people


def run(args: argparse.Namespace) -> int:
    if args.parser_steps < 1 or args.minutes <= 0 or args.seed < 0:
        raise CommandError("--parser-steps must be at least 1, --minutes above 0, --seed at least 0")
    place = writable_directory(_empty(args.out) if args.out else next_free(PLACE))
    settings = Settings(CONFIGURATION)
    print(
        f"training two agents side by side on the builtin corpus ({len(settings.make('train').tasks):,} statements of"
        f" {CONFIGURATION} among them); {SPLIT}'s statements are none of those that they learn from"
    )
    learners = _learners(args, place)
    with _started(learners) as processes, Progress(100, "% of the slower training") as progress:
        _wait(learners, processes, progress)
    plan = EvaluationPlan(settings, SPLIT, args.seed)
    named = _named_policies(args, place)
    with Progress(plan.episodes * len(named), "episodes") as progress:
        results = list(play_all(named, plan, training_statements(settings), lambda episode: progress.advance()))
    _report(place, plan, results)
    return 0


def _learners(args: argparse.Namespace, place: Path) -> list[Learner]:
    seed = str(args.seed)
    parsing = ["parse-and-plan", "--steps", str(args.parser_steps), "--seed", seed]
    parsing += ["--generated", "0.6", "--generated-pairs", "12000", "--held-out", "40", "--dropout", "0.1"]
    imitating = ["imitation", CONFIGURATION, "--minutes", str(args.minutes), "--seed", seed]
    imitating += ["--pretraining", "0"]  # in so short a run it takes more time than it saves
    return [
        Learner(
            PARSE_AND_PLAN,
            place / "parse-and-plan",
            parsing,
            lambda line: line["step"] / line["steps"],
            lambda line: f"{line['step']:.0f} of {line['steps']:.0f} steps, loss {line['loss']:.2f}",
        ),
        Learner(
            IMITATION,
            place / "imitation",
            imitating,
            lambda line: line["cpu_seconds"] / (60 * args.minutes),
            lambda line: f"{line['cpu_seconds']:.0f} of {60 * args.minutes:.0f} CPU seconds",
        ),
    ]


@contextmanager
def _started(learners: Sequence[Learner]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """A process for each learner; none is left running."""
    processes: list[subprocess.Popen[bytes]] = []
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    try:
        for learner in learners:
            command = [sys.executable, "-m", "lilgym_mp", "train", *learner.command, "--out", str(learner.place)]
            with learner.place.with_suffix(".log").open("wb") as log:
                processes.append(subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, env=environment))
        yield processes
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def _wait(learners: Sequence[Learner], processes: Sequence[subprocess.Popen[bytes]], progress: Progress) -> None:
    """Until all have ended, showing how they stand. Raises CommandError when one fails."""
    while any(process.poll() is None for process in processes):
        time.sleep(POLL_SECONDS)
        standings = [_standing(learner) for learner in learners]
        note = "; ".join(f"{learner.name}: {told}" for learner, (_, told) in zip(learners, standings, strict=True))
        progress.reach(int(100 * min(share for share, _ in standings)), note)
        for learner, process in zip(learners, processes, strict=True):
            if process.poll():
                log = learner.place.with_suffix(".log")
                lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
                raise CommandError(f"training {learner.name} failed: {lines[-1] if lines else ''} (see {log})")


def _standing(learner: Learner) -> tuple[float, str]:
    """The share of a training that is done, and the same for people."""
    try:
        lines = (learner.place / "progress.jsonl").read_text(encoding="utf-8").splitlines()
        line = json.loads(lines[-1])
    except (OSError, ValueError, IndexError):
        return 0.0, "getting ready"
    return min(1.0, learner.share(line)), learner.told(line)


def _named_policies(args: argparse.Namespace, place: Path) -> list[NamedPolicy]:
    import torch

    from lilgym_mp.learning.agents import open_agent
    from lilgym_mp.learning.imitation.agent import ImitationAgent

    torch.set_num_threads(1)
    trained: list[NamedPolicy] = []
    for name in (IMITATION, PARSE_AND_PLAN):
        agent = open_agent(place / name.replace(" ", "-"), "cpu")
        details = {"run": name.replace(" ", "-"), "recipe": dict(agent.description.recipe)}
        trained.append(NamedPolicy(name, agent.policy, agent.description.supervision, details=details))
        if isinstance(agent, ImitationAgent):
            torch.manual_seed(args.seed)
            fresh = ImitationAgent(agent.shape.network().eval(), agent.shape, agent.rules, agent.description)
            trained.insert(0, NamedPolicy("untrained network", fresh.policy))
    return [built_in("random-type"), built_in("random-legal"), *trained, built_in("expert")]


def _report(place: Path, plan: EvaluationPlan, results: Sequence[Result]) -> None:
    """Writes and shows the results."""
    explanation = _explanation(place, plan.settings)
    summary = "\n\n".join([str(plan), table(results), supervision_table(results), LEGEND])
    write_json(place / "results.json", results_json(results, with_episodes=True))
    write_text(place / "results.md", f"{summary}\n")
    write_text(place / "explanation.txt", f"{explanation}\n")
    films = [place / f"{name.replace(' ', '-')}.gif" for name in (IMITATION, PARSE_AND_PLAN)]
    for film, name in zip(films, (IMITATION, PARSE_AND_PLAN), strict=True):
        (result,) = (result for result in results if result.name == name)
        film_grid(film, plan.settings, plan.split, _to_film(result.episodes), columns=2)
    print(
        f"\n{summary}\n\n{explanation}\n\n"
        f"results: {place / 'results.md'}, {place / 'results.json'}\n"
        f"films:   {', '.join(map(str, films))}\n"
        f"agents:  {place / 'parse-and-plan'}, {place / 'imitation'}; evaluate them elsewhere with, for example:\n"
        f"         lilgym-mp evaluate {place / 'parse-and-plan'} --configuration ScatterFlipIt --split test"
    )


def _explanation(place: Path, settings: Settings) -> str:
    """What the agent that parses and plans makes of one of the split's longer statements."""
    from lilgym_mp.learning.agents import open_agent
    from lilgym_mp.learning.parsing.agent import ParseAndPlanAgent
    from lilgym_mp.learning.parsing.explanation import explanation_lines

    agent = open_agent(place / "parse-and-plan", "cpu")
    assert isinstance(agent, ParseAndPlanAgent)
    planner = agent.planner(settings)
    tasks = sorted(settings.make(SPLIT).tasks, key=lambda task: (len(task.statement), task.id))
    task = tasks[len(tasks) * 3 // 4]
    plan = planner.plan(task.start, task.statement, task.target)
    lines = explanation_lines(plan, planner, task.statement, task.target)
    return "\n".join([f"lilgym-mp explain --task {task.id} --agent {place / 'parse-and-plan'}", "", *lines])


def _to_film(episodes: Sequence[Episode]) -> list[Episode]:
    """Episodes from all over the split, whether they succeed or not."""
    return list(episodes[:: max(1, len(episodes) // FILMED)][:FILMED])


def _empty(path: Path) -> Path:
    if path.is_dir() and any(path.iterdir()):
        raise OutputError(f"{path} is not empty; name an empty or new directory")
    return path


def next_free(path: Path) -> Path:
    """`path`, or the first of path-2, path-3, ... that is not there."""
    numbered = (path if number == 1 else path.with_name(f"{path.name}-{number}") for number in count(1))
    return next(candidate for candidate in numbered if not candidate.exists())
