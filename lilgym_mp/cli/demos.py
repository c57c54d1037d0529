"""Write demonstrations of the expert, as npz or Minari dataset.

Writes a shortest solution of each task, with its statement, program and target. Equal settings and seeds give equal
files.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium as gym

from lilgym_mp import __version__
from lilgym_mp.cli.solve import add_solving, solve_shown
from lilgym_mp.corpus import NoTasksError, load_tasks
from lilgym_mp.corpus.extras import install
from lilgym_mp.envs.observation import ARRAYS, TEXT, item_capacity
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.files import fresh_file, write_atomically
from lilgym_mp.evaluation.options import (
    CommandError,
    add_configuration,
    add_number,
    add_seed,
    add_settings,
    add_split,
    check_at_least,
    given_settings,
)
from lilgym_mp.programs.task import Task
from lilgym_mp.solver.action_sets import explore, write_action_sets
from lilgym_mp.solver.demonstrations import Demonstration, arrays, demonstrations, drawn_tasks, write_npz
from lilgym_mp.wrappers import StructuredObservation

STRUCTURED = "structured"
OBSERVATIONS = (TEXT, ARRAYS, STRUCTURED)
EVALUATION_SPLIT = "dev"  # of the environment for evaluation that a Minari dataset names


def add_options(parser: argparse.ArgumentParser) -> None:
    add_configuration(parser)
    add_split(parser, "train")
    parser.add_argument("--out", type=Path, metavar="FILE", help="npz file to write; docs/solver.md lists its arrays")
    parser.add_argument("--force", action="store_true", help="overwrite the file named by --out")
    parser.add_argument("--minari", metavar="NAME", help='Minari dataset to write, such as "lilgym/tower-expert-v0"')
    parser.add_argument(
        "--observation",
        choices=list(OBSERVATIONS),
        default=TEXT,
        help="with --minari: statements as text, as arrays, or structured: as arrays, with items instead of images "
        "(default: %(default)s)",
    )
    parser.add_argument("--episodes", type=int, metavar="N", help="sample N tasks (default: each task once)")
    add_seed(parser, "of the sampling")
    parser.add_argument("--images", action="store_true", help="include images in the npz file (large)")
    parser.add_argument("--sets", action="store_true", help="write states with their sets of optimal actions instead")
    add_number(parser, "--exploration", 0.25, "with --sets: probability of a random edit")
    add_number(parser, "--repeats", 1, "with --sets: episodes from each start scene")
    add_solving(parser)
    add_settings(parser)


def run(args: argparse.Namespace) -> int:
    _check(args)
    settings = Settings(**given_settings(args))
    dynamics = settings.dynamics()
    if args.sets:
        return _run_sets(settings, args)
    tasks: Sequence[Task] = load_tasks(settings.corpus, settings.appearance, settings.start, args.split)
    if args.episodes is not None:
        tasks = drawn_tasks(tasks, args.episodes, args.seed)
    distinct = list({task.id: task for task in tasks}.values())
    solved = {report.task.id: report for report in solve_shown(distinct, settings, args.split, args)}
    reports = [solved[task.id] for task in tasks]
    episodes = demonstrations(reports, dynamics)
    unsolved = sum(not report.solution.solved for report in reports)
    print(f"{len(episodes):,} demonstrations of {len(reports):,} tasks, {unsolved:,} of them without a solution")
    if args.out is not None:
        data, metadata = arrays(episodes, dynamics, images=args.images), _metadata(settings, args)
        write_atomically(args.out, lambda path: write_npz(path, data, metadata))
        print(f"npz: {args.out}")
    if args.minari is not None:
        _write_minari(episodes, settings, args)
        print(f"Minari: {args.minari}")
    return 0


def _run_sets(settings: Settings, args: argparse.Namespace) -> int:
    dynamics = settings.dynamics()
    tasks = load_tasks(settings.corpus, settings.appearance, settings.start, args.split)
    exploration = {"exploration": args.exploration, "repeats": args.repeats, "seed": args.seed}
    states = explore(list(tasks), dynamics, jobs=args.jobs, budget=args.budget, **exploration)
    complete = sum(found.complete for _, found, _ in states)
    print(f"{len(states):,} states of {len(tasks):,} tasks, {complete:,} of their sets complete")
    about = {**_metadata(settings, args), **exploration}
    write_atomically(args.out, partial(write_action_sets, states=states, dynamics=dynamics, about=about))
    print(f"npz: {args.out}")
    return 0


def _check(args: argparse.Namespace) -> None:
    """Raises CommandError or OutputError for what would otherwise fail only after the tasks are solved."""
    if args.sets and (args.out is None or args.minari is not None or args.images or args.episodes is not None):
        raise CommandError("--sets needs --out and excludes --minari, --images and --episodes")
    if not 0 <= args.exploration <= 1:
        raise CommandError(f"--exploration must be a probability from 0 to 1, not {args.exploration}")
    check_at_least(args, 1, "repeats", "jobs", "episodes")
    check_at_least(args, 0, "seed")
    if args.out is None and args.minari is None:
        raise CommandError("name an output: --out FILE, --minari NAME, or both")
    if args.minari is not None and find_spec("minari") is None:
        raise CommandError(f"--minari needs Minari, --out does not: {install('minari')}")
    if args.out is not None:
        if args.out.suffix != ".npz":
            raise CommandError(f"--out must name a file that ends in .npz, not {str(args.out)!r}")
        fresh_file(args.out, force=args.force)


def _metadata(settings: Settings, args: argparse.Namespace) -> dict[str, Any]:
    """The tasks of the demonstrations, and all that is needed to reproduce them."""
    provenance = load_tasks(settings.corpus, settings.appearance, settings.start, args.split).provenance
    return {
        "lilgym_mp": __version__,
        "settings": settings.to_json(),
        "split": args.split,
        "corpus_sha256": provenance.sha256,
        "budget": args.budget,
        "episodes": args.episodes,
        "seed": args.seed,
    }


def _write_minari(episodes: Sequence[Demonstration], settings: Settings, args: argparse.Namespace) -> None:
    from lilgym_mp.solver.minari_dataset import write_minari

    metadata = ", ".join(f"{name} {value}" for name, value in _metadata(settings, args).items() if value is not None)
    form = TEXT if args.observation == TEXT else ARRAYS
    envs: list[gym.Env[Any, Any]] = []
    for split in (args.split, EVALUATION_SPLIT):
        with suppress(NoTasksError):
            envs.append(gym.make(settings.id, observation=form, **settings.arguments(split)))
    if args.observation == STRUCTURED:
        slots = max(item_capacity(env.get_wrapper_attr("tasks"), settings.dynamics()) for env in envs)
        envs = [StructuredObservation(env, slots=slots) for env in envs]
    write_minari(args.minari, episodes, envs[0], envs[-1], f"Shortest solutions. {metadata}")
