"""`lilgym-mp train imitation`: a network that imitates the expert's optimal actions, from images and words."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.choices import choose
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import (
    INTERRUPTED,
    RUNS,
    add_configuration,
    add_device,
    add_recipe,
    add_settings,
    said,
    said_settings,
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
        help="a network that imitates the expert's optimal actions, from images and words",
        description="Train a network to imitate the sets of optimal actions that the expert finds. At test it sees "
        "images and words alone, and plans nothing.",
    )
    add_configuration(parser, help=f"one of {', '.join(CONFIGURATIONS)}")
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"the run's directory (default: {RUNS}/{LEARNER}-NAME)")
    parser.add_argument("--resume", action="store_true", help="go on with the run in that directory")
    parser.add_argument(
        "--minutes",
        type=float,
        default=DEFAULT_MINUTES,
        metavar="N",
        help="processor time, the expert's included (default: %(default)s)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the network and its data (default: 0)")
    add_device(parser)
    add_settings(parser)
    add_recipe(parser, ImitationRecipe)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    import torch

    from lilgym_mp.learning.agents import AGENT_FILE
    from lilgym_mp.learning.imitation.training import train_imitation

    choose("configuration", args.configuration, CONFIGURATIONS)
    if args.seed < 0 or args.threads < 1 or args.minutes <= 0:
        raise CommandError("--seed must be at least 0, --threads at least 1, --minutes above 0")
    torch.set_num_threads(args.threads)
    settings = Settings(**said_settings(args))
    names = [name for name in ImitationRecipe.__dataclass_fields__ if hasattr(args, name)]
    recipe = default_recipe(settings.appearance, **said(args, names))
    place = args.out or RUNS / f"{LEARNER}-{args.configuration}"
    try:
        with ImitationDisplay(args.minutes, resumed=args.resume) as display:
            train_imitation(
                settings,
                recipe,
                place,
                minutes=args.minutes,
                seed=args.seed,
                device=args.device,
                resume=args.resume,
                on_progress=display,
            )
    except KeyboardInterrupt:
        print(
            f"interrupted; go on with: lilgym-mp train {LEARNER} {args.configuration} --resume"
            f" --corpus {settings.corpus} --minutes {args.minutes:g} --seed {args.seed} --out {place}"
        )
        return INTERRUPTED
    print(f"saved {place / AGENT_FILE}\nevaluate it with: lilgym-mp evaluate {place} --corpus {settings.corpus}")
    return 0


class ImitationDisplay:
    """Shows how an imitation run goes, in CPU seconds. A context manager."""

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
