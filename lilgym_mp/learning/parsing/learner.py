"""An agent that parses statements into programs and plans with them.

Trains one agent for all configurations of a corpus: it learns to parse statements into programs, reads scenes from
pixels, and plans for the most likely programs. Takes some minutes on one CPU core.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from lilgym_mp.evaluation import options
from lilgym_mp.evaluation.options import given_options
from lilgym_mp.evaluation.terminal import Progress
from lilgym_mp.learning.common.commands import add_recipe, interrupted
from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.parsing.recipe import ParserRecipe

if TYPE_CHECKING:
    from lilgym_mp.learning.parsing.training import Progress as TrainingProgress

NAME = "parse-and-plan"


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--corpus", help=options.CORPUS_HELP)
    options.add_run_directory(parser, NAME)
    options.add_number(parser, "--save-every", 500, "updates between checkpoints")
    options.add_device(parser)
    add_recipe(parser, ParserRecipe)


def train(args: argparse.Namespace) -> int:
    import torch

    from lilgym_mp.learning.common.run_directory import resumable_run
    from lilgym_mp.learning.parsing.training import train_parser

    options.check_at_least(args, 1, "threads", "save_every")
    torch.set_num_threads(args.threads)
    directory = args.out or options.RUNS / NAME
    given = given_options(args, ParserRecipe.names())
    saved: Mapping[str, Any] = {}
    if args.resume:
        required = {"learner": NAME, **given_options(args, ["corpus"]), "recipe": given}
        run, recipe = resumable_run(directory, required, ParserRecipe)
        saved = run.identity
    else:
        recipe = ParserRecipe(**given)
    options.fill_options(args, saved, {"corpus": "builtin"})
    with Progress(recipe.updates, "updates", None if args.resume else 0, doing=f"{NAME}: preparing data") as bar:
        done = train_parser(
            args.corpus,
            recipe,
            directory,
            device=args.device,
            resume=args.resume,
            save_every=args.save_every,
            on_progress=lambda line: bar.reach(line.updates, _note(line)),
        )
    if not done.agent_file.exists():
        return interrupted(NAME, directory)
    print(
        f"saved {done.agent_file} ({done.agent_file.stat().st_size / 1e6:.1f} MB)\n"
        f"evaluate it with: lilgym-mp evaluate {directory} --corpus {args.corpus}\n"
        f'inspect it with: lilgym-mp explain "There is a blue block." --agent {directory}'
    )
    return 0


def _note(progress: TrainingProgress) -> str:
    return f"loss {progress.loss:.3f}, {progress.cpu_seconds / 60:.1f} CPU minutes"


LEARNER = Learner(
    add_options=add_options,
    train=train,
    recipe=ParserRecipe,
    make_recipe=lambda configuration, options: ParserRecipe(**options),
    budget=lambda options: ("updates", options.get("updates", ParserRecipe().updates)),
    progress=("loss", "loss of the parser"),
    plays_everything=True,
)
