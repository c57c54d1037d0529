"""`lilgym-mp train parse-and-plan`: a parser from statements to programs, for an agent that plans with them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import INTERRUPTED, RUNS, add_device, add_recipe, said
from lilgym_mp.learning.parsing.recipe import RECIPE_DESCRIPTIONS, ParserRecipe
from lilgym_mp.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.learning.parsing.training import Progress as TrainingProgress

LEARNER = "parse-and-plan"


def add_parser(learners: Any) -> None:
    parser = learners.add_parser(
        LEARNER,
        help="a parser from statements to programs, and plans for its likely programs",
        description="Train one agent for all configurations of a corpus: it learns to parse statements, reads scenes "
        "from pixels, and plans for the set of likely programs. Some minutes on one processor core.",
    )
    parser.add_argument(
        "--corpus", default="builtin", help='"builtin" (default), "lilgym" (the official one), or a path'
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"the run's directory (default: {RUNS}/{LEARNER})")
    parser.add_argument("--resume", action="store_true", help="go on with the run in that directory")
    parser.add_argument(
        "--save-every", type=int, default=500, metavar="N", help="steps between checkpoints (default: %(default)s)"
    )
    add_device(parser)
    add_recipe(parser, ParserRecipe)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    import torch

    from lilgym_mp.learning.parsing.training import train_parser

    if args.threads < 1 or args.save_every < 1:
        raise CommandError("--threads and --save-every must be at least 1")
    torch.set_num_threads(args.threads)
    recipe = ParserRecipe(**said(args, list(RECIPE_DESCRIPTIONS)))
    place = args.out or RUNS / LEARNER
    with ParserDisplay(recipe.steps, resumed=args.resume) as display:
        done = train_parser(
            args.corpus,
            recipe,
            place,
            device=args.device,
            resume=args.resume,
            save_every=args.save_every,
            on_progress=display,
        )
    if not done.agent_file.exists():
        print(f"interrupted; go on with: lilgym-mp train {LEARNER} --resume --corpus {args.corpus} --out {place}")
        return INTERRUPTED
    print(
        f"saved {done.agent_file} ({done.agent_file.stat().st_size / 1e6:.1f} MB)\n"
        f"evaluate it with: lilgym-mp evaluate {place} --corpus {args.corpus}\n"
        f'look into it with: lilgym-mp explain "There is a blue block." --agent {place}'
    )
    return 0


class ParserDisplay:
    """Shows how a parser's training goes. A context manager."""

    def __init__(self, steps: int, *, resumed: bool) -> None:
        self._progress = Progress(steps, "steps", done=None if resumed else 0)

    def __enter__(self) -> ParserDisplay:
        return self

    def __exit__(self, *exception: object) -> None:
        self._progress.__exit__(*exception)

    def __call__(self, progress: TrainingProgress) -> None:
        note = f"loss {progress.loss:.3f}, {progress.cpu_seconds / 60:.1f} CPU minutes"
        self._progress.reach(progress.step, note)
