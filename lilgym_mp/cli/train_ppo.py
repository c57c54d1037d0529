"""`lilgym-mp train ppo`: proximal policy optimisation with masks of legal actions."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.cli.display import TrainingDisplay
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import (
    INTERRUPTED,
    RUNS,
    add_configuration,
    add_recipe,
    add_settings,
    option,
    said,
    said_settings,
)
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.learning.recipe import DESCRIPTIONS, Recipe

if TYPE_CHECKING:
    from lilgym_mp.learning.training import Run

DEFAULT_STEPS = 200_000
DEFAULT_BACKEND = "batched"


def add_parser(learners: Any) -> None:
    parser = learners.add_parser(
        "ppo",
        help="proximal policy optimisation, from rewards alone",
        description="Train an agent with masked proximal policy optimisation. Ctrl-C saves and ends.",
    )
    add_configuration(parser, nargs="?", help=f"one of {', '.join(CONFIGURATIONS)}")
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"the run's directory (default: {RUNS}/CONFIGURATION)")
    parser.add_argument("--resume", action="store_true", help="go on with the run in that directory")
    parser.add_argument(
        "--steps", type=int, default=DEFAULT_STEPS, metavar="N", help="actions in all (default: %(default)s)"
    )
    parser.add_argument(
        "--save-every", type=int, default=20_000, metavar="N", help="steps between checkpoints (default: %(default)s)"
    )
    parser.add_argument(
        "--evaluate-every",
        type=int,
        metavar="N",
        help="steps between evaluations on dev, for learning curves (default: none)",
    )
    parser.add_argument(
        "--backend",
        default=DEFAULT_BACKEND,
        metavar="NAME",
        help="how environments run: batched, workers, or Stable-Baselines3's subproc and dummy (default: %(default)s)",
    )
    parser.add_argument("--threads", type=int, default=1, metavar="N", help="for the network (default: %(default)s)")
    add_settings(parser)
    add_recipe(parser, Recipe)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.learning.environments import check_backend
    from lilgym_mp.learning.ppo_agent import save_agent
    from lilgym_mp.learning.training import train

    check_backend(args.backend)
    for name in ("steps", "save_every", "evaluate_every", "threads"):
        if (value := getattr(args, name)) is not None and value < 1:
            raise CommandError(f"--{option(name)} must be at least 1, not {value}")
    ready = _resumed(args) if args.resume else _begun(args)
    print(_described(ready, args.steps))
    with TrainingDisplay(ready.steps, args.steps) as display:
        done = train(
            ready,
            args.steps,
            backend=args.backend,
            save_every=args.save_every,
            evaluate_every=args.evaluate_every,
            threads=args.threads,
            on_update=display,
        )
    save_agent(done)
    place = done.directory.path
    print(f"saved {done.directory.checkpoint_file} after {done.steps:,} steps")
    if done.steps < args.steps:
        print(f"interrupted; go on with: lilgym-mp train ppo --resume --out {place} --steps {args.steps}")
        return INTERRUPTED
    print(f"evaluate it with: lilgym-mp evaluate {place}")
    return 0


def _begun(args: argparse.Namespace) -> Run:
    from lilgym_mp.learning.training import begin_run

    if args.configuration is None:
        raise CommandError(f"name a configuration to train on; choose from {', '.join(CONFIGURATIONS)}")
    recipe = Recipe(**said(args, list(DESCRIPTIONS)))
    return begin_run(args.out or RUNS / args.configuration, Settings(**said_settings(args)), recipe)


def _resumed(args: argparse.Namespace) -> Run:
    from lilgym_mp.learning.training import open_run

    if args.out is None and args.configuration is None:
        raise CommandError("name what to resume: --out DIR, or a configuration")
    place = args.out or RUNS / args.configuration
    return open_run(place, {**said_settings(args), **said(args, list(DESCRIPTIONS))}, untrained=True)


def _described(ready: Run, steps: int) -> str:
    settings, recipe = ready.identity.settings, ready.identity.recipe
    weights = sum(weight.numel() for weight in ready.make_network().parameters())
    origin = f", after {ready.steps:,} before" if ready.steps else ""
    return (
        f"{settings.configuration}, corpus {settings.corpus}, {len(ready.tasks):,} training tasks;"
        f" {steps:,} steps{origin}; {weights:,} weights, seed {recipe.seed}\n"
        f"run directory: {ready.directory.path}   curves: tensorboard --logdir {ready.directory.tensorboard}"
    )
