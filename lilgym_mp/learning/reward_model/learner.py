"""The reward model as a learner, and its command."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from lilgym_mp.choices import choose
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.learning.learners import Learner
from lilgym_mp.learning.reward_model.recipe import RewardModelRecipe, default_recipe
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
    from lilgym_mp.learning.reward_model.training import Progress as TrainingProgress

NAME = "reward-model"
DEFAULT_MINUTES = 15.0
DEFAULTS = {"minutes": DEFAULT_MINUTES, "seed": 0}
RECIPE_OPTIONS = [each.name for each in fields(RewardModelRecipe)]


def add_options(parser: argparse.ArgumentParser) -> None:
    add_configuration(parser, nargs="?")
    add_run_directory(parser, f"{NAME}-CONFIGURATION")
    parser.add_argument(
        "--minutes",
        type=float,
        metavar="N",
        help=f"CPU time, data collection included (default: the resumed run's, or {DEFAULT_MINUTES:g})",
    )
    parser.add_argument("--seed", type=int, metavar="N", help="random seed of the network and its data (default: 0)")
    add_device(parser)
    add_settings(parser)
    add_recipe(parser, RewardModelRecipe)


def train(args: argparse.Namespace) -> int:
    import torch

    from lilgym_mp.learning.agents import AGENT_FILE
    from lilgym_mp.learning.reward_model.training import train_reward_model

    check_at_least(args, 0, "seed")
    check_at_least(args, 1, "threads")
    if args.minutes is not None and args.minutes <= 0:
        raise CommandError(f"--minutes must be above 0, not {args.minutes:g}")
    torch.set_num_threads(args.threads)
    directory, settings, recipe = _resumed(args) if args.resume else _new(args)
    minutes: float = DEFAULT_MINUTES if args.minutes is None else args.minutes
    try:
        with Progress(round(60 * minutes), "CPU seconds", done=None if args.resume else 0) as display:

            def show(progress: TrainingProgress) -> None:
                held_out = progress.held_out_accuracy
                known = "" if held_out is None else f", held out {100 * held_out:.1f} %"
                note = (
                    f"{progress.stops:,} stops, loss {progress.loss:.2f}, truth {100 * progress.accuracy:.1f} %{known}"
                )
                display.reach(int(progress.cpu_seconds), note)

            train_reward_model(
                settings,
                recipe,
                directory,
                minutes=minutes,
                seed=args.seed,
                device=args.device,
                resume=args.resume,
                on_progress=show,
            )
    except KeyboardInterrupt:
        print(f"interrupted; resume with: lilgym-mp train {NAME} --resume --out {directory}")
        return INTERRUPTED
    print(
        f"saved {directory / AGENT_FILE}\nevaluate it with: lilgym-mp evaluate {directory} --corpus {settings.corpus}"
    )
    return 0


def _new(args: argparse.Namespace) -> tuple[Path, Settings, RewardModelRecipe]:
    if args.configuration is None:
        raise CommandError(f"name a configuration to train on; choose from {', '.join(CONFIGURATIONS)}")
    choose("configuration", args.configuration, CONFIGURATIONS)
    settings = Settings(**given_settings(args))
    recipe = default_recipe(settings.appearance, **given_options(args, RECIPE_OPTIONS))
    fill_options(args, {}, DEFAULTS)
    return args.out or RUNS / f"{NAME}-{args.configuration}", settings, recipe


def _resumed(args: argparse.Namespace) -> tuple[Path, Settings, RewardModelRecipe]:
    from lilgym_mp.learning.training_run import resumable_run

    if args.out is None and args.configuration is None:
        raise CommandError("name what to resume: --out DIR, or a configuration")
    directory = args.out or RUNS / f"{NAME}-{args.configuration}"
    given = {"environment": given_settings(args), "recipe": given_options(args, RECIPE_OPTIONS)}
    required = {"learner": NAME, **given, **given_options(args, ["seed"])}
    run, recipe = resumable_run(directory, required, RewardModelRecipe)
    fill_options(args, {**run.options, **run.identity}, DEFAULTS)
    return directory, Settings.from_json(run.identity["environment"]), recipe


LEARNER = Learner(
    summary="a model of rewards and search with it, from rewards and the rules of editing",
    description="Learns from the rewards of STOPs whether statements hold in scenes, and plays by searching, with the "
    "rules of editing, for a scene where it is sure of the target. One agent plays both starts of an appearance.",
    add_options=add_options,
    train=train,
    load_agent="lilgym_mp.learning.reward_model.agent:load_agent",
    recipe=RewardModelRecipe,
    make_recipe=lambda configuration, options: default_recipe(CONFIGURATIONS[configuration][0], **options),
    budget=lambda options: ("cpu_seconds", 60 * options["minutes"]),
    progress=("held_out_accuracy", "accuracy of predicted truth values on held-out statements"),
    numbers={"minutes": DEFAULT_MINUTES},
)
