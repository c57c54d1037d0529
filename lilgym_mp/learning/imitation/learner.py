"""Imitation of the expert as a learner, and its command."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from lilgym_mp.choices import choose
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.learning.imitation.recipe import ImitationRecipe, default_recipe
from lilgym_mp.learning.learners import Learner
from lilgym_mp.options import (
    INTERRUPTED,
    RUNS,
    CommandError,
    add_configuration,
    add_device,
    add_recipe,
    add_run_directory,
    add_settings,
    check_at_least,
    fill_options,
    given_options,
    given_settings,
)
from lilgym_mp.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.learning.imitation.training import Progress as TrainingProgress

NAME = "imitation"
DEFAULT_MINUTES = 10.0
DEFAULTS = {"minutes": DEFAULT_MINUTES, "seed": 0}
RECIPE_OPTIONS = [each.name for each in fields(ImitationRecipe)]


def add_options(parser: argparse.ArgumentParser) -> None:
    add_configuration(parser, nargs="?")
    add_run_directory(parser, f"{NAME}-CONFIGURATION")
    parser.add_argument(
        "--minutes",
        type=float,
        metavar="N",
        help=f"CPU time, including the expert's (default: the resumed run's, or {DEFAULT_MINUTES:g})",
    )
    parser.add_argument("--seed", type=int, metavar="N", help="random seed of the network and its data (default: 0)")
    add_device(parser)
    add_settings(parser)
    add_recipe(parser, ImitationRecipe)


def train(args: argparse.Namespace) -> int:
    import torch

    from lilgym_mp.learning.agents import AGENT_FILE
    from lilgym_mp.learning.imitation.training import train_imitation

    check_at_least(args, 0, "seed")
    check_at_least(args, 1, "threads")
    torch.set_num_threads(args.threads)
    directory, settings, recipe = _resumed(args) if args.resume else _new(args)
    minutes: float = args.minutes
    if minutes <= 0:
        raise CommandError(f"--minutes must be above 0, not {minutes:g}")
    try:
        with _Display(minutes, resumed=args.resume) as display:
            train_imitation(
                settings,
                recipe,
                directory,
                minutes=minutes,
                seed=args.seed,
                device=args.device,
                resume=args.resume,
                on_progress=display,
            )
    except KeyboardInterrupt:
        print(f"interrupted; resume with: lilgym-mp train {NAME} --resume --out {directory}")
        return INTERRUPTED
    print(
        f"saved {directory / AGENT_FILE}\nevaluate it with: lilgym-mp evaluate {directory} --corpus {settings.corpus}"
    )
    return 0


def _new(args: argparse.Namespace) -> tuple[Path, Settings, ImitationRecipe]:
    if args.configuration is None:
        raise CommandError(f"name a configuration to train on; choose from {', '.join(CONFIGURATIONS)}")
    choose("configuration", args.configuration, CONFIGURATIONS)
    settings = Settings(**given_settings(args))
    recipe = default_recipe(settings.appearance, **given_options(args, RECIPE_OPTIONS))
    fill_options(args, {}, DEFAULTS)
    return args.out or RUNS / f"{NAME}-{args.configuration}", settings, recipe


def _resumed(args: argparse.Namespace) -> tuple[Path, Settings, ImitationRecipe]:
    from lilgym_mp.learning.training_run import resumable_run

    if args.out is None and args.configuration is None:
        raise CommandError("name what to resume: --out DIR, or a configuration")
    directory = args.out or RUNS / f"{NAME}-{args.configuration}"
    given = {"environment": given_settings(args), "recipe": given_options(args, RECIPE_OPTIONS)}
    required = {"learner": NAME, **given, **given_options(args, ["seed"])}
    run, recipe = resumable_run(directory, required, ImitationRecipe)
    fill_options(args, {**run.options, **run.identity}, DEFAULTS)
    return directory, Settings.from_json(run.identity["environment"]), recipe


class _Display:
    """Shows the progress of an imitation run in CPU seconds. A context manager."""

    def __init__(self, minutes: float, *, resumed: bool) -> None:
        self._progress = Progress(round(60 * minutes), "CPU seconds", done=None if resumed else 0)

    def __enter__(self) -> _Display:
        return self

    def __exit__(self, *exception: object) -> None:
        self._progress.__exit__(*exception)

    def __call__(self, progress: TrainingProgress) -> None:
        if progress.actions is None or progress.truth_accuracy is None:
            note = f"text layers, loss {progress.text or 0:.2f}"
        else:
            note = (
                f"{progress.states:,} states, loss {progress.actions:.2f}, truth {100 * progress.truth_accuracy:.1f} %"
            )
        self._progress.reach(int(progress.cpu_seconds), note)


LEARNER = Learner(
    summary="a network that imitates the expert's optimal actions, from images and text",
    description="Trains a network to imitate the sets of optimal actions that the expert finds. The trained agent acts "
    "on images and statements alone, without planning.",
    add_options=add_options,
    train=train,
    load_agent="lilgym_mp.learning.imitation.agent:load_agent",
    recipe=ImitationRecipe,
    make_recipe=lambda configuration, options: default_recipe(CONFIGURATIONS[configuration][0], **options),
    budget=lambda options: ("cpu_seconds", 60 * options["minutes"]),
    progress=("truth_accuracy", "accuracy of predicted truth values"),
    numbers={"minutes": DEFAULT_MINUTES},
)
