"""`lilgym-mp demos`: the expert's solutions as demonstrations, in an npz file or a Minari dataset."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from lilgym_mp import __version__
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import add_configuration, add_settings, add_split, said_settings
from lilgym_mp.cli.solve import add_solving, dynamics_of, solve_split
from lilgym_mp.corpus import load_tasks
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.files import fresh_file, write_whole
from lilgym_mp.extras import install
from lilgym_mp.solver.action_sets import action_sets, explored, write_action_sets
from lilgym_mp.solver.demonstrations import Demonstration, arrays, demonstrations, write_npz


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "demos",
        help="demonstrations of the expert, as npz or Minari dataset",
        description="Writes a shortest solution of each task, with statement, program and target. Equal settings and"
        " seed give equal files.",
    )
    add_configuration(parser)
    add_split(parser, "train")
    parser.add_argument("--out", type=Path, metavar="FILE", help="an npz file; docs/solver.md lists its arrays")
    parser.add_argument("--force", action="store_true", help="overwrite what --out names")
    parser.add_argument("--minari", metavar="NAME", help='a Minari dataset, such as "lilgym/tower-expert-v0"')
    parser.add_argument("--episodes", type=int, metavar="N", help="draw N tasks at random (default: each task once)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the draws (default: 0)")
    parser.add_argument("--images", action="store_true", help="put the images into the npz file as well (large)")
    parser.add_argument("--sets", action="store_true", help="write states with all their good first actions instead")
    parser.add_argument(
        "--exploration", type=float, default=0.25, metavar="P", help="with --sets: how often an edit is random"
    )
    parser.add_argument("--repeats", type=int, default=1, metavar="N", help="with --sets: episodes from each start")
    add_solving(parser)
    add_settings(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    _check(args)
    settings = Settings(**said_settings(args))
    dynamics = dynamics_of(settings)
    if args.sets:
        return _run_sets(settings, args)
    reports = solve_split(settings, args.split, args)
    episodes = demonstrations(reports, dynamics, args.episodes, args.seed)
    unsolved = sum(not report.solution.solved for report in reports)
    print(f"{len(episodes):,} demonstrations of {len(reports):,} tasks, {unsolved:,} of them without a solution")
    if args.out is not None:
        found = arrays(episodes, dynamics, images=args.images)
        try:
            write_whole(args.out, partial(_write_npz, found, _about(settings, args)))
        except OSError as error:
            raise CommandError(f"cannot write {args.out}: {error.strerror or error}") from None
        print(f"npz: {args.out}")
    if args.minari is not None:
        _write_minari(episodes, settings, args)
        print(f"Minari: {args.minari}")
    return 0


def _run_sets(settings: Settings, args: argparse.Namespace) -> int:
    dynamics = dynamics_of(settings)
    tasks = load_tasks(settings.corpus, settings.appearance, settings.start, args.split)
    chosen = {"exploration": args.exploration, "repeats": args.repeats, "seed": args.seed}
    states = explored(list(tasks), dynamics, jobs=args.jobs, budget=args.budget, **chosen)
    sets = action_sets(states, dynamics, {**_about(settings, args), **chosen})
    try:
        write_whole(args.out, partial(write_action_sets, sets=sets))
    except OSError as error:
        raise CommandError(f"cannot write {args.out}: {error.strerror or error}") from None
    print(f"{len(sets):,} states of {len(sets.task):,} tasks, {int(sets.complete.sum()):,} of their sets complete")
    print(f"npz: {args.out}")
    return 0


def _check(args: argparse.Namespace) -> None:
    """Raises CommandError or OutputError for what would fail after all the work."""
    if args.sets and (args.out is None or args.minari is not None or args.images or args.episodes is not None):
        raise CommandError("--sets needs --out and takes no --minari, --images or --episodes")
    if not 0 <= args.exploration <= 1:
        raise CommandError(f"--exploration must be a probability from 0 to 1, not {args.exploration}")
    if args.repeats < 1:
        raise CommandError(f"--repeats must be at least 1, not {args.repeats}")
    if args.jobs < 1:
        raise CommandError(f"--jobs must be at least 1, not {args.jobs}")
    if args.out is None and args.minari is None:
        raise CommandError("say where to write: --out FILE, --minari NAME, or both")
    if args.episodes is not None and args.episodes < 1:
        raise CommandError(f"--episodes must be at least 1, not {args.episodes}")
    if args.seed < 0:
        raise CommandError(f"--seed must be at least 0, not {args.seed}")
    if args.minari is not None and find_spec("minari") is None:
        raise CommandError(f"--minari needs Minari, --out does not: {install('minari')}")
    if args.out is not None:
        if args.out.suffix != ".npz":
            raise CommandError(f"--out must name a file that ends in .npz, not {str(args.out)!r}")
        fresh_file(args.out, force=args.force)


def _write_npz(found: dict[str, Any], about: dict[str, Any], path: Path) -> None:
    write_npz(path, found, about)


def _about(settings: Settings, args: argparse.Namespace) -> dict[str, Any]:
    """What the demonstrations are of and how to make them again."""
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

    env = settings.make(args.split)
    assert env.spec is not None
    about = ", ".join(f"{name} {value}" for name, value in _about(settings, args).items() if value is not None)
    write_minari(args.minari, episodes, dynamics_of(settings), env.spec, f"Shortest solutions. {about}")
    env.close()
