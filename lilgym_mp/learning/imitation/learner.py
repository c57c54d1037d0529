"""Imitation of the expert as a learner, and its command."""

from __future__ import annotations

import argparse
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
    add_seed,
    add_settings,
    check_at_least,
    given_options,
    given_settings,
)
from lilgym_mp.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.learning.imitation.training import Progress as TrainingProgress

NAME = "imitation"
DEFAULT_MINUTES = 10.0


def add_options(parser: argparse.ArgumentParser) -> None:
    add_configuration(parser)
    add_run_directory(parser, f"{NAME}-CONFIGURATION")
    parser.add_argument(
        "--minutes",
        type=float,
        default=DEFAULT_MINUTES,
        metavar="N",
        help="CPU time, including the expert's (default: %(default)s)",
    )
    add_seed(parser, "of the network and its data")
    add_device(parser)
    add_settings(parser)
    add_recipe(parser, ImitationRecipe)


def train(args: argparse.Namespace) -> int:
    import torch

    from lilgym_mp.learning.agents import AGENT_FILE
    from lilgym_mp.learning.imitation.training import train_imitation

    choose("configuration", args.configuration, CONFIGURATIONS)
    check_at_least(args, 0, "seed")
    check_at_least(args, 1, "threads")
    if args.minutes <= 0:
        raise CommandError(f"--minutes must be above 0, not {args.minutes:g}")
    torch.set_num_threads(args.threads)
    settings = Settings(**given_settings(args))
    names = [name for name in ImitationRecipe.__dataclass_fields__ if hasattr(args, name)]
    recipe = default_recipe(settings.appearance, **given_options(args, names))
    directory = args.out or RUNS / f"{NAME}-{args.configuration}"
    try:
        with _Display(args.minutes, resumed=args.resume) as display:
            train_imitation(
                settings,
                recipe,
                directory,
                minutes=args.minutes,
                seed=args.seed,
                device=args.device,
                resume=args.resume,
                on_progress=display,
            )
    except KeyboardInterrupt:
        print(
            f"interrupted; resume with: lilgym-mp train {NAME} {args.configuration} --resume"
            f" --corpus {settings.corpus} --minutes {args.minutes:g} --seed {args.seed} --out {directory}"
        )
        return INTERRUPTED
    print(
        f"saved {directory / AGENT_FILE}\nevaluate it with: lilgym-mp evaluate {directory} --corpus {settings.corpus}"
    )
    return 0


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
