"""`lilgym-mp train imitation`: a network that imitates the expert's optimal actions, from images and text."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from lilgym_mp.choices import choose
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import (
    INTERRUPTED,
    RUNS,
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
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.learning.imitation.recipe import ImitationRecipe, default_recipe
from lilgym_mp.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.learning.imitation.training import Progress as TrainingProgress

LEARNER = "imitation"
DEFAULT_MINUTES = 10.0


def add_parser(learners: Any) -> None:
    parser = learners.add_parser(
        LEARNER,
        help="a network that imitates the expert's optimal actions, from images and text",
        description="Trains a network to imitate the sets of optimal actions that the expert finds. The trained agent "
        "acts on images and statements alone, without planning.",
    )
    add_configuration(parser)
    add_run_directory(parser, f"{LEARNER}-CONFIGURATION")
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
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
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
    directory = args.out or RUNS / f"{LEARNER}-{args.configuration}"
    try:
        with ImitationDisplay(args.minutes, resumed=args.resume) as display:
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
            f"interrupted; resume with: lilgym-mp train {LEARNER} {args.configuration} --resume"
            f" --corpus {settings.corpus} --minutes {args.minutes:g} --seed {args.seed} --out {directory}"
        )
        return INTERRUPTED
    print(
        f"saved {directory / AGENT_FILE}\nevaluate it with: lilgym-mp evaluate {directory} --corpus {settings.corpus}"
    )
    return 0


class ImitationDisplay:
    """Shows the progress of an imitation run in CPU seconds. A context manager."""

    def __init__(self, minutes: float, *, resumed: bool) -> None:
        self._progress = Progress(round(60 * minutes), "CPU seconds", done=None if resumed else 0)

    def __enter__(self) -> ImitationDisplay:
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
